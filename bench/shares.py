"""Shares of the time of whole commands, in kernels and beside them: ``python -m bench.shares``.

Two studies (the mass study and the joint study of all factors) and a trace (two drives of the semitrailer in a
crosswind, from the blind plant), from their start to their reports, each in a process of its own, on one core with
kernels in the cache. The profiler says where time goes; as it slows Python down and kernels not, the total is that of a
run without it: kernels count as they are, all else shares the rest as the profiler has it.
"""

from __future__ import annotations

import argparse
import cProfile
import json
import pstats
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

from rich.console import Console

from harness.common.arguments import Parser

COMMANDS = ("mass", "joint", "trace")
CASE = "semitrailer-crosswind-medium"

KERNELS, REST = "kernels", "Python of the harness and all else"
PLACES: Mapping[str, tuple[str, ...]] = {
    "report": ("/reporting/", "/report/", "/matplotlib/", "/typst/", "/PIL/", "/fontTools/", "/lxml/", "/jinja2/"),
    "storage": ("/zarr/", "/numcodecs/", "/xarray/", "/netCDF4/", "/google_crc32c/", "/checksums.py", "/chunks.py"),
    "statistics": ("/scipy/stats/", "/statistics.py", "/sobol_indices.py", "/bootstrap.py"),
    "equations and code": ("/sympy/", "/numba/", "/llvmlite/", "/mpmath/"),
    "NumPy and SciPy": ("/numpy/", "/scipy/"),
}
"""Parts of the names of files by what they are for; the first that fits counts."""


def place_of(file: str, kernels: str) -> str:
    """Return what a file is for.

    Args:
        file: Its name; that of a builtin is ``~``.
        kernels: Folder of the kernels' sources.
    """
    if file.startswith(kernels):
        return KERNELS
    return next((place for place, parts in PLACES.items() if any(part in file for part in parts)), REST)


def by_place(stats: pstats.Stats, kernels: str) -> dict[str, float]:
    """Return seconds by what they were spent for; those of a builtin are those of whoever called it."""
    seconds: dict[str, float] = dict.fromkeys((KERNELS, *PLACES, REST), 0.0)
    for (file, _, _), (_, _, own, _, callers) in stats.stats.items():  # type: ignore[attr-defined]
        if file != "~" or not callers:
            seconds[place_of(file, kernels)] += own
            continue
        for (caller, _, _), (_, _, part, _) in callers.items():
            seconds[place_of(caller, kernels)] += part
    return seconds


def shares(profiled: Mapping[str, float], total: float) -> dict[str, float]:
    """Return shares of the time without the profiler, which slows down all but the kernels."""
    in_python = sum(profiled.values()) - profiled[KERNELS]
    remaining = max(0.0, total - profiled[KERNELS])
    scaled = {place: seconds * remaining / in_python / total for place, seconds in profiled.items()}
    return scaled | {KERNELS: min(1.0, profiled[KERNELS] / total)}


def work(command: str, folder: Path) -> Callable[[], object]:
    """Return a command, to be run in this process: imports are done, and so is what is no part of it."""
    console = Console(quiet=True)
    if command != "trace":
        from harness.api.study import read_study

        study = read_study(Path(f"studies/{command}.toml"))
        return lambda: study.run(folder / "out", 1).report()
    from bench.attribution.run import Case, Tracer, written
    from harness.diagnosis.report.report import report
    from harness.diagnosis.run import run_trace

    case = Case(CASE, 0, folder / "case")
    written(case)
    task, augmented = Tracer(threads=1).model(case.folder)

    def trace() -> None:
        outcome = run_trace(task, folder / "out", console, augmented)
        report(outcome, "").write(folder / "out")

    return trace


def once(command: str, profiled: bool) -> None:
    """Run a command in this process, and print seconds of the processor, by place where it is profiled."""
    from harness.common.cache import cache_folder

    with tempfile.TemporaryDirectory() as folder:
        run, profile = work(command, Path(folder)), cProfile.Profile(time.process_time)
        begin = time.process_time()
        if profiled:
            profile.runcall(run)
        else:
            run()
        total = time.process_time() - begin
    print(
        json.dumps({"total": total, "places": by_place(pstats.Stats(profile), str(cache_folder())) if profiled else {}})
    )


def main() -> None:
    """Run each command warm, then without and with the profiler, and print a table."""
    parser = Parser(prog="python -m bench.shares", description=__doc__)
    parser.add_argument("--only", nargs="+", choices=COMMANDS, default=COMMANDS, help="some of the commands")
    parser.add_argument("--once", choices=COMMANDS, help=argparse.SUPPRESS)
    parser.add_argument("--profiled", action="store_true", help=argparse.SUPPRESS)
    given = parser.parse_args()
    if given.once:
        once(given.once, given.profiled)
        return
    print(
        f"| command | s | {KERNELS} | " + " | ".join((*PLACES, REST)) + " |", "|" + "---|" * (len(PLACES) + 4), sep="\n"
    )
    for command in given.only:
        _, plain, seen = (_in_a_process(command, *flag) for flag in ((), (), ("--profiled",)))  # the first compiles
        time_shares = shares(seen["places"], plain["total"])
        cells = " | ".join(f"{100 * time_shares[place]:.1f} %" for place in (KERNELS, *PLACES, REST))
        print(f"| {command} | {plain['total']:.1f} | {cells} |", flush=True)


def _in_a_process(command: str, *flags: str) -> dict[str, Any]:
    done = subprocess.run(
        [sys.executable, "-m", "bench.shares", "--once", command, *flags], capture_output=True, text=True, check=True
    )
    return dict(json.loads(done.stdout.splitlines()[-1]))


if __name__ == "__main__":
    main()
