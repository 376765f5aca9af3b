"""Gaussian-process regression over normal scores, and its conditional expectations in closed form.

Squared-exponential covariance with a length for each score and white noise (Rasmussen and Williams 2006, 2.2 and
5.4.1). Where the scores are jointly normal, the covariance of the conditional expectations given some of them is a
Gaussian integral, so that no sampling is needed.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize

from harness.common.arrays import Floats

_MOST_FITTED = 384
"""Points that lengths and noise are fitted to."""

_BOUNDS = (-2.5, 5.0), (-16.0, 2.0)
"""Of the logarithms of lengths, in standard deviations, and of the variance of the noise over that of the function."""

_STARTS = 0.0, 1.0
"""Logarithms of the lengths that the likelihood is climbed from: of a wavy function the larger alone may miss it."""


@dataclass(frozen=True)
class Kernel:
    """Covariance of a function of normal scores, in units of its variance.

    Attributes:
        lengths: Length of each score, ``(D,)``.
        noise: Variance of the white noise.
        correlation: Of the scores, ``(D, D)``.
    """

    lengths: Floats
    noise: float
    correlation: Floats

    def given(self, subset: Sequence[int], scores: Floats, trained: Floats) -> Floats:
        """Return the covariance of the expectation given some scores at points with the function at others.

        Args:
            subset: The scores that are given.
            scores: Points, ``(n, D)``.
            trained: Others, ``(N, D)``.

        Returns:
            ``(n, N)``.
        """
        a, b = list(subset), self._others(subset)
        slope, variance = self._conditional(a, b)
        squared = self.lengths[b] ** 2
        factor = np.linalg.cholesky(np.linalg.inv(variance + np.diag(squared))) if b else np.zeros((0, 0))
        left = np.hstack([scores[:, a] / self.lengths[a], scores[:, a] @ slope.T @ factor])
        right = np.hstack([trained[:, a] / self.lengths[a], trained[:, b] @ factor])
        shrunk = np.linalg.det(np.eye(len(b)) + variance / squared[:, None]) ** -0.5
        distance = (left**2).sum(1)[:, None] + (right**2).sum(1) - 2.0 * left @ right.T
        return np.asarray(shrunk * np.exp(-0.5 * np.maximum(distance, 0.0)))

    def variance_given(self, subset: Sequence[int]) -> float:
        """Return the variance that the expectation given some scores has before any point is known."""
        b = self._others(subset)
        _, variance = self._conditional(list(subset), b)
        return float(np.linalg.det(np.eye(len(b)) + 2.0 * variance / self.lengths[b][:, None] ** 2) ** -0.5)

    def _others(self, subset: Sequence[int]) -> list[int]:
        return [i for i in range(len(self.lengths)) if i not in subset]

    def _conditional(self, a: list[int], b: list[int]) -> tuple[Floats, Floats]:
        """Return slope and covariance of the scores ``b`` given the scores ``a``."""
        across = self.correlation[np.ix_(b, a)]
        slope = across @ np.linalg.inv(self.correlation[np.ix_(a, a)]) if a else across
        return slope, self.correlation[np.ix_(b, b)] - slope @ across.T


def fitted(scores: Floats, values: Floats, correlation: Floats) -> Kernel:
    """Return the likeliest lengths and noise; the variance of the function is eliminated (profile likelihood).

    Args:
        scores: Points, ``(N, D)``; evenly spaced ones of many are taken.
        values: ``(N,)``, not all alike.
        correlation: Of the scores, ``(D, D)``.
    """
    step = -(-len(scores) // _MOST_FITTED)
    points, y = scores[::step], values[::step]
    y = (y - y.mean()) / y.std()
    count, width = points.shape
    squares = np.square(points[:, None] - points[None]).transpose(2, 0, 1)

    def likelihood(x: Floats) -> tuple[float, Floats]:
        weights, noise = np.exp(-2.0 * x[:-1]), float(np.exp(x[-1]))
        covariance = np.exp(-0.5 * np.tensordot(weights, squares, 1))
        try:
            factor = linalg.cholesky(covariance + noise * np.eye(count), lower=True)
        except linalg.LinAlgError:
            return 1e10, np.zeros(width + 1)
        inverse = linalg.cho_solve((factor, True), np.eye(count))
        weighted = inverse @ y
        variance = float(y @ weighted) / count
        slope = np.outer(weighted, weighted) / variance - inverse
        inner = slope * covariance
        gradient = [-0.5 * w * np.sum(inner * s) for w, s in zip(weights, squares, strict=True)]
        value = 0.5 * count * np.log(variance) + np.log(np.diag(factor)).sum()
        return float(value), np.array([*gradient, -0.5 * noise * np.trace(slope)])

    bounds = [_BOUNDS[0]] * width + [_BOUNDS[1]]
    climbed = [
        optimize.minimize(likelihood, [start] * width + [-7.0], jac=True, method="L-BFGS-B", bounds=bounds,
                          options={"maxiter": 60})
        for start in _STARTS
    ]  # fmt: skip
    best = min(climbed, key=lambda result: float(result.fun)).x
    return Kernel(np.exp(best[:-1]), float(np.exp(best[-1])), correlation)


@dataclass(frozen=True)
class Regression:
    """A function regressed on some points.

    Attributes:
        kernel: Its covariance.
        points: ``(N, D)``.
        weights: Of the covariances with the points, ``(N,)``.
        factor: Cholesky factor of the covariance of the values, lower.
        variance: Of the function before any point is known.
    """

    kernel: Kernel
    points: Floats
    weights: Floats
    factor: Floats
    variance: float

    @classmethod
    def of(cls, kernel: Kernel, points: Floats, values: Floats) -> Regression:
        """Return the regression of values ``(N,)`` at points ``(N, D)``."""
        everything = range(points.shape[1])
        covariance = kernel.given(everything, points, points) + kernel.noise * np.eye(len(points))
        factor = linalg.cholesky(covariance, lower=True)
        off = values - values.mean()
        weights = linalg.cho_solve((factor, True), off)
        return cls(kernel, points, weights, factor, float(off @ weights) / len(points))

    def uncertainty(self, subset: Sequence[int], covariance: Floats) -> float:
        """Return the mean variance that the expectation given some scores has left, over points.

        Args:
            subset: The scores that are given.
            covariance: ``Kernel.given`` of the points with those of the regression.
        """
        explained = np.square(linalg.solve_triangular(self.factor, covariance.T, lower=True)).sum(axis=0)
        return self.variance * float(np.maximum(self.kernel.variance_given(subset) - explained, 0.0).mean())
