"""Maximise a likelihood within bounds by Fisher scoring, eight dampings of the step at a time.

At each point one pass gives the gradient ``g`` and the Fisher information ``F``. The step minimises
``-g'd + d'(F + lambda diag F) d / 2`` within the bounds exactly (``scipy.optimize.lsq_linear``), for several ``lambda``
and lengths at once, because eight candidates cost one run of the filter; the best one is taken.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from typing import Protocol

import numpy as np
from scipy import optimize

from harness.common.arrays import Floats, Mask

ENOUGH = 1e-3
"""Predicted gain in log-likelihood below which a search ends: a step of a twentieth of a standard error."""

_DAMPINGS = (0.0, 0.1, 1.0, 10.0)
_LENGTHS = (0.5, 0.2, 2.0, 4.0)
"""Of the full step: a valley may bend sooner than any damping tells, and where the model is wrong the information is
not the curvature, which makes steps too short."""
_LEAST = -0.9
"""Smallest relative step of a variance, behind which its logarithm takes the step."""
_FROM, _TO = 1e2, 1e8
"""Dampings that are tried together where none of these steps gains anything: from so many times the last one up."""


class Objective(Protocol):
    """What is maximised.

    Attributes:
        lower: Bounds ``(n,)``.
        upper: Bounds ``(n,)``.
    """

    lower: Floats
    upper: Floats

    def values(self, z: Floats, /, keep_first: bool = False) -> Floats:
        """Return the values ``(candidates,)`` of candidates ``(n, candidates)``; minus infinity where there is none.

        With ``keep_first`` the first is likely to be the next point of ``slopes``.
        """

    def slopes(self, z: Floats, moved: Mask, /) -> tuple[float, Floats, Floats]:
        """Return value, gradient and information at a point ``(n,)`` of the coordinates that move ``(n,)``."""


@dataclass(frozen=True)
class Maximum:
    """Where a search ended.

    Attributes:
        z: The point ``(n,)``.
        value: Its value.
        information: Fisher information of the moved coordinates at the point before the last step.
        predicted: Predicted gain of a further step.
        hopeless: Whether it was given up because it leads nowhere near what counts.
        stuck: Whether no step gains anything, however small: there the slopes are not those of the value, and another
            search ends in the same place.
    """

    z: Floats
    value: float
    information: Floats
    predicted: float
    hopeless: bool = False
    stuck: bool = False

    @property
    def converged(self) -> bool:
        """Whether the predicted gain of a further step is negligible."""
        return self.predicted < ENOUGH


def maximise(
    objective: Objective,
    start: Floats,
    moved: Mask,
    iterations: int,
    enough: float = ENOUGH,
    slow: float = 0.0,
    share: float = 0.0,
    least: float = -np.inf,
    variances: Mask | None = None,
) -> Maximum:
    """Climb from a point until the predicted gain of a step is below ``enough``.

    Args:
        objective: What is maximised.
        start: First point ``(n,)``, inside the bounds.
        moved: Coordinates that move ``(n,)``.
        iterations: Largest number of passes with derivatives.
        enough: Predicted gain at which to stop.
        slow: Gain of a step at which to stop. In a valley that is long and bent each step gains a little of what is
            predicted.
        share: The same as a share of what the steps before gained.
        least: Value that counts: the search is given up where twice the predicted gain, which may be half of what there
            is, does not promise it.
        variances: Coordinates that are logarithms of variances ``(n,)``. Steps are taken of the variances themselves:
            for that of normal samples whose mean square is ``r`` times as large the step is ``r - 1``, and wrong is the
            logarithm of ``r``.
    """
    z, damping, hopeless, stuck = start.copy(), 1e-2, False, False
    relative = np.zeros(int(moved.sum()), dtype=bool) if variances is None else variances[moved]
    value, predicted, information, before = -np.inf, np.inf, np.empty((0, 0)), 0.0
    ahead = partial(_ahead, objective, moved, relative)
    for _ in range(iterations):
        value, gradient, information = objective.slopes(z, moved)
        lower, upper = objective.lower[moved] - z[moved], objective.upper[moved] - z[moved]
        full = bounded_step(gradient, information, 0.0, lower, upper)
        predicted = float(gradient @ full - 0.5 * full @ information @ full)
        hopeless = bool(value + 2.0 * predicted < least)
        if predicted < enough or not np.isfinite(value) or hopeless:
            break
        strengths = [damping * d for d in _DAMPINGS]
        steps = [bounded_step(gradient, information, s, lower, upper) for s in strengths]
        steps += [np.clip(length * full, lower, upper) for length in _LENGTHS]
        strengths += [damping if length < 1 else strengths[1] for length in _LENGTHS]
        candidates = ahead(z, steps)
        values = objective.values(candidates, keep_first=True)
        best = int(np.argmax(values))
        if values[0] > max(value, values[best] - enough):
            best = 0  # the full step, where no other is better by what counts
        whole = best == 0
        if not values[best] > value:
            strengths = [*np.geomspace(_FROM * damping, max(_TO, _FROM * damping), len(steps))]
            candidates = ahead(z, [bounded_step(gradient, information, s, lower, upper) for s in strengths])
            values = objective.values(candidates, keep_first=True)
            best, whole = int(np.argmax(values)), False
            stuck = not values[best] > value
            if stuck:
                break
        damping = max(strengths[best], 1e-6)
        gained = float(values[best]) - value
        z, value = candidates[:, best], float(values[best])
        if whole:
            # After the full step at most about this is left: it is what the curvature has wrong along the step.
            predicted = abs(predicted - gained)
            if predicted < enough:
                break
        if gained < max(slow, share * before) or (gained < 0.1 * enough and predicted < 10 * enough):
            break  # slow, or rounding of the likelihood
        before += gained
    return Maximum(z, value, information, predicted, hopeless, stuck)


def _ahead(objective: Objective, moved: Mask, relative: Mask, z: Floats, steps: Sequence[Floats]) -> Floats:
    """Return the points at the ends of steps from a point, within the bounds ``(n, steps)``.

    ``relative`` ``(moved,)``: which steps are of variances, whose logarithm the coordinate is.
    """
    way, trials = np.column_stack(steps), np.repeat(z[:, None], len(steps), axis=1)
    trials[moved] += np.where(relative[:, None], np.minimum(way, np.log1p(np.maximum(way, _LEAST))), way)
    return np.clip(trials, objective.lower[:, None], objective.upper[:, None])


def bounded_step(gradient: Floats, information: Floats, damping: float, lower: Floats, upper: Floats) -> Floats:
    """Return the step ``d`` that maximises ``g'd - d'(F + damping diag F) d / 2`` with ``lower <= d <= upper``.

    A coordinate without information does not move.
    """
    scale = np.sqrt(np.diagonal(information))
    informed = scale > 1e-12 * max(float(scale.max(initial=0.0)), 1e-300)
    step = np.zeros(len(gradient))
    if not informed.any():
        return step
    s = scale[informed]
    values, vectors = np.linalg.eigh(information[np.ix_(informed, informed)] / np.outer(s, s))
    roots = np.sqrt(np.maximum(values, 1e-12) + damping)
    matrix = roots[:, None] * vectors.T  # its square is the scaled information with damping
    target = (vectors.T @ (gradient[informed] / s)) / roots
    free = vectors @ (target / roots)
    low, high = lower[informed] * s, upper[informed] * s
    if np.any(free < low) or np.any(free > high):
        room = np.maximum(high, low + 1e-12)  # lsq_linear wants some between the bounds
        free = np.clip(optimize.lsq_linear(matrix, target, (low, room), method="bvls").x, low, high)
    step[informed] = free / s
    return step
