"""A rival's filter over what another model leaves of a planned drive, at several levels of its process noise.

A rival takes up misfit by its parameters and by larger variances of its own, and its filter then says less of its
parameters. So a drive is judged at each of the levels at which a trace states what its models say of the drives so far;
at each it is a parabola in the parameters (Gauss-Newton). The rival is at the level, and where on it, that is
likeliest over the fitted drives, old and new.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.engine.simd.lanes import LANES
from harness.identification.candidates import Candidates
from harness.identification.coordinates import Coordinate
from harness.identification.data import DriveData
from harness.identification.filtered_model import FilterRun
from harness.identification.uncertainty import covariance_of

LOST = 1e4
"""Squares of a filter that diverges over what the right model leaves."""

_REFITS = 2
"""Gauss-Newton steps of the parameters on each drive at most, behind which the parabola is taken."""

_ENOUGH = 0.01
"""Share of what is left, or of a squared deviation, that a step has to promise."""

_RENEWED = 0.02
"""The same by which a step has to miss what it promised for the derivatives to be taken anew behind it."""

_FARTHEST = 1.0
"""Longest of these steps from the fit, in the coordinates: a factor of e."""

_NEAR = 2.0
"""Factor on the least that is left, beyond which a level is not looked at: it leaves more in any case."""

_Parts = tuple[float, Floats, Floats]


@dataclass(frozen=True)
class Parabolas:
    """Minus twice a log likelihood about a fit, at each level, as a parabola in the coordinates.

    Attributes:
        squares: At the fit ``(levels,)``.
        slope: Of half of it ``(levels, n)``.
        information: Half its second derivative ``(levels, n, n)``.
    """

    squares: Floats
    slope: Floats
    information: Floats

    def __add__(self, other: Parabolas) -> Parabolas:
        """Return the sum."""
        return Parabolas(self.squares + other.squares, self.slope + other.slope, self.information + other.information)

    def __mul__(self, factor: float) -> Parabolas:
        """Return a multiple."""
        return Parabolas(factor * self.squares, factor * self.slope, factor * self.information)

    def least(self, level: int) -> Floats:
        """Return where it is least at a level ``(n,)``; directions of which nothing is known are not gone."""
        return -covariance_of(self.information[level], dropped=True).matrix @ self.slope[level]

    def at(self, level: int, z: Floats) -> float:
        """Return its value."""
        return float(self.squares[level] + 2.0 * self.slope[level] @ z + z @ self.information[level] @ z)

    def floors(self) -> Floats:
        """Return its least value at each level ``(levels,)``."""
        return np.array([self.at(k, self.least(k)) for k in range(len(self.squares))])

    def best(self, floors: Floats | None = None) -> tuple[int, Floats]:
        """Return the level at which it is least, and where.

        Args:
            floors: What it is not below at each level; levels that these rule out are not looked at.
        """
        floors = np.full(len(self.squares), -math.inf) if floors is None else floors
        best, level, place = math.inf, 0, self.slope[0]
        for k in np.argsort(floors, kind="stable"):
            if floors[k] >= best:
                break
            z = self.least(k)
            if (value := self.at(k, z)) < best:
                best, level, place = value, int(k), z
        return level, place


OverADrive = tuple[Parabolas, Parabolas, Floats]
"""Of the whole drive and of what judges, and the information of both as fitted, see ``RivalFilter.over``."""


@dataclass(frozen=True)
class LinearisedFilter:
    """A filter over a recording, linearised in its coordinates.

    Attributes:
        z: Where it was run ``(n,)``.
        whitened: Innovations there, sample by sample ``(samples ny,)``.
        tangents: Their derivatives, there or near it ``(samples ny, n)``.
    """

    z: Floats
    whitened: Floats
    tangents: Floats

    @cached_property
    def whole(self) -> _Parts:
        """The parabola of all squares."""
        return self.parabola(0)

    def parabola(self, begin: int) -> _Parts:
        """Return the parabola of the squares from a row on."""
        tangents = self.tangents[begin:]
        residual = self.whitened[begin:] - tangents @ self.z
        return float(residual @ residual), tangents.T @ residual, tangents.T @ tangents


@dataclass(frozen=True)
class RivalFilter:
    """A model with what the drives so far say of it.

    Attributes:
        points: As fitted, at each level.
        coordinates: Its parameters.
        so_far: What the drives so far say of them.
    """

    points: tuple[Candidates, ...]
    coordinates: tuple[Coordinate, ...]
    so_far: Parabolas

    @property
    def cost(self) -> Floats:
        """What each level costs over the drives so far, as fitted ``(levels,)``; the best of them nothing.

        If the model is right that is what their noise costs there.
        """
        return self.so_far.squares - self.so_far.squares.min()

    @cached_property
    def floors(self) -> Floats:
        """Least value over the drives so far at each level ``(levels,)``."""
        return self.so_far.floors()

    @property
    def values(self) -> Floats:
        """All parameters as fitted ``(np,)``."""
        return self.points[0].values[:, 0]

    def over(self, model: AugmentedModel, data: DriveData, begin: float = 0.0) -> OverADrive:
        """Return the squared whitened innovations over what another model leaves without noise.

        They are those of linearisations where the parameters have taken up what they can: of the whole drive, and of
        what counts where it judges. Behind them is the information of both as fitted, at the cheapest level
        ``(2, n, n)``.

        Args:
            model: The filter of both.
            data: What is left.
            begin: s from which on it judges.
        """
        cheap = [int(k) for k in np.argsort(self.cost, kind="stable")]
        centre = np.zeros(len(self.coordinates))
        runs: dict[int, LinearisedFilter] = {}
        least = math.inf
        for k, run in self._in_turn(model, data, cheap):
            if self.cost[k] > _NEAR * least:  # by more noise it would lose more than it has to take up
                break
            runs[k] = self._linearised(model, data, k, centre, run)
            least = min(least, self._reached(k, runs[k].whole)[0])
        as_fitted = runs[cheap[0]]
        for _ in range(_REFITS):
            reached = {k: self._reached(k, run.whole) for k, run in runs.items()}
            least = min(value for value, _ in reached.values())
            steps = {
                k: (value, z)
                for k, (value, z) in reached.items()
                if value <= _NEAR * least + 1.0
                and self._left(k, runs[k].whole, runs[k].z) - value > _ENOUGH * (value + 1.0)
            }
            if not steps:
                break
            again = model.runs_of(data, Candidates.together([self.point(k, z) for k, (_, z) in steps.items()]))
            for (k, (value, z)), run in zip(steps.items(), again, strict=True):
                runs[k] = self._linearised(model, data, k, z, run, runs[k], value)
        levels = [k if k in runs else cheap[0] for k in range(len(self.points))]  # too dear: as with less noise
        return over_a_drive([runs[k] for k in levels], as_fitted, data, begin)

    def as_fitted(
        self, model: AugmentedModel, data: DriveData, run: FilterRun, like: LinearisedFilter | None = None
    ) -> LinearisedFilter:
        """Return a linearisation as fitted at the cheapest level.

        Args:
            model: The filter of both.
            data: What another model leaves.
            run: Of the filter there.
            like: Over what still another one leaves of the same drive, whose derivatives are taken.
        """
        there = like if like is not None and like.tangents.any() else None  # not where it diverged
        return self._linearised(model, data, self.cheapest, np.zeros(len(self.coordinates)), run, there)

    @property
    def cheapest(self) -> int:
        """The level that is likeliest as fitted."""
        return int(np.argmin(self.cost))

    def point(self, level: int, z: Floats | None = None) -> Candidates:
        """Return what it holds at a level with the parameters at ``z``; as fitted without."""
        values = self.values.copy()
        for c, d in zip(self.coordinates, np.zeros(len(self.coordinates)) if z is None else z, strict=True):
            values[c.rows[0]] = c.value(c.centre + d)
        return replace(self.points[level], values=values[:, None])

    def _in_turn(
        self, model: AugmentedModel, data: DriveData, levels: Sequence[int]
    ) -> Iterator[tuple[int, FilterRun]]:
        """Yield the runs at some levels as fitted, in lanes as far as they are asked for."""
        for s in range(0, len(levels), LANES):
            few = levels[s : s + LANES]
            yield from zip(few, model.runs_of(data, Candidates.together([self.point(k) for k in few])), strict=True)

    def _reached(self, level: int, parts: _Parts) -> tuple[float, Floats]:
        """Return what is left at a level, of the drives so far and of one more, and where its parameters are then."""
        slope, information = self.so_far.slope[level] + parts[1], self.so_far.information[level] + parts[2]
        z = self._within(-covariance_of(information, dropped=True).matrix @ slope)
        return self._left(level, parts, z), z

    def _left(self, level: int, parts: _Parts, z: Floats) -> float:
        """Return what is left at a level with the parameters at ``z``."""
        slope, information = self.so_far.slope[level] + parts[1], self.so_far.information[level] + parts[2]
        return float(self.cost[level] + parts[0] + 2.0 * slope @ z + z @ information @ z)

    def _within(self, z: Floats) -> Floats:
        """Return a step that leads neither too far nor out of the bounds."""
        clipped = np.clip(z, -_FARTHEST, _FARTHEST)
        return np.array([np.clip(c.centre + d, c.lower, c.upper) - c.centre
                         for c, d in zip(self.coordinates, clipped, strict=True)])  # fmt: skip

    def _linearised(
        self,
        model: AugmentedModel,
        data: DriveData,
        level: int,
        z: Floats,
        run: FilterRun,
        before: LinearisedFilter | None = None,
        promised: float | None = None,
    ) -> LinearisedFilter:
        """Return a linearisation at ``z``, with the derivatives of ``before`` where these led to what they promised.

        If nothing was promised they are taken in any case. Where the filter diverges it is lost.
        """
        whitened = np.nan_to_num(run.whitened).ravel()
        if not math.isfinite(run.log_likelihood):
            whitened = np.r_[np.zeros(whitened.size - 1), math.sqrt(LOST)]
            return LinearisedFilter(z, whitened, np.zeros((whitened.size, len(z))))
        if before is not None:
            moved = replace(before, z=z, whitened=whitened)
            if promised is None or abs(self._left(level, moved.whole, z) - promised) <= _RENEWED * (promised + 1.0):
                return moved
        slopes = np.array([c.slope(c.centre + d) for c, d in zip(self.coordinates, z, strict=True)])
        directions = model.along([c.name for c in self.coordinates]) * slopes
        tangents = model.sensitivities(data, self.point(level, z).values, directions, run)
        return LinearisedFilter(z, whitened, tangents.reshape(-1, len(z)))


def over_a_drive(
    levels: Sequence[LinearisedFilter], as_fitted: LinearisedFilter, data: DriveData, begin: float
) -> OverADrive:
    """Return what a filter, linearised at some levels, makes of a drive that judges from ``begin`` in s on."""
    row = int(np.searchsorted(data.time, begin)) * data.measurements.shape[1]
    parts = {id(run): (run.whole, run.parabola(row)) for run in [*levels, as_fitted]}
    whole, judged = (_together([parts[id(run)][part] for run in levels]) for part in (0, 1))
    return whole, judged, np.array([information for *_, information in parts[id(as_fitted)]])


def _together(parts: Sequence[_Parts]) -> Parabolas:
    """Return the parabolas of all levels."""
    squares, slopes, information = zip(*parts, strict=True)
    return Parabolas(np.array(squares), np.array(slopes), np.array(information))
