"""The numbers of a page of box plots: which runs make up a box, and which of them are drawn as points."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray
from scipy.stats import chi2

from harness.models.quantities import Quantity, words
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

RANKS = {"": "…", "0": "smallest", "0.5": "median", "1": "largest"}
"""Runs that can be chosen by their rank, from 0 to 1, in words."""

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


def scores_of(design: Design, score: str, target: int) -> NDArray[np.float64]:
    """Return one of ``SCORES`` of all runs in report units, ``(band, estimator, drive, sample, repeat)``."""
    return _values(_Hashed(design), score, target)


def sorted_box(across: int, estimator: int, part: NDArray[np.float64], place: tuple[int, int | None]) -> Box:
    """Return the box of some runs.

    Args:
        across: Index of the level or drive that it is drawn at.
        estimator: Index.
        part: Their scores ``(drive, sample, repeat)``; NaN for none.
        place: Their band, and the index of the first drive in ``part``; ``None`` for all drives.
    """
    finite = np.isfinite(part)
    runs = np.argwhere(finite)
    order = np.argsort(part[finite], kind="stable")
    runs = np.column_stack([np.full(len(runs), place[0]), runs])[order]
    runs[:, 1] += place[1] or 0
    return Box(across, estimator, part[finite][order], runs, int(finite.size - finite.sum()))


@lru_cache(maxsize=4)
def _values(design: _Hashed, score: str, target: int) -> NDArray[np.float64]:
    stored: Design = design.of
    if score == "time_of_divergence":
        return stored.time_of_divergence
    if score in ("nees", "nis"):
        return stored.per_run(score)
    return stored.rmse[target] if score == "rmse" else stored.per_target(score)[target]


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
    values, drawn = scores_of(design, score, target), []
    across = range(len(design.bands)) if level is None else range(len(design.drives))
    for place in across:
        band, drives = (place, drive) if level is None else (level, place)
        for e in estimators:
            part = values[band, e] if drives is None else values[band, e, drives : drives + 1]
            drawn.append(sorted_box(place, e, part, (band, drives)))
    return drawn


def expected(design: Design, score: str) -> dict[float, str]:
    """Return what NEES and NIS should be and, dashed, the ends of the 95 % band of a single sample; else nothing.

    The boxes are of means over runs: those of a consistent filter lie within the band, the nearer to the expected value
    the longer the drive.
    """
    freedom = {"nees": design.state_dimension, "nis": design.output_dimension}.get(score, 0)
    if not freedom:
        return {}
    lower, upper = chi2.ppf([0.025, 0.975], freedom)
    return {float(freedom): "solid", float(lower): "dashed", float(upper): "dashed"}


def unit_of(score: str, target: Quantity) -> str:
    """Return the unit of a score as printed."""
    if score == "time_of_divergence":
        return "s"
    return "" if score in ("nees", "nis") else target.unit


def run_in_words(design: str, level: str, drive: str, point: int | None, repeat: int) -> str:
    """Return which run it is, as a reader says it; ``point`` of designs that have several."""
    middle = "" if point is None else f", point {point}"
    return f"{words(design)}, {level}, drive {drive}{middle}, repeat {repeat}"
