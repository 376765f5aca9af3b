"""One case: written, and traced as ``harness trace`` does it.

Whatever is there already is kept, and the fits of an interrupted trace are, so a run goes on where it stopped.
"""

from __future__ import annotations

import signal
import traceback
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

from rich.console import Console

from bench.attribution.score import FAILED
from bench.foreign.cases import CASES, DRIVES, TRUTH, write_case
from harness.api.model import model
from harness.api.recordings import read_recording
from harness.common.errors import ModelError, UserError
from harness.common.files import write_files
from harness.diagnosis.run import TraceTask, run_trace
from harness.identification.data import step_of
from harness.identification.measured_file import finely, fitted_parameters

TRACE = Path("trace") / "trace.json"
"""In a case's folder."""


def run_case(name: str, folder: Path, threads: int | None = None) -> str:
    """Do what is left of a case; return what went wrong, or nothing.

    A trace that ends in an error is a wrong answer, so that is noted in the folder.

    Args:
        name: Of the case.
        folder: Of the case.
        threads: Of the trace; all cores by default.
    """
    if not (folder / TRUTH).exists():
        write_case(CASES[name], folder)
    if (folder / TRACE).exists():
        return ""
    try:
        run_trace(task_of(folder, threads), folder / TRACE.parent, Console(quiet=True))
    except Exception as error:  # one broken case must not end the run of all
        is_refusal = isinstance(error, UserError | ModelError)
        write_files(folder, {FAILED: str(error) if is_refusal else traceback.format_exc()})
        return str(error)
    (folder / FAILED).unlink(missing_ok=True)
    return ""


def task_of(folder: Path, threads: int | None = None) -> TraceTask:
    """Return what is to be traced in a folder: two drives to fit, one held out; the truth is not read."""
    drives = [read_recording(folder / f"{name}.csv", folder / "map.toml") for name in DRIVES]
    table, notes = model("semitrailer", folder / "nominal.toml").completed(drives)
    spec = finely(table, step_of(drives[0]), str(folder))
    return TraceTask(spec, drives[:2], drives[2:], fitted_parameters(spec, [], "free"), (), jobs=threads, notes=notes)


def run_all(names: Sequence[str], out: Path, processes: int) -> Iterator[tuple[str, str]]:
    """Run cases, and yield each with what went wrong as it ends.

    Args:
        names: Of the cases.
        out: Holds a folder for each.
        processes: With one, a trace takes all cores; with more, each traces with one thread.
    """
    if processes == 1:
        yield from ((name, run_case(name, out / name)) for name in names)
        return
    with ProcessPoolExecutor(processes, get_context("spawn"), _begin) as pool:
        pending = {pool.submit(run_case, name, out / name, 1): name for name in names}
        try:
            yield from ((pending[done], done.result()) for done in as_completed(pending))
        except BaseException:
            pool.shutdown(wait=False, cancel_futures=True)
            raise


def _begin() -> None:
    signal.signal(signal.SIGINT, signal.SIG_DFL)  # an interrupt ends the process at once, without its own traceback
