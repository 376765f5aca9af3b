"""How often ``harness trace`` names what is missing: cases of the blind plant, traced, and only then opened.

``python -m bench.attribution --cases semitrailer-none semitrailer-crosswind-medium`` runs some cases,
``--magnitude medium`` all of one magnitude, nothing of these all that the list holds (hours). The plant writes a case
in a process of its own; ``sealed.json`` is read when ``trace.json`` is there. Cases that were traced already are only
scored. Written are ``attribution.json`` and the tables as Markdown.
"""

from __future__ import annotations

import argparse
import json
import math
import re
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from harness.command_line import model_table
from harness.errors import UserError
from harness.identify.recordings import step_of
from harness.loop.run import Task, run_trace, whole_of
from harness.loop.whole import Whole
from harness.measured import load_recording
from harness.measured.study import finely, fitted_parameters
from models.contracts import ModelError

PLANT = Path(__file__).parents[1] / "tests" / "blind" / "plant.py"
PARAMETER = "parameter:"


@dataclass(frozen=True)
class Scored:
    """One case, scored.

    Attributes:
        case: Its name.
        repeat: Its repeat.
        kind: ``none``, ``parameters``, ``effect``, ``pair`` or ``unlisted``.
        magnitude: ``small``, ``medium``, ``large`` or empty.
        verdict: What the trace says.
        true: Names of the effects that are there.
        claimed: Effects added, in their order.
        found: How many of the true effects were added, or stand in a confusable set with one that was.
        right: Whether the case counts as solved.
        closed: Share of the held-out error beyond the sensors' noise that was taken away; NaN if there was none.
        errors: Relative error of each parameter that both sides name.
    """

    case: str
    repeat: int
    kind: str
    magnitude: str
    verdict: str
    true: tuple[str, ...]
    claimed: tuple[str, ...]
    found: int
    right: bool
    closed: float
    errors: dict[str, float]


def score(folder: Path) -> Scored:
    """Compare what was traced in a folder with what the seal says."""
    traced = json.loads((folder / "trace" / "trace.json").read_text())
    sealed = json.loads((folder / "sealed.json").read_text())
    true = [(e["name"], {e["name"], *e["equivalent"]}) for e in sealed["effects"]]
    claimed = [a["effect"] for a in traced["added"]]
    wrong = [PARAMETER + a["effect"] for a in traced["parameters"]]
    alike = {name.split("@")[0] for group in traced["confusable"] for name in group}
    named = {*claimed, *wrong, *(alike if claimed or wrong else ())}
    found = sum(bool(names & named) for _, names in true)
    before, after = traced["excess"]["before"], traced["excess"]["after"]
    known = before is not None and after is not None and before > 0
    return Scored(
        sealed["case"],
        sealed["repeat"],
        sealed["kind"],
        next((m for m in ("small", "medium", "large") if sealed["case"].endswith(f"-{m}")), ""),
        traced["verdict"],
        tuple(name for name, _ in true),
        tuple(claimed),
        found,
        _right(sealed["kind"], traced["verdict"], claimed, found, len(true)),
        1.0 - math.sqrt(after / before) if known else math.nan,
        _errors(traced, sealed),
    )


def _right(kind: str, verdict: str, claimed: Sequence[str], found: int, true: int) -> bool:
    match kind:
        case "none" | "parameters":
            return not claimed
        case "unlisted":
            return verdict == "unresolved"
    return found == true


def _errors(traced: dict, sealed: dict) -> dict[str, float]:
    values = {name: p["value"] for a in traced["added"] for name, p in a["parameters"].items()}
    true = {
        n: v for e in sealed["effects"] if e["oracle"]["form"] == "same" for n, v in e["oracle"]["parameters"].items()
    }
    return {n: abs(values[n] / v - 1.0) for n, v in true.items() if n in values and v != 0.0}


class Tracer:
    """Writes cases and traces them with the published semitrailer, compiled once."""

    def __init__(self) -> None:
        self._whole: Whole | None = None

    def run(self, case: str, repeat: int, folder: Path) -> str:
        """Write a case and trace it; return what went wrong, or nothing."""
        if not (folder / "train_a.csv").exists():
            plant = [sys.executable, str(PLANT), "--case", case, "--repeat", str(repeat), "--out", str(folder)]
            done = subprocess.run(plant, capture_output=True, text=True, check=False)
            if done.returncode:
                return done.stderr.strip()
        if not (folder / "trace" / "trace.json").exists():
            task = _task(folder)
            self._whole = self._whole or whole_of(task)
            try:
                run_trace(task, folder / "trace", Console(quiet=True), self._whole)
            except (UserError, ModelError) as error:
                return str(error)
        return ""


def _task(folder: Path) -> Task:
    """Return what is to be traced in a folder; the published values are those that the plant gives out as belief."""
    drives = [load_recording(folder / f"{n}.csv", None).assign_attrs(name=n) for n in ("train_a", "train_b", "test")]
    belief = json.loads((folder / "belief.json").read_text())
    table = model_table(belief["vehicle"], None, None, None, "test_vehicle_inertial", None)
    spec = finely(table, step_of(drives[0]), str(folder))
    return Task(spec, drives[:2], drives[2:], fitted_parameters(spec, [], "free"), ())


def tables(scored: Sequence[Scored]) -> str:
    """Return the results as Markdown: shares by kind, then the cases."""
    lines = [
        "| cases | number | right | median share of the error gap closed | median parameter error |",
        "|---|--:|--:|--:|--:|",
    ]
    groups: dict[str, list[Scored]] = {}
    for s in scored:
        groups.setdefault(" ".join(filter(None, (s.kind, s.magnitude))), []).append(s)
    for name, group in sorted(groups.items()):
        closed = [s.closed for s in group if math.isfinite(s.closed) and s.kind not in ("none", "parameters")]
        errors = [e for s in group for e in s.errors.values()]
        shown = [f"{np.median(v):.1%}" if v else "–" for v in (closed, errors)]
        lines.append(f"| {name} | {len(group)} | {np.mean([s.right for s in group]):.0%} | {shown[0]} | {shown[1]} |")
    lines += ["", "| case | verdict | claimed | right | gap closed |", "|---|---|---|---|--:|"]
    for s in scored:
        gap = f"{s.closed:.0%}" if math.isfinite(s.closed) else "–"
        yes = "yes" if s.right else "no"
        lines.append(f"| {s.case}, {s.repeat} | {s.verdict} | {', '.join(s.claimed) or '–'} | {yes} | {gap} |")
    return "\n".join(lines) + "\n"


def chosen(given: argparse.Namespace) -> list[str]:
    """Return the cases asked for."""
    if given.cases:
        return list(given.cases)
    listed = subprocess.run([sys.executable, str(PLANT), "--list"], capture_output=True, text=True, check=True).stdout
    names = [line.split("\t")[0] for line in listed.splitlines()]
    names = [n for n in names if n.startswith("semitrailer")]
    if given.magnitude:
        names = [n for n in names if not re.search("-(small|medium|large)$", n) or n.endswith(given.magnitude)]
    return names


def main() -> None:
    """Run, score, print and write."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--cases", nargs="*", help="names from the plant's list")
    parser.add_argument("--magnitude", default="", help="small, medium or large only")
    parser.add_argument("--repeats", type=int, default=1, help="draws of each case (%(default)s)")
    parser.add_argument("--out", type=Path, default=Path("results/attribution"))
    given = parser.parse_args()
    console, scored, tracer = Console(), [], Tracer()
    tasks = [(case, repeat) for repeat in range(given.repeats) for case in chosen(given)]
    for case, repeat in track(tasks, "tracing", console=console):
        folder = given.out / f"{case}-{repeat}"
        failed = tracer.run(case, repeat, folder)
        if failed:
            console.print(f"{case}, {repeat}: {failed}")
            continue
        scored.append(score(folder))
        given.out.mkdir(parents=True, exist_ok=True)
        (given.out / "attribution.json").write_text(json.dumps([asdict(s) for s in scored], indent=1) + "\n")
        (given.out / "attribution.md").write_text(tables(scored))
        console.print(f"{case}, {repeat}: {scored[-1].verdict}, {', '.join(scored[-1].claimed) or 'nothing claimed'}")
    console.print(tables(scored))


if __name__ == "__main__":
    main()
