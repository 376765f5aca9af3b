"""Run a study: compile, and evaluate the units that are not in the store yet.

Units run in threads, because the kernels release the GIL, or on the workers of a cluster (``harness.study.cluster``).
Whoever evaluates a unit writes its scores, each unit to chunks of its own, so neither the number of workers nor an
interruption changes a bit of the store.
"""

from __future__ import annotations

import json
import time
from collections.abc import Iterator, Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING

import joblib
from rich.console import Console
from rich.progress import (
    BarColumn,
    MofNCompleteColumn,
    Progress,
    ProgressColumn,
    SpinnerColumn,
    Task,
    TextColumn,
    TimeRemainingColumn,
)
from rich.text import Text

from harness.common.process import peak_memory_mib
from harness.config import Study
from harness.study.checksums import described
from harness.study.design import Unit, units
from harness.study.evaluate import StudyEvaluator
from harness.study.histories import histories
from harness.study.store import Store

if TYPE_CHECKING:
    from distributed import Client

RUN_FILE = "run.json"


class _Rate(ProgressColumn):
    """Runs per second since the start; those found in the store do not count."""

    def __init__(self, found: int) -> None:
        super().__init__()
        self._found = found

    def render(self, task: Task) -> Text:
        done, elapsed = task.completed - self._found, task.finished_time or task.elapsed
        return Text(f"{done / elapsed:.0f} runs/s" if done and elapsed else "", style="progress.data.speed")


def run_study(
    study: Study,
    out: Path,
    jobs: int | None = None,
    console: Console | None = None,
    client: Client | None = None,
) -> Path:
    """Run a study to the end; ``harness.study.report`` writes what it says.

    Args:
        study: The study.
        out: Result folder. A result of the same study there is continued, and mended where files of it are missing or
            damaged; another study's is left alone.
        jobs: Worker threads; by default one per core.
        console: Where progress is shown; by default stderr.
        client: Of the Dask cluster whose workers run the study in place of threads.

    Returns:
        The result folder.

    Raises:
        UserError: If the folder holds another study's result, or a worker of the cluster does not fit.
        ClusterFailure: If the cluster fails.
    """
    console = console or Console(stderr=True)
    started = datetime.now(UTC)
    begin = time.perf_counter()
    with console.status("building models and drives"):
        evaluator = StudyEvaluator(study)
        store = Store(study, evaluator, out, mend=True)
    if store.mended:
        console.print(
            Text(f"{store.path}: {described(store.mended)}; what is lost is computed again", style="yellow"),
            soft_wrap=True,
        )
    everything = [u for d in study.designs for u in units(study, d)]
    todo = [u for u in everything if not store.was_done(u)]
    total, left = (sum(u.runs(study) for u in some) for some in (everything, todo))
    if left < total:
        console.print(f"{total - left} of {total} runs are in {store.path} already")
    if todo:
        _warm_up(evaluator, console)
        compiled = time.perf_counter()
        workers = _evaluate(evaluator, store, todo, total, jobs or joblib.cpu_count(), console, client)
        seconds = time.perf_counter() - compiled
        record = {
            "started": started.isoformat(timespec="seconds"),
            "jobs": workers,
            "runs": left,
            "resumed": total - left,
            "compile_s": round(compiled - begin, 2),
            "duration_s": round(seconds, 2),
            "runs_per_s": round(left / seconds, 1),
        }
        if client is None and (peak := peak_memory_mib()) is not None:
            record["peak_memory_mib"] = peak
        (out / RUN_FILE).write_text(json.dumps(record, indent=1) + "\n", encoding="utf-8")
    if todo or not store.has_histories:
        store.write_histories(histories(evaluator))
    store.consolidate()
    return out


def _warm_up(evaluator: StudyEvaluator, console: Console) -> None:
    with console.status("compiling kernels (only the first start takes long)") as status:
        for i in range(evaluator.kernels):
            status.update(f"compiled {evaluator.warm_up(i)}; {evaluator.kernels - 1 - i} to go")


def _evaluate(
    evaluator: StudyEvaluator,
    store: Store,
    todo: Sequence[Unit],
    total: int,
    jobs: int,
    console: Console,
    client: Client | None,
) -> int:
    """Evaluate units in threads or on a cluster, show progress, and return how many were at work at a time."""
    study, left = evaluator.study, sum(u.runs(evaluator.study) for u in todo)
    if client is None:
        finished = _in_threads(evaluator, store, todo, jobs)
    else:
        from harness.study import cluster

        cluster.check_workers(client, study, store.folder, console)
        jobs = sum(client.ncores().values())
        finished = cluster.evaluate(client, study, store.folder, todo, console)
    columns = (
        SpinnerColumn(), TextColumn("{task.description}"), BarColumn(), MofNCompleteColumn(), _Rate(total - left),
        TextColumn("left"), TimeRemainingColumn(),
    )  # fmt: skip
    with Progress(*columns, console=console) as progress:
        task = progress.add_task(study.name, total=total, completed=total - left)
        for unit in finished:
            progress.advance(task, unit.runs(study))
    return jobs


def _in_threads(evaluator: StudyEvaluator, store: Store, todo: Sequence[Unit], jobs: int) -> Iterator[Unit]:
    """Evaluate units in threads; return each when it is in the store."""

    def work(unit: Unit) -> Unit:
        store.write(unit, evaluator.evaluate(unit))
        return unit

    parallel = joblib.Parallel(n_jobs=jobs, backend="threading", return_as="generator_unordered", batch_size=1)
    finished: Iterator[Unit] = parallel(joblib.delayed(work)(unit) for unit in todo)
    return finished
