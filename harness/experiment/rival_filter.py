"""A rival's filter over what another model leaves of a planned drive, at several levels of its process noise.

A rival takes up misfit by its parameters and by larger variances of its own, and its filter then says less of its
parameters. So a drive is judged at each of the levels at which a trace states what its models say of the drives so far;
at each it is a parabola in the parameters (Gauss-Newton). The rival is at the level, and where on it, that is
likeliest over the fitted drives, old and new.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats, Mask
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.identification.coordinates import Coordinate
from harness.identification.data import DriveData
from harness.identification.filtered_model import Candidates
from harness.identification.uncertainty import covariance_of

LOST = 1e4
"""Squares of a filter that diverges over what the right model leaves."""

_REFITS = 2
"""Gauss-Newton steps of the parameters on each drive, behind which the parabola is taken."""

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

    def best(self) -> tuple[int, Floats]:
        """Return the level at which it is least, and where."""
        places = [self.least(k) for k in range(len(self.squares))]
        level = int(np.argmin([self.at(k, z) for k, z in enumerate(places)]))
        return level, places[level]


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

    @property
    def cheapest(self) -> float:
        """Least value over the drives so far."""
        return self.so_far.at(*self.so_far.best())

    @property
    def values(self) -> Floats:
        """All parameters as fitted ``(np,)``."""
        return self.points[0].values[:, 0]

    def over(
        self, model: AugmentedModel, data: DriveData, begin: float = 0.0, refitted: bool = True
    ) -> tuple[Parabolas, Parabolas]:
        """Return the squared whitened innovations over what another model leaves without noise.

        They are those of linearisations where the parameters have taken up what they can: of the whole drive, and of
        what counts where it judges.

        Args:
            model: The filter of both.
            data: What is left.
            begin: s from which on it judges.
            refitted: Whether they take up anything: not where it is the model itself.
        """
        judges = data.time >= begin
        cheap = [int(k) for k in np.argsort(self.cost, kind="stable")]
        parts: dict[int, tuple[_Parts, _Parts]] = {}
        least = math.inf
        for k in cheap if refitted else cheap[:1]:
            if self.cost[k] > _NEAR * least:  # by more noise it would lose more than it has to take up
                break
            parts[k] = self._linearised(model, data, judges, k)
            least = min(least, self._reached(k, parts[k][0])[0])
        for _ in range(_REFITS if refitted else 0):
            reached = {k: self._reached(k, whole) for k, (whole, _) in parts.items()}
            least = min(value for value, _ in reached.values())
            for k, (value, z) in reached.items():
                if value <= _NEAR * least + 1.0:
                    parts[k] = self._linearised(model, data, judges, k, z)
        first = parts[cheap[0]]  # of levels that are too dear: what it is with less noise
        each = [parts.get(k, first) for k in range(len(self.points))]
        return _together([whole for whole, _ in each]), _together([judged for _, judged in each])

    def _reached(self, level: int, parts: _Parts) -> tuple[float, Floats]:
        """Return what is left at a level, of the drives so far and of one more, and where its parameters are then."""
        slope, information = self.so_far.slope[level] + parts[1], self.so_far.information[level] + parts[2]
        z = self._within(-covariance_of(information, dropped=True).matrix @ slope)
        return self.cost[level] + parts[0] + float(2.0 * slope @ z + z @ information @ z), z

    def _within(self, z: Floats) -> Floats:
        """Return a step that leads neither too far nor out of the bounds."""
        clipped = np.clip(z, -_FARTHEST, _FARTHEST)
        return np.array([np.clip(c.centre + d, c.lower, c.upper) - c.centre
                         for c, d in zip(self.coordinates, clipped, strict=True)])  # fmt: skip

    def _linearised(
        self, model: AugmentedModel, data: DriveData, judges: Mask, level: int, z: Floats | None = None
    ) -> tuple[_Parts, _Parts]:
        """Return the parabolas of a linearisation at ``z``, of the fit by default; lost where the filter diverges."""
        n, values = len(self.coordinates), self.values.copy()
        z = np.zeros(n) if z is None else z
        for c, d in zip(self.coordinates, z, strict=True):
            values[c.rows[0]] = c.value(c.centre + d)
        point = replace(self.points[level], values=values[:, None])
        run = model.run(data, point)
        if not math.isfinite(run.log_likelihood):
            return ((LOST, np.zeros(n), np.zeros((n, n))),) * 2
        slopes = np.array([c.slope(c.centre + d) for c, d in zip(self.coordinates, z, strict=True)])
        directions = model.along([c.name for c in self.coordinates]) * slopes
        tangents = model.sensitivities(data, point.values, directions, run)
        whitened = np.nan_to_num(run.whitened)

        def parabola(samples: Mask) -> _Parts:
            tangent = tangents[samples].reshape(-1, n)
            residual = whitened[samples].ravel() - tangent @ z
            return float(residual @ residual), tangent.T @ residual, tangent.T @ tangent

        return parabola(np.ones_like(judges)), parabola(judges)


def _together(parts: Sequence[_Parts]) -> Parabolas:
    """Return the parabolas of all levels."""
    squares, slopes, information = zip(*parts, strict=True)
    return Parabolas(np.array(squares), np.array(slopes), np.array(information))
