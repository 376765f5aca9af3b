"""Time of many short runs beside their kernels: ``python -m bench.scale --run`` and ``--dask``.

Each run of a study is a process of its own. The system says what it took, killed or not; the process itself times every
sixteenth call of a kernel, because to look at the clock takes as long as a part of what is looked at.
"""

from __future__ import annotations

import json
import os
import shutil
import signal
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from rich.console import Console
from rich.table import Table

from harness.config import StudySpec, load_study
from harness.engine import standard_normal
from harness.study import checksums, evaluate, run
from harness.study.cluster import connected
from harness.study.design import Unit, units
from harness.study.evaluate import StudyEvaluator
from harness.study.store import STORE, place_of

EVERY = 16
"""Calls of a kernel of which one is timed."""


@dataclass(frozen=True)
class Session:
    """What one process took.

    Attributes:
        runs: Runs that it added to the store.
        seconds: From its start to its end.
        processor: s of all its threads.
        memory: The most that it held, in MiB.
        start: s of processor time before its first unit.
        kernels: s of processor time in simulations and estimators.
        noise: s of processor time in which noise was drawn.
    """

    runs: int
    seconds: float
    processor: float
    memory: int
    start: float
    kernels: float
    noise: float


class _Clock:
    """Processor time of compiled functions, from a part of their calls."""

    def __init__(self) -> None:
        self.times: dict[str, list[float]] = {"kernels": [], "noise": []}
        self.start = 0.0
        self._first = threading.Lock()

    def timed(self, name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        """Return the function, timed."""
        calls, times = [0], self.times[name]

        def call(*args: Any) -> Any:
            calls[0] += 1
            if calls[0] % EVERY:
                return function(*args)
            begin = time.thread_time()
            result = function(*args)
            times.append(time.thread_time() - begin)
            return result

        return call

    def evaluator(self, study: StudySpec) -> StudyEvaluator:
        """Return the evaluator of a study whose kernels are timed from its first unit on, when all are compiled."""
        made = StudyEvaluator(study)
        real: Any = made.evaluate

        def evaluate(unit: Unit) -> Any:
            with self._first:
                if not self.start:
                    self.start = time.process_time()
                    self._watch(made)
            return real(unit)

        made.evaluate = evaluate  # type: ignore[method-assign]
        return made

    def _watch(self, made: StudyEvaluator) -> None:
        simulator: Any = made.compiled.simulator
        record = made.compiled.recorded
        simulator.loops[record.names] = self.timed("kernels", simulator.loop(record))
        estimators: list[Any] = list(made.compiled.estimators)
        for each in estimators:
            timed = self.timed("kernels", each.loop)
            each._kernels = SimpleNamespace(**{**vars(each._kernels), "estimate": timed})
        drawn = SimpleNamespace(fill=self.timed("noise", standard_normal._compiled().fill))
        standard_normal._compiled = lambda: drawn


def one_session(folder: Path, jobs: int) -> None:
    """Run the study of a folder to its end and write what the kernels took; runs in a process of its own."""
    clock = _Clock()
    evaluate.StudyEvaluator = clock.evaluator  # type: ignore[assignment, misc]
    run.run_study(load_study(folder / "scale.toml"), folder, jobs, Console(stderr=True))
    spent = {name: EVERY * sum(times) for name, times in clock.times.items()}
    (folder / "kernels.json").write_text(
        json.dumps({**spent, "start": clock.start or time.process_time()}), encoding="utf-8"
    )


def session(folder: Path, jobs: int, stop_at: int | None = None) -> Session:
    """Run the study of a folder in a process of its own; kill it once so many runs are in the store."""
    (folder / "kernels.json").unlink(missing_ok=True)
    before = _done(folder)
    command = [sys.executable, "-c", "from harness.common.process import collect_rarely; collect_rarely(); "
               "import sys; from pathlib import Path; from bench.short_runs import one_session; "
               "one_session(Path(sys.argv[1]), int(sys.argv[2]))", str(folder), str(jobs)]  # fmt: skip
    # As a user has it: modules are compiled once and kept.
    environment = {name: value for name, value in os.environ.items() if name != "PYTHONDONTWRITEBYTECODE"}
    begin = time.perf_counter()
    process = subprocess.Popen(command, env=environment)
    if stop_at is not None:
        _wait_for(folder, stop_at, process.pid)
        os.kill(process.pid, signal.SIGKILL)  # it may have ended; not waited for yet, its number is still its own
    _, status, used = os.wait4(process.pid, 0)
    seconds = time.perf_counter() - begin
    process.returncode = os.waitstatus_to_exitcode(status)
    if process.returncode not in ((0,) if stop_at is None else (0, -signal.SIGKILL)):
        raise SystemExit(f"the run of {folder} ended with {process.returncode}; the same command goes on")
    path, spent = folder / "kernels.json", {"start": 0.0, "kernels": 0.0, "noise": 0.0}
    if path.exists():
        spent |= json.loads(path.read_text(encoding="utf-8"))
    return Session(_done(folder) - before, seconds, used.ru_utime + used.ru_stime, used.ru_maxrss // 1024, **spent)


def _wait_for(folder: Path, runs: int, process: int) -> None:
    """Wait until so many runs are in the store, or a process has ended; to look takes a twentieth of a core at most."""
    while True:
        begin = time.perf_counter()
        ended = os.waitid(os.P_PID, process, os.WEXITED | os.WNOHANG | os.WNOWAIT)
        if ended is not None or _done(folder) >= runs:
            return
        time.sleep(20.0 * (time.perf_counter() - begin))


def _done(folder: Path) -> int:
    """Return how many runs of the study in a folder are in its store."""
    study = load_study(folder / "scale.toml")
    there = checksums.finished(folder / STORE, study.designs[0].name) if (folder / STORE).exists() else {}
    return sum(u.runs(study) for u in units(study, study.designs[0]) if place_of(study, u) in there)


def measure(folder: Path, jobs: int, console: Console) -> None:
    """Run a study in one go, again once it is finished, and once more with the process killed in the middle.

    Args:
        folder: Holds ``scale.toml``; runs that are in its store are left as they are.
        jobs: Threads.
        console: Where the figures are shown.
    """
    whole = session(folder, jobs)
    again = session(folder, jobs)
    console.print(_table({"in one go": whole, "again, finished": again}))
    if not whole.runs:
        return
    share, noise = whole.kernels / whole.processor, whole.noise / whole.processor
    console.print(
        f"Kernels take {share:.0%} of the processor time, drawing noise {noise:.0%}, all else {1 - share - noise:.0%}; "
        f"the same command on the finished store {again.processor / whole.processor:.1%} of it."
    )
    other = folder / "interrupted"
    shutil.rmtree(other, ignore_errors=True)
    other.mkdir()
    shutil.copy(folder / "scale.toml", other)
    killed = session(other, jobs, stop_at=whole.runs // 2)
    ended = session(other, jobs)
    console.print(_table({"killed half-way": killed, "continued": ended}))
    both = killed.processor + ended.processor
    console.print(
        f"Killed and continued: {both / whole.processor - 1:+.1%} of the processor time. Before its first unit "
        f"the second process took {ended.start:.1f} s, {ended.start / whole.processor:.1%}; "
        f"that of one go took {whole.start:.1f} s."
    )


def _table(sessions: Mapping[str, Session]) -> Table:
    table = Table("", "runs", "time s", "processor s", "before the first unit s", "kernels s", "noise s", "memory MiB")
    for name, each in sessions.items():
        numbers = each.seconds, each.processor, each.start, each.kernels, each.noise
        table.add_row(name, f"{each.runs:,}", *(f"{n:.1f}" for n in numbers), f"{each.memory:,}")
    return table


def against_dask(folder: Path, jobs: int, rounds: int, console: Console) -> None:
    """Run a study in threads and by as many Dask workers, in turn, and compare their processor time.

    Where others use the cores as well, the time by the clock says little. Of both ways the least counts.

    Args:
        folder: Holds ``scale.toml``.
        jobs: Threads, and workers.
        rounds: Runs of each.
        console: Where the figures are shown.
    """
    study = load_study(folder / "scale.toml")
    rates: dict[str, list[float]] = {"threads": [], "Dask workers": []}
    processor: dict[str, list[float]] = {name: [] for name in rates}
    with connected(None, jobs) as client:

        def used() -> float:
            return time.process_time() + sum(client.run(time.process_time).values())

        for _ in range(rounds):
            for name, by in (("threads", None), ("Dask workers", client)):
                shutil.rmtree(folder / "one", ignore_errors=True)
                before = used()
                run.run_study(study, folder / "one", jobs, Console(stderr=True), by)
                processor[name].append(used() - before)
                rates[name].append(json.loads((folder / "one" / "run.json").read_text(encoding="utf-8"))["runs_per_s"])
    for name in rates:
        spent, by_clock = (", ".join(f"{r:,.1f}" for r in each[name]) for each in (processor, rates))
        console.print(f"{jobs} {name}: processor s {spent}; runs/s by the clock {by_clock}")
    least = {name: min(each) for name, each in processor.items()}
    console.print(f"By processor time Dask has {least['threads'] / least['Dask workers']:.0%} of the threads' rate.")
