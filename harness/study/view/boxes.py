"""The numbers of a page of box plots: which runs make up a box, and which of them are drawn as points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from harness.models.quantities import Quantity
from harness.study.results import Design

SCORES = {
    "rmse": "RMSE",
    "bias": "bias",
    "max_error": "largest error",
    "nees": "NEES",
    "nis": "NIS",
    "time_of_divergence": "time of divergence",
}
"""What boxes may be of, in words."""

POINTS = 3000
"""Runs drawn as points; of more, as many of each box, evenly by rank and always the smallest and the largest."""


@dataclass(frozen=True)
class Box:
    """The runs of one estimator at one level or on one drive.

    Attributes:
        across: Index of the level or drive.
        estimator: Index.
        values: Score of each run, ascending.
        runs: ``(band, drive, sample, repeat)`` of each, ``(runs, 4)``.
        lost: Runs without that score.
    """

    across: int
    estimator: int
    values: NDArray[np.float64]
    runs: NDArray[np.int64]
    lost: int

    @property
    def quartiles(self) -> tuple[float, float, float]:
        """Quartiles and median."""
        low, middle, high = np.quantile(self.values, [0.25, 0.5, 0.75])
        return float(low), float(middle), float(high)

    def nearest(self, value: float) -> int:
        """Return the run whose score is nearest to a value."""
        return int(np.argmin(np.abs(self.values - value)))

    def points(self, most: int) -> NDArray[np.int64]:
        """Return at most that many runs, evenly by rank, with the smallest and the largest."""
        count = len(self.values)
        if count <= most:
            return np.arange(count)
        return np.unique(np.linspace(0, count - 1, most).round().astype(np.int64))


@lru_cache(maxsize=4)
def _values(design: _Hashed, score: str, target: int) -> NDArray[np.float64]:
    """Return a score of all runs, ``(band, estimator, drive, sample, repeat)``."""
    found: Design = design.of
    if score == "time_of_divergence":
        return found.time_of_divergence
    if score in ("nees", "nis"):
        return found.per_run(score)
    return found.rmse[target] if score == "rmse" else found.per_target(score)[target]


@dataclass(frozen=True, eq=False)
class _Hashed:
    """A design that is known by what it is, not by its content."""

    of: Design

    def __hash__(self) -> int:
        return id(self.of)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Hashed) and other.of is self.of


def boxes(
    design: Design, score: str, target: int, estimators: Sequence[int], drive: int | None, level: int | None
) -> list[Box]:
    """Return the boxes of a design, by level, or by drive where one level was chosen.

    Args:
        design: The design.
        score: One of ``SCORES``.
        target: Index of the target.
        estimators: Indices of those that are shown.
        drive: Runs on this drive alone; all by default. Does not count where a level was chosen.
        level: Boxes of this level, one for each drive.
    """
    values, found = _values(_Hashed(design), score, target), []
    across = range(len(design.bands)) if level is None else range(len(design.drives))
    for place in across:
        band, drives = (place, drive) if level is None else (level, place)
        for e in estimators:
            part = values[band, e] if drives is None else values[band, e, drives : drives + 1]
            known = np.isfinite(part)
            runs = np.argwhere(known)
            order = np.argsort(part[known], kind="stable")
            runs = np.column_stack([np.full(len(runs), band), runs])[order]
            runs[:, 1] += drives or 0
            found.append(Box(place, e, part[known][order], runs, int(known.size - known.sum())))
    return found


def unit_of(score: str, target: Quantity) -> str:
    """Return the unit of a score as printed."""
    if score == "time_of_divergence":
        return "s"
    return "" if score in ("nees", "nis") else target.unit
