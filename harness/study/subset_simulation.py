"""Probability of a rare event by subset simulation (Au and Beck 2001, doi 10.1016/S0266-8920(01)00019-4).

The event is that a function of independent standard normal numbers exceeds a limit. Of every level the largest tenth of
the values seeds the next, whose points are drawn above that threshold by Markov chains; the probability is the product
of the shares. Chains propose conditionally normal steps (Papaioannou, Betz, Zwirglmaier and Straub 2015, doi
10.1016/j.probengmech.2015.06.006, section 4.3), whose size is adapted to an acceptance of 0.44.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError

KEPT = 0.1
"""Share of the points of a level that seed the next."""

ACCEPTANCE = 0.44
"""Share of the proposed points that is aimed at."""

MOST_LEVELS = 20
"""Levels after which the event is given up: a probability of 1e-20."""

_ADAPTED = 10
"""Times that the size of the steps is adapted in a level."""


@dataclass(frozen=True)
class RareEvent:
    """Probability of a rare event.

    Attributes:
        probability: The estimate.
        variation: Its coefficient of variation; shares of different levels are taken as independent.
        thresholds: Of each level; the last is the limit.
        evaluations: Values of the function that it took.
    """

    probability: float
    variation: float
    thresholds: tuple[float, ...]
    evaluations: int


def rare_event(
    function: Callable[[Floats], Floats], dimensions: int, limit: float, samples: int = 1000, seed: int = 0
) -> RareEvent:
    """Return the probability that a function of standard normal numbers exceeds a limit.

    Args:
        function: Returns ``(n,)`` for points ``(n, dimensions)``.
        dimensions: Numbers that it takes.
        limit: The limit.
        samples: Points of a level, a multiple of ten.
        seed: Of all random numbers.

    Raises:
        UserError: If the event is not reached in ``MOST_LEVELS`` levels.
    """
    generator = np.random.default_rng(seed)
    seeds = round(KEPT * samples)
    points = generator.standard_normal((samples, dimensions))
    values = np.asarray(function(points))
    probability, variance, step, evaluations = 1.0, 0.0, 0.8, samples
    thresholds: list[float] = []
    chains = samples  # of the first level each point is a chain of its own
    for _ in range(MOST_LEVELS):
        order = np.argsort(-values, kind="stable")
        threshold = min(float(values[order[seeds - 1]] + values[order[seeds]]) / 2.0, limit)
        thresholds.append(threshold)
        above = values > threshold
        share = float(above.mean())
        if share > 0.0:
            probability *= share
            variance += (1.0 - share) / (share * samples) * (1.0 + _correlation(above.reshape(chains, -1), share))
        if threshold >= limit or share == 0.0:
            reached = threshold >= limit and share > 0.0
            if not reached:
                break
            return RareEvent(probability, math.sqrt(variance), tuple(thresholds), evaluations)
        begin = generator.permutation(np.flatnonzero(above))[:seeds]
        chains = len(begin)
        points, values, step = _chains(
            function, points[begin], values[begin], threshold, samples // chains, step, generator
        )
        evaluations += len(values) - chains
    raise UserError(
        f"the limit {limit:g} is not reached in {len(thresholds)} levels, the last of which begins at "
        f"{thresholds[-1]:g}; give a smaller limit or more samples"
    )


def _chains(
    function: Callable[[Floats], Floats],
    points: Floats,
    values: Floats,
    threshold: float,
    length: int,
    step: float,
    generator: np.random.Generator,
) -> tuple[Floats, Floats, float]:
    """Return chains of points above a threshold, one behind the other, their values and the adapted size of steps.

    Args:
        function: As in ``rare_event``.
        points: First of each chain, ``(chain, dimensions)``.
        values: Of them.
        threshold: What all points exceed.
        length: Points of a chain.
        step: Standard deviation of what a step adds; the new point keeps the root of the rest of the old one.
        generator: Of all random numbers.
    """
    kept_points, kept_values, accepted, since = [points], [values], 0.0, 0
    every = max(1, length // _ADAPTED)
    for count in range(1, length):
        proposed = math.sqrt(1.0 - step**2) * points + step * generator.standard_normal(points.shape)
        tried = np.asarray(function(proposed))
        better = tried > threshold
        points = np.where(better[:, None], proposed, points)
        values = np.where(better, tried, values)
        kept_points.append(points)
        kept_values.append(values)
        accepted, since = accepted + float(better.mean()), since + 1
        if since == every:
            step = min(1.0, step * math.exp((accepted / since - ACCEPTANCE) / math.sqrt(count)))
            accepted, since = 0.0, 0
    return np.stack(kept_points, 1).reshape(-1, points.shape[1]), np.stack(kept_values, 1).ravel(), step


def _correlation(above: np.ndarray, share: float) -> float:
    """Return the sum of correlations within chains by which the variance of a share grows (Au and Beck 2001, (29)).

    Args:
        above: Whether points lie above the threshold, ``(chain, length)``.
        share: How many do.
    """
    length = above.shape[1]
    off = above - share
    variance = share * (1.0 - share)
    if length == 1 or variance == 0.0:
        return 0.0
    lags = range(1, length)
    return 2.0 * sum((1.0 - k / length) * float(np.mean(off[:, :-k] * off[:, k:])) / variance for k in lags)
