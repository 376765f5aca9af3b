"""Total indices from given data: of a Gaussian process that is fitted to the points.

A nearest neighbour of a point in all factors but one, by which a total index could be read off the data, is far away
in twenty dimensions. A surrogate does better: a Gaussian process with a length of its own for each factor (Rasmussen
and Williams 2006, chapters 2 and 5). Its realisations given the data have total indices, and their scatter is what the
points leave open (Le Gratiet, Cannamela and Iooss 2014). What they leave open of the lengths shows in processes that
are fitted without a fifth of the points each.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy import linalg, optimize
from scipy.stats import qmc

from harness.common.arrays import Floats

BASE = 512
"""Points of the base sample of Jansen's estimator."""

FEATURES = 512
"""Cosines of which a realisation of the prior is made."""

REALISATIONS = 40
"""Of each process."""

PARTS = 10
"""Processes that are fitted to a part of the points, beside the one fitted to all."""

PART = 0.8
STARTS = (0.2, 0.5, 1.0, 2.0)
"""Lengths that the search for the likeliest ones begins with, in widths of the box."""

IDLE, REVIVED = 3.0, 1.0
"""A factor of a length above the first hardly counts; it is tried again with the second, since nothing leads back."""

LENGTHS, NOISES = (0.05, 30.0), (1e-5, 10.0)
"""Bounds of lengths, and of the variance of the noise over that of the process."""


@dataclass(frozen=True)
class Totals:
    """Total indices: the share of the variance that a factor has a part in, alone or with others.

    Attributes:
        value: Median over the realisations of all processes, ``(factors,)``.
        lower: 2.5 % quantile.
        upper: 97.5 % quantile.
        explained: Share of the variance that the process predicts at points left out one at a time; negative where it
            is worse than the mean.
    """

    value: Floats
    lower: Floats
    upper: Floats
    explained: float


def total_indices(places: Floats, outputs: Floats, seed: int, onto: Callable[[Floats], Floats] = np.asarray) -> Totals:
    """Return the total indices of an output over the unit box, with 95 % intervals.

    The variance that they are shares of is that of the process and of the noise about it together, so that a factor
    does not gain by what no smooth function explains.

    Args:
        places: Where the output is known, in the unit box, ``(points, factors)``.
        outputs: ``(points,)``, not all the same.
        seed: Of the parts and the realisations.
        onto: Puts places of the box where the factors can be: factors with choices have few.
    """
    x, y = onto(places), (outputs - np.mean(outputs)) / np.std(outputs)
    rng = np.random.default_rng(seed)
    whole = _likeliest(x, y, [np.log([*[start] * x.shape[1], 0.1]) for start in STARTS])
    indices = [_of_process(x, y, whole, onto, rng)]
    for _ in range(PARTS):
        part = rng.permutation(len(x))[: round(PART * len(x))]
        indices.append(_of_process(x[part], y[part], _likeliest(x[part], y[part], [whole]), onto, rng))
    lower, value, upper = np.quantile(np.concatenate(indices, axis=1), [0.025, 0.5, 0.975], axis=1)
    return Totals(value, lower, upper, _explained(x, y, whole))


def _of_process(
    x: Floats, y: Floats, theta: Floats, onto: Callable[[Floats], Floats], rng: np.random.Generator
) -> Floats:
    """Return the total indices of realisations of a process given data, ``(factors, REALISATIONS)``.

    Args:
        x: Places of the data, ``(points, factors)``.
        y: Outputs, ``(points,)``.
        theta: Logarithms of lengths and noise.
        onto: As in ``total_indices``.
        rng: Draws the realisations and the base sample.
    """
    count = x.shape[1]
    drawn = qmc.Sobol(2 * count, rng=rng).random(BASE)
    first, second = onto(drawn[:, :count]), onto(drawn[:, count:])
    lengths, noise = np.exp(theta[:-1]), float(np.exp(theta[-1]))
    factor = linalg.cho_factor(_correlation(x, x, lengths) + noise * np.eye(len(x)), lower=True)
    variance = float(y @ linalg.cho_solve(factor, y)) / len(y)
    frequencies = rng.standard_normal((count, FEATURES)) / lengths[:, None]
    phases = rng.uniform(0.0, 2 * np.pi, FEATURES)
    amplitudes = rng.standard_normal((FEATURES, REALISATIONS)) * np.sqrt(2.0 * variance / FEATURES)
    noises = np.sqrt(noise * variance) * rng.standard_normal((len(x), REALISATIONS))
    # a realisation given the data is one of the prior, moved by what it misses at the data (Wilson et al. 2020)
    moved = linalg.cho_solve(factor, y[:, None] - np.cos(x @ frequencies + phases) @ amplitudes - noises)

    def realisations(at: Floats) -> Floats:
        return np.cos(at @ frequencies + phases) @ amplitudes + _correlation(at, x, lengths) @ moved

    base = realisations(first)
    total = base.var(axis=0) + noise * variance
    indices = np.empty((count, REALISATIONS))
    for k in range(count):
        other = first.copy()
        other[:, k] = second[:, k]
        indices[k] = 0.5 * np.mean((base - realisations(other)) ** 2, axis=0) / total  # Jansen 1999
    return indices


def _explained(x: Floats, y: Floats, theta: Floats) -> float:
    """Return the share of the variance that a process predicts at each point without that point."""
    matrix = _correlation(x, x, np.exp(theta[:-1])) + np.exp(theta[-1]) * np.eye(len(x))
    inverse = linalg.inv(matrix)
    return 1.0 - float(np.mean((inverse @ y / np.diag(inverse)) ** 2)) / float(np.var(y))


def _correlation(a: Floats, b: Floats, lengths: Floats) -> Floats:
    """Return the squared exponential of the distance of places, ``(len(a), len(b))``."""
    u, v = a / lengths, b / lengths
    square = (u**2).sum(axis=1)[:, None] + (v**2).sum(axis=1) - 2.0 * u @ v.T
    return np.exp(-0.5 * np.maximum(square, 0.0))


def _likeliest(x: Floats, y: Floats, starts: Sequence[Floats]) -> Floats:
    """Return the logarithms of lengths and noise of the largest likelihood, the variance of the process eliminated."""
    apart = (x[:, None, :] - x[None, :, :]) ** 2
    bounds = [tuple(np.log(LENGTHS))] * x.shape[1] + [tuple(np.log(NOISES))]

    def cost(theta: Floats) -> tuple[float, Floats]:
        lengths, noise = np.exp(theta[:-1]), float(np.exp(theta[-1]))
        correlation = np.exp(-0.5 * (apart @ lengths**-2.0))
        factor = linalg.cho_factor(correlation + noise * np.eye(len(y)), lower=True)
        weights = linalg.cho_solve(factor, y)
        inverse = linalg.cho_solve(factor, np.eye(len(y)))
        variance = float(y @ weights) / len(y)
        value = 0.5 * len(y) * np.log(variance) + float(np.log(np.diag(factor[0])).sum())
        slope = 0.5 * (inverse - np.outer(weights, weights) / variance)
        by_length = np.tensordot(slope * correlation, apart, 2) / lengths**2
        return value, np.append(by_length, noise * np.trace(slope))

    def search(start: Floats) -> optimize.OptimizeResult:
        return optimize.minimize(cost, start, jac=True, method="L-BFGS-B", bounds=bounds)

    best = min((search(start) for start in starts), key=lambda minimum: minimum.fun)
    again = search(np.append(np.where(best.x[:-1] > np.log(IDLE), np.log(REVIVED), best.x[:-1]), best.x[-1]))
    return np.asarray(min(best, again, key=lambda minimum: minimum.fun).x)
