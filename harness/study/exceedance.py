"""Probability that an error exceeds a limit, its quantiles and its tail, from independent scramblings of a population.

Intervals are those of Student's t over the scramblings. That of a quantile is the interval of the probability to stay
below it, carried back through the distribution function (Woodruff 1952). The tail is the conditional value at risk, the
mean of the largest errors; as a function of the quantile it is flat there (Rockafellar and Uryasev 2002, theorem 10),
so that the scatter of the quantile adds nothing to its interval.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.common.statistics import Interval, over_replicates

QUANTILES = (0.5, 0.95, 0.99)
"""Probabilities of the quantiles of a report."""

TAIL = 0.05
"""Share of the population that the tail is the mean of."""

FEW = 5
"""Events, or their opposites, in the mean over the scramblings, below which they are too few for Student's t."""


@dataclass(frozen=True)
class Exceedance:
    """How often a limit is exceeded.

    Attributes:
        probability: With its interval at 95 %.
        events: Points at which the limit is exceeded.
        points: All of them.
        exact: Whether the interval is Clopper and Pearson's of independent points, as events are few.
    """

    probability: Interval
    events: int
    points: int
    exact: bool

    def needed(self, half_width: float) -> int:
        """Return how many points the interval needs to be as narrow, where it shrinks as the root of their number."""
        half = (self.probability.upper - self.probability.lower) / 2.0
        return math.ceil(self.points * (half / half_width) ** 2)


def exceedance(errors: Floats, limit: float, level: float = 0.95) -> Exceedance:
    """Return how often errors exceed a limit.

    Args:
        errors: ``(scrambling, point)``, infinite where a run was lost.
        limit: The limit.
        level: Confidence level.
    """
    broken = errors > limit
    events, points = int(broken.sum()), broken.size
    value = events / points
    if min(events, points - events) < FEW * len(errors):
        return Exceedance(Interval(value, *_exact(events, points, level)), events, points, True)
    interval = over_replicates(value, broken.mean(axis=1) - value, level)
    return Exceedance(Interval(value, max(interval.lower, 0.0), min(interval.upper, 1.0)), events, points, False)


def _exact(events: int, points: int, level: float) -> tuple[float, float]:
    """Return the interval of a probability by Clopper and Pearson (1934)."""
    from scipy.special import betaincinv

    beyond = (1.0 - level) / 2.0
    lower = float(betaincinv(events, points - events + 1, beyond)) if events else 0.0
    upper = float(betaincinv(events + 1, points - events, 1.0 - beyond)) if events < points else 1.0
    return lower, upper


def quantile(errors: Floats, share: float, level: float = 0.95) -> Interval:
    """Return a quantile of errors with its interval; an end is infinite where only lost runs lie beyond it.

    Args:
        errors: ``(scrambling, point)``, infinite where a run was lost.
        share: Its probability.
        level: Confidence level.
    """
    ordered = np.append(np.sort(errors.ravel()), np.inf)

    def at(probability: float) -> float:
        return float(ordered[min(max(math.ceil(probability * errors.size) - 1, 0), errors.size)])

    value = at(share)
    inside = np.mean(errors <= value, axis=1)
    if np.ptp(inside) == 0.0:  # so few points that the scramblings do not differ
        from scipy.stats import binom

        low, high = (int(binom.ppf(p, errors.size, share)) for p in ((1.0 - level) / 2.0, (1.0 + level) / 2.0))
        return Interval(value, float(ordered[max(low - 1, 0)]), float(ordered[high]))
    below = over_replicates(share, inside, level)
    upper = below.upper if below.upper < 1.0 else 1.0 + 1.0 / errors.size  # beyond the largest error nothing is known
    return Interval(value, at(below.lower), at(upper))


def mixture_quantile(several: Sequence[Floats], shares: Sequence[float], share: float, level: float = 0.95) -> Interval:
    """Return a quantile of errors of which each is with its share from one of several populations; as ``quantile``.

    Args:
        several: Of each population ``(scrambling, point)``.
        shares: Of each, which add up to one.
        share: Probability of the quantile.
        level: Confidence level.
    """
    pooled = np.concatenate([errors.ravel() for errors in several])
    order = np.argsort(pooled)
    weights = np.concatenate([np.full(e.size, w / e.size) for w, e in zip(shares, several, strict=True)])
    up_to = np.cumsum(weights[order])
    ordered = np.append(pooled[order], np.inf)

    def at(probability: float) -> float:
        return float(ordered[np.searchsorted(up_to, probability - 1e-12)])

    value = at(share)
    inside = np.tensordot(shares, [np.mean(errors <= value, axis=1) for errors in several], 1)
    below = over_replicates(share, inside, level)
    return Interval(value, at(max(below.lower, 0.0)), at(below.upper))


def between_share(several: Sequence[Floats], shares: Sequence[float], level: float = 0.95) -> Interval:
    """Return the share of the variance of an error that is gone once it is known from which population the vehicle is.

    By the law of total variance, ``Var E[Y | model] / Var Y``, of which the interval is by the scramblings.

    Args:
        several: Of each population ``(scrambling, point)``, finite.
        shares: Of each, which add up to one.
        level: Confidence level.
    """

    def of(errors: Sequence[Floats]) -> Floats:
        means, variances = (np.array([f(each, axis=-1) for each in errors]) for f in (np.mean, np.var))
        between = np.tensordot(shares, np.square(means - np.tensordot(shares, means, 1)), 1)
        return np.asarray(between / (between + np.tensordot(shares, variances, 1)))

    value = float(of([e.ravel() for e in several]))
    interval = over_replicates(value, of(several) - value, level)
    return Interval(value, max(interval.lower, 0.0), min(interval.upper, 1.0))


def tail_interval(errors: Floats, share: float = TAIL, level: float = 0.95) -> Interval:
    """Return the mean of the largest errors with its interval (conditional value at risk); infinite with a lost run.

    Args:
        errors: ``(scrambling, point)``, infinite where a run was lost.
        share: Of the errors that are averaged.
        level: Confidence level.
    """
    if not np.isfinite(errors).all():
        return Interval(np.inf, np.inf, np.inf)
    begin = float(np.quantile(errors, 1.0 - share, method="inverted_cdf"))
    each = begin + np.mean(np.maximum(errors - begin, 0.0), axis=1) / share
    return over_replicates(float(each.mean()), each - each.mean(), level)
