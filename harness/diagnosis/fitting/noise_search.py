"""Climb the likelihood along logarithms of variances, of which no derivatives are at hand.

Eight candidates cost one run of the filter, so differences are cheap: each step is Newton's with the diagonal of the
Hessian, from differences along every logarithm, and the best of several lengths of it.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.engine.simd.lanes import LANES
from harness.identification.fisher_scoring import Objective

_DIFFERENCE = 0.1
"""Of a logarithm: its second-order error is a thousandth, far more than rounding."""

_FARTHEST = 2.0
"""Longest step of a logarithm, and the step where the likelihood is not concave."""

_NEAR = 0.3
"""Largest way of a logarithm behind which the curvature counts as that before it."""

_QUIET = 0.05
"""Share of the gain at which to stop that must be predicted of a logarithm for it to be moved again in a climb."""

_LENGTHS = (0.25, 0.5, 0.75, 1.0, 1.4, 2.0, 4.0)
"""Of a step, tried together; with the point itself they are the lanes of one run."""


@dataclass(frozen=True)
class Climbed:
    """Where a climb ended.

    Attributes:
        z: The point ``(n,)``.
        curvature: There.
        hopeless: Whether it was given up because it leads nowhere near what counts.
    """

    z: Floats
    curvature: Curvature
    hopeless: bool


@dataclass(frozen=True)
class Curvature:
    """Second derivatives of what is maximised, its sign changed, along each logarithm.

    Attributes:
        values: ``(variances,)``.
        away: How far each logarithm has moved since ``(variances,)``; infinite where the curvature is not known.
    """

    values: Floats
    away: Floats


def climb(
    objective: Objective,
    z: Floats,
    value: float,
    first: int,
    iterations: int,
    enough: float,
    curvature: Curvature | None = None,
    least: float = -math.inf,
) -> Climbed:
    """Return the point with the variances behind ``first`` at their likeliest.

    A variance ``R`` that is too small costs at most ``SS / 2R``, the sum of squares over it, and that is about the
    slope along its logarithm: the sum of the slopes bounds what is to be gained.

    Args:
        objective: What is maximised.
        z: Where to start ``(n,)``; coordinates before ``first`` stay.
        value: Its value there.
        first: First logarithm of a variance.
        iterations: Largest number of steps.
        enough: Gain of a step at which to stop.
        curvature: What an earlier climb nearby returned; saves runs.
        least: Value that counts: where the slopes do not promise it, the climb is given up.
    """
    variances = len(z) - first
    active = np.ones(variances, dtype=bool)
    if curvature is None:
        curvature = Curvature(np.full(variances, np.nan), np.full(variances, np.inf))
    for _ in range(iterations):
        slope, curvature = _slopes(objective, z, value, first, np.flatnonzero(active), curvature)
        if value + np.abs(slope).sum() < least:
            return Climbed(z, curvature, hopeless=True)
        step = _newton(slope, curvature.values)
        many = np.repeat(z[:, None], len(_LENGTHS) + 1, axis=1)
        many[first:, 1:] += step[:, None] * np.array(_LENGTHS)
        many = np.clip(many, objective.lower[:, None], objective.upper[:, None])
        values = objective.values(many)
        best = int(np.argmax(values))
        gained = float(values[best]) - value
        if not gained > 0:
            break
        with np.errstate(invalid="ignore"):  # a slope that is not finite has no step, and stays active
            active &= ~(0.5 * np.abs(slope * step) < _QUIET * enough)
        curvature = Curvature(curvature.values, curvature.away + np.abs(many[first:, best] - z[first:]))
        z, value = many[:, best], float(values[best])
        if gained < enough or not active.any():
            break
    return Climbed(z, curvature, hopeless=False)


def curvatures(objective: Objective, z: Floats, value: float, rows: range) -> Floats:
    """Return second derivatives of what is maximised, its sign changed, along some coordinates ``(rows,)``.

    Args:
        objective: What is maximised.
        z: Where ``(n,)``.
        value: Its value there.
        rows: The coordinates.
    """
    many = np.repeat(z[:, None], 2 * len(rows), axis=1)
    for j, row in enumerate(rows):
        many[row, 2 * j : 2 * j + 2] += (_DIFFERENCE, -_DIFFERENCE)
    values = objective.values(many).reshape(-1, 2) if len(rows) else np.zeros((0, 2))
    return np.asarray((2.0 * value - values.sum(axis=1)) / _DIFFERENCE**2)


def _slopes(
    objective: Objective, z: Floats, value: float, first: int, rows: NDArray[np.intp], known: Curvature
) -> tuple[Floats, Curvature]:
    """Return slope and curvature along each logarithm, the slope 0 but for some ``rows``.

    Differences to both sides give both; where the curvature is known one does, and the oldest are renewed in the lanes
    that are left over.
    """
    oldest = rows[np.argsort(-known.away[rows], kind="stable")]
    needed = int(np.sum(known.away[rows] > _NEAR))
    spare = -(len(rows) + needed) % LANES
    new = oldest[: needed + spare]
    many = np.repeat(z[:, None], len(rows) + len(new), axis=1)
    many[first + rows, np.arange(len(rows))] += _DIFFERENCE
    many[first + new, len(rows) + np.arange(len(new))] -= _DIFFERENCE
    values = objective.values(many)
    slope, curvature, away = np.zeros(len(z) - first), known.values.copy(), known.away.copy()
    with np.errstate(invalid="ignore"):
        slope[rows] = (values[: len(rows)] - value) / _DIFFERENCE  # a difference to one side, so far
        curvature[new] = (slope[new] * _DIFFERENCE + values[len(rows) :] - value) / -(_DIFFERENCE**2)
        slope[rows] += 0.5 * _DIFFERENCE * curvature[rows]
    away[new] = 0.0
    return slope, Curvature(curvature, away)


def _newton(slope: Floats, curvature: Floats) -> Floats:
    """Return Newton's step with a diagonal Hessian ``(variances,)``; none where a difference is not finite."""
    with np.errstate(invalid="ignore"):
        far = np.abs(slope) > _FARTHEST * curvature
        step = np.where(far, np.sign(slope) * _FARTHEST, slope / np.where(far, 1.0, curvature))
    return np.nan_to_num(step, nan=0.0, posinf=0.0, neginf=0.0)


def along(objective: Objective, z: Floats, together: Sequence[int], steps: Sequence[float]) -> Floats:
    """Return the best of a point and points with some coordinates moved by one of several steps."""
    many = np.repeat(z[:, None], len(steps) + 1, axis=1)
    many[list(together), 1:] += np.array(steps)
    many = np.clip(many, objective.lower[:, None], objective.upper[:, None])
    return many[:, int(np.argmax(objective.values(many)))]
