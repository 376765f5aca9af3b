"""What a run will take (runs, time from a few timed ones, room on the disk), and how far one is, by its store."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.common import stores
from harness.common.errors import UserError
from harness.common.lock import holder
from harness.common.places import reached
from harness.config import DesignSpec, StudySpec
from harness.engine.simd.lanes import LANES
from harness.study import checksums, run_file, sealed_root
from harness.study.checksums import Fault
from harness.study.design import Unit, unit_shape
from harness.study.evaluate import StudyEvaluator
from harness.study.score_names import ESTIMATOR_DIVERGED, LOST, PENDING, PER_RUN, PER_TARGET, PLANT_DIVERGED, STATUS
from harness.study.verify import store_of

LONG = 3600.0
"""s from which on a run is begun only where somebody agrees."""

LARGE = 10e9
"""Bytes from which on a run is begun only where somebody agrees."""

_TOO_MANY_POINTS = 8e6
"""Numbers that the points of a design may have for it to be laid out, in 20 s, before anybody has agreed."""

_BLOCK = 4096
"""Bytes that the smallest file takes."""


@dataclass(frozen=True)
class Plan:
    """What is left to do.

    Attributes:
        runs: Runs, each with every estimator.
        size: Bytes on the disk, at most.
        seconds: Time that it takes; ``None`` where it has not been estimated.
        workers: How many work at a time.
    """

    runs: int
    size: float
    seconds: float | None
    workers: int

    @property
    def is_large(self) -> bool:
        """Whether somebody should agree first."""
        long = self.runs > _TOO_MANY_POINTS if self.seconds is None else self.seconds > LONG
        return self.size > LARGE or long

    def __str__(self) -> str:
        took = "a time that is not estimated before you agree" if self.seconds is None else in_time(self.seconds)
        each = "" if self.seconds is None else f" with {self.workers} worker{'s' if self.workers > 1 else ''}"
        return f"{self.runs:,} runs to do: {took}{each}, at most {_bytes(self.size)} on disk"


def size_on_disk(study: StudySpec, runs: int, design: DesignSpec) -> float:
    """Return how many bytes the scores of some runs of a design take at most: not compressed, in whole blocks."""
    samples, repeats = unit_shape(study, design)
    own = samples * repeats
    estimators, targets = len(study.estimators), len(study.targets)
    numbers = [8 * estimators * targets] * len(PER_TARGET) + [8 * estimators] * len(PER_RUN) + [estimators, 8]
    unit = sum(-(-own * each // _BLOCK) * _BLOCK for each in numbers) + _BLOCK
    return unit * max(runs / own, 1.0)


def is_too_large_to_time(study: StudySpec) -> bool:
    """Return whether only laying out the points of the first design takes much memory."""
    first = study.designs[0]
    return first.bands * first.samples * max(len(first.factors), 1) > _TOO_MANY_POINTS


def of(study: StudySpec, evaluator: StudyEvaluator | None, todo: Sequence[Unit], workers: int) -> Plan:
    """Return what units take.

    Args:
        study: The study.
        evaluator: Warm; one batch of the first unit is timed, and its scores thrown away. ``None`` estimates no time.
        todo: What is left to do.
        workers: How many work at a time.
    """
    by_design = [0] * len(study.designs)
    for unit in todo:
        by_design[unit.design] += unit.runs(study)
    size = sum(size_on_disk(study, n, d) for n, d in zip(by_design, study.designs, strict=True) if n)
    if evaluator is None or not todo:
        return Plan(sum(by_design), size, None, workers)
    durations = [len(d.profile.time) for d in evaluator.compiled.drives]
    each = evaluator.time_of_batch(todo[0]) / durations[todo[0].drive]
    work = sum(_lanes(unit, study) * durations[unit.drive] for unit in todo)
    return Plan(sum(by_design), size, each * work / max(1, min(workers, len(todo))), workers)


def _lanes(unit: Unit, study: StudySpec) -> int:
    """Return how many batches a unit has."""
    return -(-unit.runs(study) // LANES)


def in_time(seconds: float) -> str:
    """Return a time in words, rounded."""
    for limit, size, word in ((90.0, 1.0, "s"), (90 * 60.0, 60.0, "min"), (48 * 3600.0, 3600.0, "h")):
        if seconds < limit:
            return f"about {max(seconds / size, 1):.0f} {word}"
    return f"about {seconds / 86400:,.0f} days"


def _bytes(size: float) -> str:
    for limit, unit, word in ((1e9, 1e6, "MB"), (1e12, 1e9, "GB")):
        if size < limit:
            return f"{max(size / unit, 1):.0f} {word}"
    return f"{size / 1e12:,.0f} TB"


_RECENT = 64
"""Units, the last that were finished, whose times tell the rate."""


@dataclass
class Count:
    """Runs of one design and estimator.

    Attributes:
        design: Name of the design.
        estimator: Name of the estimator.
        planned: All runs.
        done: Those that have a score or a reason for having none.
        diverged: Done, but the estimator diverged.
        plant_left: Done, but the vehicle went out of control.
        lost: Done, but the code of the plant failed.
    """

    design: str
    estimator: str
    planned: int
    done: int = 0
    diverged: int = 0
    plant_left: int = 0
    lost: int = 0


@dataclass(frozen=True)
class Progress:
    """How far a study is.

    Attributes:
        name: Name of the study.
        counts: By design and estimator.
        planned: All runs, each with every estimator.
        done: Finished ones.
        lost: Files that are missing or damaged; their runs count as missing.
        writer: Who is writing the folder, ``None`` for nobody.
        beside: What is wrong with the files beside the store, in words with the remedy.
        rate: Runs per s of late; ``None`` where nobody is at work or too little is known.
    """

    name: str
    counts: list[Count]
    planned: int
    done: int
    lost: list[Fault]
    writer: str | None
    beside: list[str]
    rate: float | None

    @property
    def left(self) -> float | None:
        """Time until all is done in s, if it is known."""
        return None if self.rate is None else (self.planned - self.done) / self.rate


def progress(folder: Path) -> Progress:
    """Return how far the study in a folder is, whether or not it is being run.

    Raises:
        UserError: If there is no store, or its root is damaged.
    """
    with reached(folder):
        return _progress(folder)


def _progress(folder: Path) -> Progress:
    path = store_of(folder)
    with sealed_root.told_as_no_store(path):
        lost = sealed_root.faults(path)
        name = sealed_root.study_name(path)
        if any(fault.file == "zarr.json" for fault in lost):
            raise UserError(f"{path}: {lost[0]}; 'harness run' with the study '{name}' and '--out {folder}' mends it")
        root: Any = stores.group(path)
        designs = checksums.names(root.attrs["designs"])
    bad = {fault.unit for fault in lost if fault.unit is not None}
    writer = holder(folder)
    counts: list[Count] = []
    planned = done = 0
    finished: list[tuple[float, int]] = []
    for design in designs:
        names = f"{design}/{STATUS}", f"{design}/estimator", f"{checksums.GROUP}/{design}"
        status, estimators, sums = (checksums.opened(path, name) for name in names)
        try:
            own = [Count(design, str(e), int(np.prod(status.shape[:-1]))) for e in estimators[...]]
            about = dict(sums.attrs)
        except (TypeError, AttributeError, KeyError, ValueError, OSError, RuntimeError):
            continue  # damaged, as ``lost`` says
        planned += own[0].planned
        times = checksums.finished(path, design)
        for place, values in _units(times, status, about):
            if place in bad:
                continue
            runs = values[..., 0].size
            done += runs
            finished.append((times[place], runs))
            for e, count in enumerate(own):
                count.done += runs
                count.diverged += int(np.sum(values[..., e] == ESTIMATOR_DIVERGED))
                count.plant_left += int(np.sum(values[..., e] == PLANT_DIVERGED))
                count.lost += int(np.sum(values[..., e] == LOST))
        counts += own
    rate = _rate(finished) if writer else None
    return Progress(name, counts, planned, done, lost, writer, run_file.faults(folder), rate)


def _units(
    finished: Iterable[checksums.Place], status: Any, about: Mapping[str, Any]
) -> Iterator[tuple[checksums.Place, Any]]:
    """Go through the finished units of a design with the status of their runs; ``about`` as of ``chunk_files``."""
    for place in finished:
        _, band, chunk, drive = place
        sample, repeat = divmod(chunk, int(about.get("repeat_chunks", 1)))
        try:
            values = np.asarray(status.blocks[band, sample, drive, repeat, 0])
        except (ValueError, OSError, RuntimeError):  # a damaged chunk
            continue
        if not np.any(values == PENDING):
            yield place, values


def _rate(finished: list[tuple[float, int]]) -> float | None:
    """Return runs per s over the last units that were finished, by the times of their files."""
    late = sorted(finished)[-_RECENT:]
    took = late[-1][0] - late[0][0] if late else 0.0
    return sum(runs for _, runs in late[1:]) / took if took > 0 else None
