"""What a run will take, told before it begins: runs, time from a few timed ones, room on the disk."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

from harness.config import DesignSpec, StudySpec
from harness.engine.simd.lanes import LANES
from harness.study.design import Unit, unit_shape
from harness.study.evaluate import StudyEvaluator
from harness.study.score_names import PER_RUN, PER_TARGET

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
