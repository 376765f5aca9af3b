"""Shares of the variance of an outcome from given data: closed and total Sobol indices of groups, and Shapley effects.

The data are points of a joint distribution of factors, in independent scramblings. Of a set of factors, the closed
index is the share of the variance that is gone once these are known, ``Var E[Y | X_u] / Var Y``; the total index is
what is lost of the explained variance while they alone are unknown. Where factors depend on each other, part of a
share is that of others, and shares of single factors do not add up. The Shapley effect (Owen 2014, doi
10.1137/130936233; Owen and Prieur 2017, doi 10.1137/16M1097717) gives each what it adds to the others' share, in the
mean over all orders in which factors become known: these effects are not negative and add up to the share that all
explain.

``E[Y | X_u]`` is that of a Gaussian-process regression over the normal scores of the factors, in closed form. For each
scrambling it is made from all others, and its share is ``2 Cov(Y, g) - Var(g)``, whose error is of second order in that
of the regression ``g`` (Williamson et al. 2023, doi 10.1080/01621459.2021.2003200). That error is added, as large as
the process itself expects, scaled so that it is right for the whole regression. Intervals are those of Student's t over
the scramblings, widened by what was added as an independent error.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.common.statistics import Interval, over_replicates
from harness.study.gaussian_process import Regression, fitted

MOST_PLAYERS = 8
"""Groups up to which Shapley effects are of all sets of them, beyond it of orders at random."""

_MOST_TRAINED = 1024
"""Points that a regression is made from."""

FEWEST = 64
"""Points below which no share is estimated."""


@dataclass(frozen=True)
class Shares:
    """Shares of the variance of one outcome, with their 95 % intervals, one of each per group.

    Attributes:
        first: Closed Sobol indices.
        total: Total Sobol indices.
        shapley: Shapley effects.
        explained: Share that all factors explain together; the rest is noise, and what the regression misses.
    """

    first: tuple[Interval, ...]
    total: tuple[Interval, ...]
    shapley: tuple[Interval, ...]
    explained: Interval

    @property
    def order(self) -> list[int]:
        """Groups from the largest Shapley effect to the smallest."""
        return [int(i) for i in np.argsort([-share.value for share in self.shapley], kind="stable")]


def shares(
    scores: Floats, outcome: Floats, correlation: Floats, groups: Sequence[Sequence[int]], level: float = 0.95
) -> Shares | None:
    """Return the shares of groups of factors in the variance of an outcome.

    Args:
        scores: Normal scores of the factors, ``(scrambling, point, factor)``.
        outcome: Finite, ``(scrambling, point)``.
        correlation: Of the scores, ``(factor, factor)``.
        groups: Factors of each group, which together are all.
        level: Confidence level.

    Returns:
        ``None`` if the outcome does not vary, or of fewer than ``FEWEST`` points or two scramblings.
    """
    if len(outcome) < 2 or outcome.size < FEWEST or np.ptp(outcome) <= 1e-12 * np.abs(outcome).max():
        return None
    variances = _Variances(scores, outcome, correlation)
    whole = np.mean(np.square(variances.off), axis=1)

    def share(part: Floats) -> Interval:
        estimates, added = part[:-1], float(part[-1] / whole.mean())
        value = float(estimates.mean() / whole.mean())
        narrow = over_replicates(value, (estimates - value * whole) / whole.mean(), level)
        half = math.hypot(value - narrow.lower, added)
        return Interval(value, value - half, value + half)

    def closed(players: Sequence[int]) -> Floats:
        return variances.closed(tuple(sorted(i for player in players for i in groups[player])))

    players = range(len(groups))
    everything = closed(players)
    if len(groups) <= MOST_PLAYERS:
        known = {s: closed(s) for k in range(len(groups) + 1) for s in itertools.combinations(players, k)}
        effects = tuple(share(_shapley(player, len(groups), known)) for player in players)
    else:
        effects = tuple(map(share, _of_orders(len(groups), len(outcome), closed)))
    return Shares(
        tuple(share(closed([player])) for player in players),
        tuple(share(everything - closed([p for p in players if p != player])) for player in players),
        effects,
        share(everything),
    )


def _shapley(player: int, count: int, known: dict[tuple[int, ...], Floats]) -> Floats:
    """Return the Shapley value of a player, of the shape of the worths (Owen 2014, (2))."""
    total = np.zeros_like(known[()])
    for before, worth in known.items():
        if player not in before:
            orders = math.factorial(len(before)) * math.factorial(count - len(before) - 1) / math.factorial(count)
            total += orders * (known[tuple(sorted((*before, player)))] - worth)
    return total


def _of_orders(count: int, scramblings: int, closed: Callable[[Sequence[int]], Floats]) -> Floats:
    """Return Shapley values from random orders, of the shape of the worths ``(players, scrambling + 1)``.

    In the mean over random orders, each player adds its Shapley value (Castro et al. 2009, doi
    10.1016/j.cor.2008.04.004). Each scrambling has an order and its reverse of its own, so that the scatter between
    scramblings is that of orders as well.
    """
    rng, values = np.random.default_rng(0), np.zeros((count, scramblings + 1))
    for r in range(scramblings):
        order = [int(player) for player in rng.permutation(count)]
        for each in (order, order[::-1]):
            worths = [closed(each[:k]) for k in range(count + 1)]
            for k, player in enumerate(each):
                added = worths[k + 1] - worths[k]
                values[player, r] += added[r] / 2.0
                values[player, -1] += added[-1] / (2.0 * scramblings)
    return values


class _Variances:
    """Variances of conditional expectations, one estimate for each scrambling.

    Attributes:
        off: Outcome less its mean, ``(scrambling, point)``.
    """

    def __init__(self, scores: Floats, outcome: Floats, correlation: Floats) -> None:
        count, size = outcome.shape
        self._scores, self.off = scores, outcome - outcome.mean()
        few = min(size, _MOST_TRAINED // count)
        trained, values = scores[:, :few], outcome[:, :few]
        kernel = fitted(trained.swapaxes(0, 1).reshape(-1, scores.shape[2]), values.T.ravel(), correlation)
        self._regressions = [
            Regression.of(kernel, np.concatenate(np.delete(trained, r, 0)), np.delete(values, r, 0).ravel())
            for r in range(count)
        ]
        self._kept: dict[tuple[int, ...], Floats] = {(): np.zeros(count + 1)}
        nothing = self._regressions[0]
        self._of_mean = nothing.uncertainty((), kernel.given((), scores[0, :1], nothing.points))
        self._scale = 0.0
        raw, expected = self._raw(tuple(range(scores.shape[2])))
        missed = float(np.mean(np.square(self.off)) - raw.mean())
        noise = kernel.noise * nothing.variance
        self._scale = max(missed, 0.0) / (expected + noise) if expected + noise > 0 else 0.0

    def closed(self, subset: tuple[int, ...]) -> Floats:
        """Return the variance of the expectation given some factors, and last what was added, ``(scrambling + 1,)``."""
        if subset not in self._kept:
            raw, expected = self._raw(subset)
            added = self._scale * max(expected - self._of_mean, 0.0)
            self._kept[subset] = np.append(raw + added, added)
        return self._kept[subset]

    def _raw(self, subset: tuple[int, ...]) -> tuple[Floats, float]:
        """Return the variances without the regression's error, and the mean variance that the process expects of it."""
        expectations, expected = np.empty(self.off.shape), 0.0
        for r, regression in enumerate(self._regressions):
            covariance = regression.kernel.given(subset, self._scores[r], regression.points)
            expectations[r] = covariance @ regression.weights
            if r == 0:
                expected = regression.uncertainty(subset, covariance)
            mean = regression.kernel.given((), self._scores[r, :1], regression.points) @ regression.weights
            expectations[r] -= mean
        expectations -= expectations.mean()
        return np.mean(2.0 * self.off * expectations - np.square(expectations), axis=1), expected
