"""Climb the likelihood along logarithms of variances, of which no derivatives are at hand.

Eight candidates cost one run of the filter, so differences are cheap: each step is Newton's with the diagonal of the
Hessian, from central differences along every logarithm, and the best of several lengths of it.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from harness.identify.scoring import Objective

Floats = NDArray[np.float64]

_DIFFERENCE = 0.1
"""Of a logarithm: its second-order error is a thousandth, far more than rounding."""

_FARTHEST = 2.0
"""Longest step of a logarithm, and the step where the likelihood is not concave."""

_NEAR = 0.3
"""Longest step of a logarithm behind which the curvature counts as that before it."""

_LENGTHS = (0.25, 0.5, 0.75, 1.0, 1.4, 2.0, 4.0)
"""Of a step, tried together; with the point itself they are the lanes of one run."""


def climb(objective: Objective, z: Floats, value: float, first: int, iterations: int, enough: float) -> Floats:
    """Return the point with the variances behind ``first`` at their likeliest.

    Args:
        objective: What is maximised.
        z: Where to start ``(n,)``; coordinates before ``first`` stay.
        value: Its value there.
        first: First logarithm of a variance.
        iterations: Largest number of steps.
        enough: Gain of a step at which to stop.
    """
    rows = np.arange(first, len(z))
    curvature: Floats | None = None
    for _ in range(iterations):
        slope, curvature = _slopes(objective, z, value, rows, curvature)
        step = _newton(slope, curvature)
        many = np.repeat(z[:, None], len(_LENGTHS) + 1, axis=1)
        many[first:, 1:] += step[:, None] * np.array(_LENGTHS)
        many = np.clip(many, objective.lower[:, None], objective.upper[:, None])
        values = objective.values(many)
        best = int(np.argmax(values))
        gained = float(values[best]) - value
        if not gained > 0:
            break
        if np.max(np.abs(many[:, best] - z)) > _NEAR:
            curvature = None
        z, value = many[:, best], float(values[best])
        if gained < enough:
            break
    return z


def _slopes(
    objective: Objective, z: Floats, value: float, rows: NDArray[np.intp], curvature: Floats | None
) -> tuple[Floats, Floats]:
    """Return slope and curvature along each logarithm ``(variances,)``: where the latter is known, by half the runs."""
    n = len(rows)
    many = np.repeat(z[:, None], n if curvature is not None else 2 * n, axis=1)
    many[rows, np.arange(n)] += _DIFFERENCE
    if curvature is not None:
        return (objective.values(many) - value) / _DIFFERENCE + 0.5 * _DIFFERENCE * curvature, curvature
    many[rows, np.arange(n, 2 * n)] -= _DIFFERENCE
    values = objective.values(many)
    up, down = values[:n], values[n:]
    with np.errstate(invalid="ignore"):
        return (up - down) / (2 * _DIFFERENCE), (2 * value - up - down) / _DIFFERENCE**2


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
