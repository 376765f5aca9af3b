"""Attribution of ``harness trace`` on cases of the blind plant, which are opened only after they were traced.

``python -m bench.attribution --cases semitrailer-none semitrailer-crosswind-medium`` runs some cases, ``--vehicle car``
all of one vehicle, ``--magnitude medium`` all of one magnitude, nothing of these all that the plant lists (hours).
``--gate 274 --magnitude medium`` draws at random among them, in the shares by which traces are judged; with ``--kind
effect`` those alone that lack one effect.
Cases that were traced already are only scored; ``--traced`` runs no other. The folder holds every case, and for all
that are in it ``attribution.json`` (what ``bench.attribution.renew`` makes the tables of the docs of),
``attribution.md`` and the figures. ``--quality real`` takes the realistic plants, with a table of their own.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import track

from bench.attribution.figures import figures
from bench.attribution.gate import REAL_SHARES, SHARES, drawn
from bench.attribution.run import NOMINAL, QUALITIES, Case, listed, run_all
from bench.attribution.score import FAILED, MAGNITUDES, Scored, score, text
from bench.attribution.tables import case_table, tables
from bench.real import score as real
from harness.common.arguments import Parser
from harness.common.files import write_files

BESIDE = ("multi_body",)
"""Plants that no draw takes unless it is asked for: slow, and written by nobody here."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, score, print and write."""
    parser = Parser(
        prog="python -m bench.attribution", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", nargs="+", default=[], help="names from the plant's list")
    parser.add_argument("--vehicle", choices=(*NOMINAL, *BESIDE), help="cases of one vehicle only")
    parser.add_argument("--magnitude", choices=MAGNITUDES, help="one only; cases that have none stay")
    parser.add_argument("--quality", choices=QUALITIES, default=QUALITIES[0], help="of the recordings (%(default)s)")
    parser.add_argument("--repeats", type=int, default=1, help="draws of each case (%(default)s)")
    parser.add_argument("--first", type=int, default=0, help="number of the first draw (%(default)s)")
    parser.add_argument(
        "--gate", type=int, help="so many draws of cases at random, in the shares of bench.attribution.gate"
    )
    parser.add_argument("--kind", choices=(*SHARES, *REAL_SHARES), help="cases and draws of one kind only")
    parser.add_argument("--jobs", type=int, default=1, help="processes (%(default)s, whose traces take all cores)")
    parser.add_argument("--traced", action="store_true", help="run no case that was not traced already")
    parser.add_argument("--out", type=Path, help="folder (results/attribution, or results/attribution-QUALITY)")
    given = parser.parse_args(arguments)
    out = given.out or Path(
        "results/attribution" if given.quality == "clean" else f"results/attribution-{given.quality}"
    )
    plant_cases = listed(given.quality)
    names = [case.name for case in plant_cases]
    unknown = [name for name in given.cases if name not in names]
    if unknown or given.jobs < 1 or given.repeats < 1:
        parser.error(f"the plant has no case {unknown[0]}" if unknown else "--jobs and --repeats are 1 or more")
    usual = [n for n in names if given.vehicle in BESIDE or not n.startswith(BESIDE)]
    chosen = [n for n in given.cases or usual if wanted(n, given.vehicle, given.magnitude)]
    draws = [(n, repeat) for repeat in range(given.first, given.first + given.repeats) for n in chosen]
    if given.gate is not None:
        shares = REAL_SHARES if given.quality == "real" else SHARES
        draws = drawn([case for case in plant_cases if case.name in chosen], given.first, given.gate, shares)
    kinds = {case.name: case.kind for case in plant_cases}
    draws = [(n, repeat) for n, repeat in draws if given.kind in (None, kinds[n])]
    cases = [Case(n, repeat, out / f"{n}-{repeat}", given.quality) for n, repeat in draws]
    if given.traced:
        cases = [case for case in cases if (case.folder / "trace" / "trace.json").exists()]
    console = Console()
    for case, problem in track(run_all(cases, given.jobs), "tracing", total=len(cases), console=console):
        answer = problem or (real.said(case.folder) if case.quality == "real" else said(score(case.folder)))
        console.print(f"{case.name}, {case.repeat}: {answer}", soft_wrap=True)
    if given.quality == "real":
        write_files(out, real.files(out))
        console.print(real.tables(real.gathered(out)), markup=False, soft_wrap=True)
        return
    scored = gathered(out)
    write_files(out, {"attribution.json": text(scored), "attribution.md": tables(scored) + case_table(scored)})
    write_files(out, figures(scored))
    console.print(tables(scored), markup=False, soft_wrap=True)


def wanted(name: str, vehicle: str | None, magnitude: str | None) -> bool:
    """Whether a case is of a vehicle and of a magnitude, where either is asked for."""
    others = tuple(f"-{m}" for m in MAGNITUDES if magnitude not in (None, m))
    return (vehicle is None or name.startswith(f"{vehicle}-")) and not name.endswith(others)


def said(scored: Scored) -> str:
    """Return a case in a line."""
    return f"{scored.verdict}, {', '.join(scored.claimed) or 'nothing claimed'}, {'right' if scored.right else 'wrong'}"


def gathered(folder: Path) -> list[Scored]:
    """Return every case of a folder that was traced or could not be, scored, in the order of the names."""
    ended = {f.parents[1] for f in folder.glob("*/trace/trace.json")} | {f.parent for f in folder.glob(f"*/{FAILED}")}
    return [score(case) for case in sorted(ended)]


if __name__ == "__main__":
    main()
