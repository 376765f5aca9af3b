"""The numbers of a design over several factors: one row per point, and what its factors explain."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.study.results import Design, Factor
from harness.view.boxes import scores_of

MOST = 1500
"""Points drawn; of more, as many evenly by rank of their score, always with the smallest and the largest."""


PARALLEL = "parallel"
"""Name of the parallel coordinates; a scatter is named by the number of its factor."""


@dataclass(frozen=True)
class Brush:
    """A part of a figure that a reader dragged over, in its coordinates.

    Attributes:
        figure: ``PARALLEL``, or the number of a factor.
        x0, x1, y0, y1: Its ends.
    """

    figure: str
    x0: float
    x1: float
    y0: float
    y1: float

    @property
    def text(self) -> str:
        """It in an address."""
        return ",".join([self.figure, *(f"{v:.6g}" for v in (self.x0, self.x1, self.y0, self.y1))])

    @staticmethod
    def read(given: str, factors: int) -> Brush | None:
        """Return what an address asks for; ``None`` if there is none such."""
        figure, *ends = given.split(",")
        exists = figure == PARALLEL or (figure.isascii() and figure.isdigit() and int(figure[:9]) < factors)
        try:
            numbers = [float(v) for v in ends]
        except ValueError:
            return None
        return Brush(figure, *numbers) if exists and len(numbers) == 4 and all(map(math.isfinite, numbers)) else None

    def held(self, columns: Floats, scores: Floats) -> list[int]:
        """Return the points in it.

        Args:
            columns: Of parallel coordinates the height on every axis ``(point, axis)``, of a scatter the factor.
            scores: Of the points.
        """
        if self.figure == PARALLEL:
            across = np.arange(columns.shape[1])
            chosen = (across >= self.x0) & (across <= self.x1)
            inside = (columns[:, chosen] >= self.y0) & (columns[:, chosen] <= self.y1)
        else:
            value = columns[:, 0]
            inside = ((value >= self.x0) & (value <= self.x1) & (scores >= self.y0) & (scores <= self.y1))[:, None]
        return [int(i) for i in np.flatnonzero(inside.any(axis=1))]


@dataclass(frozen=True)
class Points:
    """The points of a design with the score of one estimator.

    Attributes:
        places: Band and sample of each, ``(point, 2)``.
        worst: Drive and repeat of its largest score ``(point, 2)``; the first ones where no run has a score.
        values: Factors in report units ``(point, factor)``.
        scores: Root mean square of the RMSE over drives and repeats, of others their mean; NaN where no run has one.
    """

    places: NDArray[np.int64]
    worst: NDArray[np.int64]
    values: Floats
    scores: Floats


def varied(design: Design) -> list[int]:
    """Return the factors that take more than one value."""
    return [i for i, f in enumerate(design.factors) if np.ptp(f.values) > 0]


def points_of(design: Design, score: str, target: int, estimator: int, drive: int | None) -> Points:
    """Return the points of a design.

    Args:
        design: With factors.
        score: One of ``harness.view.boxes.SCORES``.
        target: Index.
        estimator: Index.
        drive: Runs on this drive alone; ``None`` for all.
    """
    runs = scores_of(design, score, target)[:, estimator]
    runs = runs if drive is None else runs[:, drive : drive + 1]
    runs = np.moveaxis(runs, 1, 2)  # band, sample, drive, repeat
    flat = runs.reshape(*runs.shape[:2], -1)
    finite = np.isfinite(flat)
    count = finite.sum(axis=-1)
    power = 2 if score == "rmse" else 1
    total = np.where(finite, flat, 0.0) ** power
    with np.errstate(invalid="ignore", divide="ignore"):
        mean = np.where(count > 0, (total.sum(axis=-1) / count) ** (1 / power), np.nan)
    worst = np.argmax(np.where(finite, flat, -np.inf), axis=-1)
    places = np.argwhere(np.ones(mean.shape, dtype=bool))
    drives, repeats = np.divmod(worst.ravel(), runs.shape[3])
    values = np.array([f.values for f in design.factors]).reshape(len(design.factors), -1).T
    points = Points(places, np.column_stack([drives + (drive or 0), repeats]), values, mean.ravel())
    if len(places) <= MOST:
        return points
    order = np.argsort(points.scores, kind="stable")
    rows = np.sort(order[np.linspace(0, len(order) - 1, MOST).round().astype(int)])
    return Points(points.places[rows], points.worst[rows], points.values[rows], points.scores[rows])


def shares(factor: Factor, values: Floats) -> Floats:
    """Return where values lie between the smallest and the largest of a factor, from 0 to 1."""
    values, all_values = (np.log(v) if factor.log else v for v in (values, factor.values))
    low, high = float(all_values.min()), float(all_values.max())
    return (values - low) / (high - low) if high > low else np.full(len(values), 0.5)
