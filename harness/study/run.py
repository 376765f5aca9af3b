"""Run a study: compile, and evaluate the units that are not in the store yet.

Units run in threads, because the kernels release the GIL, or on the workers of a cluster (``harness.study.cluster``).
Whoever evaluates a unit writes its scores, each unit to chunks of its own, so neither the number of workers nor an
interruption changes a bit of the store. Kernels are compiled before the first unit, in further processes where several
are missing. Models are built when the first unit needs them: a finished study does not.
"""

from __future__ import annotations

import errno
import json
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import cache, partial
from pathlib import Path
from typing import TYPE_CHECKING, Protocol

import joblib
import numpy as np
import xarray as xr
from rich.console import Console
from rich.progress import MofNCompleteColumn, ProgressColumn, Task, TextColumn, TimeRemainingColumn
from rich.text import Text

from harness.common.errors import WorkError
from harness.common.files import write_files
from harness.common.lock import Lock, locked
from harness.common.places import reached
from harness.common.process import peak_memory_mib
from harness.common.stages import bar
from harness.config import HistorySpec, StudySpec
from harness.config.specs import Device
from harness.engine.further_processes import Compiles, compile_all
from harness.runner.contract import Batch
from harness.runner.scores import Scores
from harness.study import devices, run_file
from harness.study.checksums import described
from harness.study.design import Unit, planned_runs, units
from harness.study.devices import device
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case
from harness.study.sealed_root import is_there
from harness.study.store import STORE, Store, discard, discardable

if TYPE_CHECKING:
    from distributed import Client

    from harness.study.plan import Plan


_WORTH = 3
"""Missing kernels for each further process: its start takes as long as the compilation of one.

On a card a kernel takes several times as long, so each is worth a process.
"""


class CompilesStudy(Compiles, Protocol):
    """What kernels are compiled of: ``StudyEvaluator``, or that of a device."""

    @property
    def study(self) -> StudySpec:
        """The study."""


def compile_kernels(evaluator: CompilesStudy, processes: int, say: Callable[[str], None]) -> None:
    """Compile the kernels of a study, or load them from the cache.

    Args:
        evaluator: The study.
        processes: That may work at a time, this one included.
        say: Receives what is being done, in words.
    """
    study = evaluator.study

    def further(missing: int) -> int:
        return min(processes - 1, missing // _WORTH if study.device == "cpu" else missing - 1)

    compile_all(evaluator, partial(_evaluator, study), further, say)


def _evaluator(study: StudySpec) -> Compiles:
    evaluator = StudyEvaluator(study)
    return evaluator if study.device == "cpu" else device(study.device).evaluator(evaluator)


_FULL = (errno.ENOSPC, getattr(errno, "EDQUOT", errno.ENOSPC))


class _Rate(ProgressColumn):
    """Runs per second since the start; those found in the store do not count."""

    def __init__(self, stored: int) -> None:
        super().__init__()
        self._stored = stored

    def render(self, task: Task) -> Text:
        done, elapsed = task.completed - self._stored, task.finished_time or task.elapsed
        return Text(f"{done / elapsed:.0f} runs/s" if done and elapsed else "", style="progress.data.speed")


Agree = Callable[[str], None]
"""Takes what a large run costs, in words, and raises an error to keep it from beginning."""


def run_study(
    study: StudySpec,
    out: Path,
    jobs: int | None = None,
    console: Console | None = None,
    client: Client | None = None,
    agree: Agree | None = None,
    restart: bool = False,
    device: Device = "cpu",
) -> Path:
    """Run a study to the end; ``harness.study.report`` writes what it says.

    Args:
        study: The study.
        out: Result folder. A result of the same study there is continued, and mended where files of it are missing or
            damaged; another study's is left alone.
        jobs: Worker threads; by default one per core.
        console: Where the plan and progress are shown; by default stderr.
        client: Of the Dask cluster whose workers run the study in place of threads.
        agree: Asked before anything is computed that takes above an hour or 10 GB; nobody is by default.
        restart: Throw away the result that is in the folder, whatever study it is of, once this one has begun to run.
        device: ``cuda`` computes the scores on a graphics card (docs/gpu.md). A result is continued on what began it.

    Returns:
        The result folder.

    Raises:
        UserError: If the folder holds another study's result or is being written by another process, a worker of the
            cluster does not fit, or there is no card to run on.
        WorkError: If the disk is full.
        ClusterFailure: If the cluster fails.
    """
    console = console or Console(stderr=True)
    if device != "cpu":
        devices.device(device).check()
        study = replace(study, device=device)
    with reached(out), locked(out, f"harness run of the study '{study.name}'", partial(_say, console)) as lock:
        if not lock.is_kept:
            _say(console, f"{out}: its file system has no locks; see that nobody else writes there", "yellow")
        if restart:
            discardable(out)
        try:
            _run(study, out, jobs, console, client, agree, lock, restart)
        except OSError as error:
            if error.errno not in _FULL:
                raise
            raise WorkError(
                f"{out}: {error.strerror}; finished runs are kept: make room, and the same command continues from there"
            ) from error
    return out


def _run(
    study: StudySpec,
    out: Path,
    jobs: int | None,
    console: Console,
    client: Client | None,
    agree: Agree | None,
    lock: Lock,
    restart: bool,
) -> None:
    started, begin = datetime.now(UTC), time.perf_counter()

    @cache
    def evaluator() -> StudyEvaluator:
        with console.status("building models and drives"):
            return StudyEvaluator(study)

    with console.status("looking at what is there"):
        store = Store(study, evaluator, out, mend=True) if is_there(out / STORE) and not restart else None
    if store is not None and store.mended:
        _say(console, f"{store.path}: {described(store.mended)}; what is lost is computed again", "yellow")
    total, workers = sum(planned_runs(study, d) for d in study.designs), jobs or joblib.cpu_count()
    if client is not None:
        workers = sum(client.ncores().values())
    todo = [u for d in study.designs for u in units(study, d) if store is None or not store.was_done(u)]
    to_do = sum(u.runs(study) for u in todo)
    if store is not None and to_do < total:
        console.print(f"{total - to_do:,} of {total:,} runs are in {store.path} already")
    if todo:
        if client is not None:
            from harness.study import cluster

            cluster.check_workers(client, study, out, console)
        from harness.study.compiled_study import asked_too_much

        for sentence in asked_too_much(study, evaluator().compiled):
            _say(console, sentence, "yellow")
        plan = _plan(evaluator(), todo, workers, console, agree)
        compiled = time.perf_counter()
        if restart:  # only now: models, drives and estimators have shown that they work
            _say(console, discard(out), "yellow")
        store = store or Store(study, evaluator, out)
        evaluator().lost()  # of the plan's first runs, which are computed once more
        _evaluate(evaluator(), store, todo, total, plan, console, client, lock)
        seconds = time.perf_counter() - compiled
        lost = _lost(evaluator(), console)
        record = {
            "started": started.isoformat(timespec="seconds"),
            "jobs": workers,
            **({} if study.device == "cpu" else {"device": devices.device(study.device).name()}),
            "runs": to_do,
            "resumed": total - to_do,
            "compile_s": round(compiled - begin, 2),
            "duration_s": round(seconds, 2),
            "runs_per_s": round(to_do / seconds, 1),
            **({run_file.LOST: lost} if lost else {}),
        }
        if client is None and (peak := peak_memory_mib()) is not None:
            record["peak_memory_mib"] = peak
        write_files(out, {run_file.FILE: json.dumps(record, indent=1) + "\n"})
    assert store is not None
    if todo or not store.has_histories:
        store.write_histories(histories(evaluator()))
    lock.check()
    store.consolidate()
    if study.bound:
        from harness.study import bound

        with console.status("computing the smallest errors possible"):
            bound.write(evaluator(), out)
    if study.rare_event is not None:
        from harness.study import rare_event

        with console.status("subset simulation of the rare event"):
            rare_event.write(evaluator(), out, workers)


def _lost(evaluator: StudyEvaluator, console: Console) -> str:
    """Say which runs foreign code lost, and return it; those that a plant lost are tried again by the next run."""
    sentences = evaluator.lost()
    for sentence in sentences:
        _say(console, sentence, "yellow")
    return "; ".join(sentences)


def _plan(evaluator: StudyEvaluator, todo: Sequence[Unit], workers: int, console: Console, agree: Agree | None) -> Plan:
    """Compile, say what is left to do and what it takes, ask where that is much, and return it."""
    from harness.study import plan

    study = evaluator.study
    if study.device != "cpu" or plan.is_too_large_to_time(study):
        planned = plan.of(study, None, todo, workers)
        _ask(planned, console, agree)
        if study.device == "cpu":
            _warm_up(evaluator, workers, console)
        return planned
    _warm_up(evaluator, workers, console)
    with console.status("timing the first runs"):
        planned = plan.of(study, evaluator, todo, workers)
    _ask(planned, console, agree)
    return planned


def _ask(planned: Plan, console: Console, agree: Agree | None) -> None:
    _say(console, str(planned))
    if planned.is_large and agree is not None:
        agree(str(planned))


def _say(console: Console, words: str, style: str = "") -> None:
    console.print(Text(words, style=style), soft_wrap=True)


def _warm_up(evaluator: StudyEvaluator, workers: int, console: Console) -> None:
    with console.status("compiling kernels (only the first start takes long)") as status:
        compile_kernels(evaluator, min(workers, joblib.cpu_count()), status.update)


def _evaluate(
    evaluator: StudyEvaluator,
    store: Store,
    todo: Sequence[Unit],
    total: int,
    plan: Plan,
    console: Console,
    client: Client | None,
    lock: Lock,
) -> None:
    """Evaluate units in threads or on a cluster, and show progress."""
    study, to_do = evaluator.study, sum(u.runs(evaluator.study) for u in todo)
    if study.device != "cpu":
        finished = _on_device(evaluator, store, todo, console)
    elif client is None:
        finished = _in_threads(evaluator, store, todo, plan.workers)
    else:
        from harness.study import cluster

        each = None if plan.seconds is None else plan.seconds * min(plan.workers, len(todo)) / len(todo)
        finished = cluster.evaluate(client, study, store.folder, todo, console, each, evaluator.losses)
    columns = MofNCompleteColumn(), _Rate(total - to_do), TextColumn("left"), TimeRemainingColumn()
    with bar(console, *columns, transient=False) as progress:
        task = progress.add_task(study.name, total=total, completed=total - to_do)
        for unit in finished:
            progress.advance(task, unit.runs(study))
            lock.check()


def _on_device(evaluator: StudyEvaluator, store: Store, todo: Sequence[Unit], console: Console) -> Iterator[Unit]:
    """Evaluate units on the device of the study; return each when it is in the store."""
    with console.status("compiling kernels for the card (only the first start takes long)") as status:
        elsewhere = devices.device(evaluator.study.device).evaluator(evaluator)
        compile_kernels(elsewhere, joblib.cpu_count(), status.update)
    for unit, result in elsewhere.evaluate(todo):
        store.write(unit, result)
        yield unit


def _in_threads(evaluator: StudyEvaluator, store: Store, todo: Sequence[Unit], jobs: int) -> Iterator[Unit]:
    """Evaluate units in threads; return each when it is in the store."""

    def work(unit: Unit) -> Unit:
        store.write(unit, evaluator.evaluate(unit))
        return unit

    jobs = min(jobs, len(todo))
    parallel = joblib.Parallel(n_jobs=jobs, backend="threading", return_as="generator_unordered", batch_size=1)
    finished: Iterator[Unit] = parallel(joblib.delayed(work)(unit) for unit in todo)
    return finished


def histories(evaluator: StudyEvaluator) -> list[xr.Dataset]:
    """Return the runs a study wants drawn over time.

    Where the plant lacks a signal its truth is NaN; so is an estimate from its divergence on, and everything from
    where the plant leaves its range.
    """
    return [_history(evaluator, wanted) for wanted in evaluator.study.history]


def _history(evaluator: StudyEvaluator, wanted: HistorySpec) -> xr.Dataset:
    study, compiled = evaluator.study, evaluator.compiled
    names = [d.name for d in study.drives]
    design = next(i for i, d in enumerate(study.designs) if d.name == wanted.design)
    unit = Unit(design, wanted.band, names.index(wanted.drive), wanted.sample, wanted.sample + 1)
    case = [Case(wanted.sample, wanted.repeat)]
    batch, believed = evaluator.simulate(unit, case), evaluator.held(unit, case, "belief")
    runs = [evaluator.estimate(e, unit, case, batch, believed, keep=True) for e in range(len(compiled.estimators))]
    shown = list(dict.fromkeys([*study.targets, *study.belief.unknown_inputs, *wanted.signals]))
    truth, kept, gone = _over_time(evaluator, shown, batch, runs)
    drive = compiled.drives[unit.drive]
    dataset = xr.Dataset(
        {
            "truth": (("time", "target"), truth),
            "estimate": (("time", "estimator", "target"), kept[:, :, 0]),
            "std": (("time", "estimator", "target"), kept[:, :, 1]),
        },
        coords={
            "time": drive.profile.time,
            "estimator": [e.name for e in study.estimators],
            "target": shown,
        },
    )
    measurements = compiled.measured(batch.measurements)
    for i, output in enumerate(compiled.belief.model.outputs):
        if output in shown:  # sensors name an output after what it measures
            values = np.where(gone, np.nan, measurements[:, i, 0])
            dataset[f"measured_{output}"] = ("time", values, {"variance": believed.measurement_noise[i, 0]})
    stated = [e.has_covariance for e in compiled.estimators]
    dataset["std"] = dataset["std"].where(xr.DataArray(stated, dims="estimator"))
    for i, name in enumerate(evaluator.study.plant.model().inputs):
        dataset[f"input_{name}"] = ("time", drive.plant[:, i, 0])
    rmse = {
        e.name: {t: float(r.rmse[i, 0]) for i, t in enumerate(study.targets)}
        for e, r in zip(study.estimators, runs, strict=True)
    }
    dataset.attrs = {
        "name": wanted.name,
        "design": wanted.design,
        "band_label": study.designs[design].band_labels[wanted.band],
        "drive": wanted.drive,
        "repeat": wanted.repeat,
        "rmse": rmse,
    }
    return dataset


def _over_time(
    evaluator: StudyEvaluator, shown: list[str], batch: Batch, runs: list[Scores]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return truth ``(samples, shown)``, estimates and deviations ``(samples, estimator, 2, shown)``, and what is gone.

    The last is true from the sample on at which the plant leaves its range.
    """
    compiled = evaluator.compiled
    truth = np.full((len(batch.truth), len(shown)), np.nan)
    for i, name in enumerate(shown):
        if name in compiled.truth_names:
            truth[:, i] = batch.truth[:, compiled.truth_names.index(name), 0]
    places = [compiled.signals.index(name) for name in shown]
    kept = np.stack([r.kept[:, :, places, 0] for r in runs if r.kept is not None], axis=1)
    sample = np.arange(len(kept))[:, None]
    gone = sample[:, 0] >= batch.left_at[0]
    kept[(sample >= [r.diverged_at[0] for r in runs]) | gone[:, None]] = np.nan
    truth[gone] = np.nan
    return truth, kept, gone
