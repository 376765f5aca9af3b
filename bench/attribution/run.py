"""One case of the blind plant: written in a process of its own, traced, and the oracle fitted.

Whatever is there already is kept, so an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import json
import signal
import subprocess
import sys
import time
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass, replace
from multiprocessing import get_context
from pathlib import Path
from typing import Any, NamedTuple

from rich.console import Console

from bench.attribution.oracle import FILE, write_oracle
from bench.attribution.score import FAILED, SECONDS
from bench.real.run import trace_case
from harness.common.errors import ModelError, UserError
from harness.common.files import write_files
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.run import TraceTask, augmented_model_of, run_trace
from harness.identification.data import step_of
from harness.identification.measured_file import finely, fitted_parameters
from harness.recordings import load_recording

PLANT = Path(__file__).parents[2] / "tests" / "blind" / "plant.py"

QUALITIES = ("clean", "field", "bus", "real")
"""Of recordings, as the plant writes them; ``real`` is that of the realistic plants (``bench/real``)."""

NOMINAL: dict[str, dict[str, Any]] = {
    "semitrailer": {"parameters": "ziaukas_2023", "tyre": "magic_formula", "sensors": "test_vehicle_inertial"},
    "car": {"parameters": "blanco_2021", "tyre": "linear", "sensors": "car_navigation"},
}
"""The nominal model of each vehicle of the plant. Its values are those that the plant publishes (``belief.json``); the
parameter set gives first variances only, and of the car the reference point in the CoG."""


class Listed(NamedTuple):
    """A case in the plant's list.

    Attributes:
        name: Of the case.
        kind: Of the case.
        first_draw: Number of the first draw of a gate that may choose it.
    """

    name: str
    kind: str
    first_draw: int = 0


@dataclass(frozen=True)
class Case:
    """A case of the plant and where it is.

    Attributes:
        name: From the plant's list.
        repeat: Which draw of it.
        folder: Where it is written, traced and scored.
        quality: Of its recordings.
    """

    name: str
    repeat: int
    folder: Path
    quality: str = "clean"


class Tracer:
    """Writes and traces cases; the model of a vehicle is compiled once.

    Args:
        threads: Of one trace; all cores by default.
    """

    def __init__(self, threads: int | None = None) -> None:
        self._threads = threads
        self._wholes: dict[str, AugmentedModel] = {}

    def run(self, case: Case) -> str:
        """Do what is left of a case; return what went wrong, or nothing.

        A trace that ends in an error is a wrong answer, so that is noted in the folder. A case that the plant could
        not write is no case.
        """
        problem = written(case)
        if problem:
            return problem
        folder = case.folder
        if case.quality == "real":
            return trace_case(folder, self._threads)
        traced, oracle = (folder / "trace" / "trace.json").exists(), (folder / FILE).exists()
        if traced and oracle:
            return ""
        try:
            task, augmented = self.model(folder)
            if not traced:
                self._trace(task, folder, augmented)
            if not oracle:
                write_oracle(folder, task, augmented)
        except Exception as error:  # one broken case must not end the run of hundreds
            is_refusal = isinstance(error, UserError | ModelError)
            write_files(folder, {FAILED: str(error) if is_refusal else traceback.format_exc()})
            return str(error)
        (folder / FAILED).unlink(missing_ok=True)
        return ""

    def _trace(self, task: TraceTask, folder: Path, augmented: AugmentedModel) -> None:
        """Trace a case, and note how long that took where it was begun here and had all cores."""
        begun, whole = time.perf_counter(), not (folder / "trace").exists() and self._threads is None
        run_trace(task, folder / "trace", Console(quiet=True), augmented)
        if whole:
            write_files(folder, {SECONDS: f"{time.perf_counter() - begun:.1f}\n"})

    def model(self, folder: Path) -> tuple[TraceTask, AugmentedModel]:
        """Return what is to be traced in a folder, and its model, compiled."""
        task, vehicle = task_of(folder)
        task = replace(task, jobs=self._threads)
        if vehicle not in self._wholes:
            self._wholes[vehicle] = augmented_model_of(task)
        return task, self._wholes[vehicle]


def written(case: Case) -> str:
    """Have the plant write a case that is not there; return what it says if it cannot. The seal is written last."""
    if (case.folder / "sealed.json").exists():
        return ""
    plant = [*_plant(case.quality), "--case", case.name, "--repeat", str(case.repeat), "--out", str(case.folder)]
    plant += [] if case.quality == "real" else ["--quality", case.quality]
    done = subprocess.run(plant, capture_output=True, text=True, check=False)
    return done.stderr.strip() if done.returncode else ""


def task_of(folder: Path) -> tuple[TraceTask, str]:
    """Return what is to be traced in a folder, and the vehicle; the seal is not read."""
    channels = folder / "channels.toml" if (folder / "channels.toml").exists() else None
    names = ("train_a", "train_b", "test")
    drives = [load_recording(folder / f"{n}.csv", channels, name=n) for n in names]
    belief = json.loads((folder / "belief.json").read_text())
    vehicle = belief["vehicle"]
    table = {"vehicle": vehicle, **NOMINAL[vehicle], "values": belief["parameters"]}
    spec = finely(table, step_of(drives[0]), str(folder))
    return TraceTask(spec, drives[:2], drives[2:], fitted_parameters(spec, [], "free"), ()), vehicle


def run_all(cases: Sequence[Case], processes: int) -> Iterator[tuple[Case, str]]:
    """Run cases, and yield each with what went wrong as it ends.

    Args:
        cases: What to run.
        processes: With one, a trace takes all cores; with more, each traces with one thread.
    """
    if processes == 1:
        tracer = Tracer()
        yield from ((case, tracer.run(case)) for case in cases)
        return
    with ProcessPoolExecutor(processes, get_context("spawn"), _begin) as pool:
        pending = {pool.submit(_run, case): case for case in cases}
        try:
            yield from ((pending[done], done.result()) for done in as_completed(pending))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


_tracer: Tracer
"""Of a process of the pool, which keeps it from case to case."""


def _begin() -> None:
    global _tracer
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # an interrupt ends the process at once, without its own traceback
    _tracer = Tracer(threads=1)


def _run(case: Case) -> str:
    return _tracer.run(case)


def _plant(quality: str) -> list[str]:
    """Return how the plant of a quality is called."""
    return [sys.executable, "-m", "bench.real.plant"] if quality == "real" else [sys.executable, str(PLANT)]


def listed(quality: str = "clean") -> list[Listed]:
    """Return every case of the plant of a quality."""
    done = subprocess.run([*_plant(quality), "--list"], capture_output=True, text=True, check=True)
    lines = (line.split("\t") for line in done.stdout.splitlines())
    return [Listed(name, kind, int(first)) for name, kind, first in lines]
