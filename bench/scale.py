"""Time and memory of studies of millions of runs; ``python -m bench.scale``, with ``--run`` or ``--dask``.

``--runs 10000000`` measures how a store is read: time and memory of its report. The store is as a study leaves it, but
its units are copies of a few that were computed, so that it is made in minutes. The report is written by a process of
its own, whose peak of memory is that of ``harness report``. ``--run`` computes that many runs, and ``--dask`` compares
threads with Dask workers (``bench.short_runs``).
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
import time
from pathlib import Path

from rich.console import Console

from bench.short_runs import against_dask, measure
from harness.common import stores
from harness.common.arguments import Parser
from harness.config import load_study
from harness.study import checksums
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from harness.study.run import histories
from harness.study.store import STORE, Store, place_of

STUDY = """
name = "scale"
targets = ["lateral_velocity"]
[plant]
vehicle = "car"
parameters = "govindarajan_2018"
tyre = "magic_formula"
sensors = "car_series"
[[drive]]
name = "sine"
kind = "sine"
amplitude = "20 deg"
duration = "5 s"
[[drive]]
name = "slow"
kind = "sine"
amplitude = "10 deg"
duration = "5 s"
[[estimator]]
kind = "ekf"
[[design]]
name = "loads"
samples = {samples}
repeats = 5
sobol_any_n = true
factor = [{{ parameter = "mass", levels = ["1.4 t", "1.7 t"], band = "5 %" }}]
"""

COMPUTED = 8
"""Units that are computed; the others are links to their files."""

REPORT = """
import sys
from harness.common.process import peak_memory_mib
from harness.study.report import analyse, headline, write_report
analysis = analyse(sys.argv[1])
print(headline(analysis), write_report(analysis), "peak", peak_memory_mib(), "MiB")
"""


def make(folder: Path, runs: int) -> Path:
    """Write a store of so many runs and return its folder."""
    shutil.rmtree(folder, ignore_errors=True)
    folder.mkdir(parents=True)
    (folder / "scale.toml").write_text(STUDY.format(samples=runs // 20), encoding="utf-8")
    study = load_study(folder / "scale.toml")
    evaluator = StudyEvaluator(study)
    store = Store(study, lambda: evaluator, folder)
    root, design = folder / STORE, study.designs[0]
    about = dict(stores.group(root, checksums.GROUP)[design.name].attrs)
    done: list[list[Path]] = []
    for unit in units(study, design):
        place = place_of(study, unit)
        files = [root / f for f in (*checksums.chunk_files(about, place).values(), checksums.row_file(place))]
        if len(done) < COMPUTED:
            store.write(unit, evaluator.evaluate(unit))
            done.append(files)
            continue
        for here, there in zip(files, done[unit.first % len(done)], strict=True):
            if there.exists():
                here.parent.mkdir(parents=True, exist_ok=True)
                os.link(there, here)
    store.write_histories(histories(evaluator))
    store.consolidate()
    return folder


def main() -> None:
    """Make a store, write its report, and say what that took."""
    parser = Parser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10_000_000)
    what = parser.add_mutually_exclusive_group()
    what.add_argument("--run", action="store_true", help="compute the runs")
    what.add_argument("--dask", action="store_true", help="compute them by threads and by Dask workers")
    parser.add_argument("--jobs", type=int, default=2)
    parser.add_argument("--rounds", type=int, default=3, help="of threads and Dask workers in turn")
    parser.add_argument("--out", type=Path, default=Path("results/scale"))
    parser.add_argument("--keep", action="store_true", help="use the store that is there")
    given = parser.parse_args()
    console = Console(highlight=False, width=200)
    if given.run or given.dask:
        given.out.mkdir(parents=True, exist_ok=True)
        (given.out / "scale.toml").write_text(STUDY.format(samples=given.runs // 20), encoding="utf-8")
        if given.run:
            measure(given.out, given.jobs, console)
        else:
            against_dask(given.out, given.jobs, given.rounds, console)
        return
    if not given.keep:
        make(given.out, given.runs)
    begin = time.perf_counter()
    done = subprocess.run([sys.executable, "-c", REPORT, str(given.out)], capture_output=True, text=True, check=False)
    seconds = time.perf_counter() - begin
    peak = re.search(r"peak (\d+) MiB", done.stdout)
    if peak is None:
        raise SystemExit(done.stderr[-2000:])
    console.print(
        f"{given.runs:,} runs: report in {seconds:.0f} s, at most {int(peak.group(1)):,} MiB", highlight=False
    )


if __name__ == "__main__":
    main()
