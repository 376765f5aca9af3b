"""Statistics of reports: intervals of medians, paired comparisons, bounds of chi-square averages.

Everything here takes plain arrays and a seed, so that the same store always gives the same report. Runs that
diverged are infinitely wrong: medians, quartiles and ranks take them as larger than any other. A NaN is ignored.

Why a percentile bootstrap, stratified by drive: the median has no smooth influence function, so the jackknife
acceleration of BCa is not consistent for it, while the percentile interval is (Efron & Tibshirani, *An
Introduction to the Bootstrap*, 1993, ch. 11 and 13). The drives of a study are chosen, not drawn, therefore
each drive keeps its number of runs in every resample: the interval says where the median would fall if the
study were repeated with other noise and other Sobol points *on the same drives*. Resamples of a drive with n runs
have 1 - 1 / n of the variance that they should, so drives with few are resampled with all others as one.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import gammaincinv, ndtri, stdtrit

from harness.common.arrays import Floats

RESAMPLES = 2000
_LARGEST_DRAW = 4_000_000  # numbers drawn per interval; beyond it fewer resamples are taken, never below 400
STRATUM = 5
"""Values from which a stratum is resampled within itself. Of eight values, two on each of four drives, an interval of
95 % would hold the median of normal errors in 66 to 77 % of all samples; resampled as one, in 92 % or more."""
LARGE = 100_000
"""Values of a sample above which the bootstrap distribution of its median is computed and not drawn."""


class Interval(NamedTuple):
    """An estimate with the ends of its confidence interval."""

    value: float
    lower: float
    upper: float


@dataclass(frozen=True)
class Summary:
    """Statistics of one group of runs for a box plot.

    Attributes:
        n: Number of runs.
        median: Median with its bootstrap interval.
        lower_quartile: 25 % quantile (linear interpolation, type 7 of Hyndman & Fan 1996).
        upper_quartile: 75 % quantile.
        minimum: Smallest value.
        maximum: Largest value.
    """

    n: int
    median: Interval
    lower_quartile: float
    upper_quartile: float
    minimum: float
    maximum: float


@dataclass(frozen=True)
class PairedComparison:
    """A paired comparison of positive errors; a ratio below one where the second estimator has the smaller error.

    Attributes:
        n: Number of pairs; infinite errors of one of both count as the largest, of both not at all.
        ratio: Median of the second error over the first of its pair, with its bootstrap interval.
        wins: Number of the pairs in which the second is smaller.
        p_value: Two-sided Wilcoxon signed-rank test of a symmetric distribution of the log ratio about zero, not
            corrected.
    """

    n: int
    ratio: Interval
    wins: int
    p_value: float


_INFINITE = 1e300
"""Stands for an infinite value where order statistics are interpolated; what comes near to it is infinite."""


def _values(values: ArrayLike) -> Floats:
    """Return values that are numbers, with infinite ones so large that they can be averaged with others."""
    flat = np.asarray(values, dtype=float).ravel()
    return np.clip(flat[~np.isnan(flat)], -_INFINITE, _INFINITE)


def _numbers(values: ArrayLike) -> list[float]:
    """Return order statistics of ``_values`` as numbers, infinite where an infinite value has a part in them."""
    return [float(np.copysign(np.inf, v)) if abs(v) > _INFINITE / 1e12 else float(v) for v in np.atleast_1d(values)]


def one_sided(n: float) -> float:
    """Return the probability that all of ``n`` independent values lie on one side of the median of their distribution.

    It is the smallest p-value that a two-sided signed-rank or sign test of ``n`` pairs can have, and that with which
    the interval from their smallest to their largest misses the median.
    """
    return float(2.0 ** (1 - n))


@lru_cache(maxsize=8)
def _resampled_indices(sizes: tuple[int, ...], resamples: int, seed: int) -> NDArray[np.int32]:
    """Return indices of shape ``(resamples, sum(sizes))``, each stratum redrawn within itself."""
    rng = np.random.default_rng(seed)
    start = np.concatenate(([0], np.cumsum(sizes)))
    parts = [rng.integers(start[k], start[k + 1], (resamples, size), dtype=np.int32) for k, size in enumerate(sizes)]
    return np.concatenate(parts, axis=1)


def _by_stratum(strata: ArrayLike | None, used: NDArray[np.bool_]) -> tuple[NDArray[np.intp], tuple[int, ...]]:
    """Return the order that sorts the values used by stratum, and how many each stratum holds."""
    count = int(used.sum())
    if strata is not None:
        labels = np.asarray(strata).ravel()
        if labels.size != used.size:
            raise ValueError(f"strata have {labels.size} labels for {used.size} values; give one per value")
        labels = labels[used]
        counts = np.unique(labels, return_counts=True)[1]
        if counts.min() >= STRATUM:
            return np.argsort(labels, kind="stable"), tuple(int(c) for c in counts)
    return np.arange(count), (count,)


def median_interval(
    values: ArrayLike,
    strata: ArrayLike | None = None,
    *,
    level: float = 0.95,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> Interval:
    """Return the median with its percentile bootstrap interval.

    Args:
        values: Any shape; NaN is ignored, infinite values count as the largest.
        strata: Labels of the same shape. Each stratum is resampled within itself, unless one has fewer than ``STRATUM``
            values: then the whole sample is resampled as one.
        level: Confidence level.
        resamples: Number of bootstrap samples; fewer are drawn of a sample so large that it does not matter, and none
            above ``LARGE`` values, where the distribution that they would show is computed.
        seed: Seed of the resampling; the same seed gives the same interval.

    Returns:
        NaN throughout for an empty sample; NaN for the ends where not even the interval from the smallest to the
        largest value holds the median with that probability, for 95 % of fewer than six.
    """
    data = _values(values)
    if data.size == 0:
        return Interval(np.nan, np.nan, np.nan)
    order, sizes = _by_stratum(strata, ~np.isnan(np.asarray(values, dtype=float).ravel()))
    if one_sided(data.size) > 1.0 - level:
        return Interval(_numbers(np.median(data))[0], np.nan, np.nan)
    if data.size > LARGE:
        return _interval_of_large_sample(data[order], sizes, level)
    draws = min(resamples, max(400, _LARGEST_DRAW // data.size))
    medians = np.median(data[order][_resampled_indices(sizes, draws, seed)], axis=1)
    return Interval(*_numbers([np.median(data), *_percentiles(medians, level)]))


def _interval_of_large_sample(data: Floats, sizes: tuple[int, ...], level: float) -> Interval:
    """Return what the percentile bootstrap of the median tends to, within the memory of one copy of the sample.

    A resample has its median at or below x where at least half of its values are. Of stratum h these are a binomial
    number with mean c_h(x), the values of the stratum at or below x, and variance c_h(x) (1 - c_h(x) / n_h) (Efron &
    Tibshirani 1993, ch. 13). Their sum is normal in a sample so large, so the ends are order statistics at n / 2 plus
    and minus z times its standard deviation at the median.

    Args:
        data: The sample, stratum after stratum.
        sizes: Values of each stratum.
        level: Confidence level.
    """
    median = float(np.median(data))
    starts = np.cumsum((0, *sizes[:-1]))
    below = np.add.reduceat(data <= median, starts, dtype=np.int64)
    spread = float(np.sqrt(np.sum(below * (1.0 - below / np.array(sizes)))))
    reach = float(ndtri(0.5 + level / 2.0)) * spread
    ranks = np.clip([(data.size - 1) / 2.0 - reach, (data.size - 1) / 2.0 + reach], 0, data.size - 1)
    lower, upper = (int(np.floor(ranks[0])), int(np.ceil(ranks[1])))
    ordered = np.partition(data, (lower, upper))
    return Interval(*_numbers([median, ordered[lower], ordered[upper]]))


def summarise(values: ArrayLike, strata: ArrayLike | None = None, *, seed: int = 0) -> Summary:
    """Return the numbers of a box plot, infinite values as the largest; an empty sample gives NaN with ``n = 0``.

    Args:
        values: Any shape.
        strata: Labels for the bootstrap, see ``median_interval``.
        seed: Seed of the bootstrap.
    """
    data = _values(values)
    median = median_interval(values, strata, seed=seed)
    if data.size == 0:
        return Summary(0, median, np.nan, np.nan, np.nan, np.nan)
    minimum, lower, upper, maximum = _numbers(np.quantile(data, [0.0, 0.25, 0.75, 1.0]))
    return Summary(data.size, median, lower, upper, minimum, maximum)


def compare(first: ArrayLike, second: ArrayLike, strata: ArrayLike | None = None, *, seed: int = 0) -> PairedComparison:
    """Compare two estimators run by run.

    Args:
        first: Errors of the first estimator, any shape.
        second: Errors of the second on the same runs, same shape.
        strata: Labels for the bootstrap, see ``median_interval``.
        seed: Seed of the bootstrap.
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.asarray(second, dtype=float) / np.asarray(first, dtype=float)
        logs = _values(np.log(ratio))
    interval = median_interval(ratio, strata, seed=seed)
    if logs.size == 0:
        return PairedComparison(0, interval, 0, np.nan)
    wins = int(np.sum(logs < 0.0))
    if not np.any(logs != 0.0):  # the test statistic is undefined; there is no evidence at all
        return PairedComparison(logs.size, interval, wins, 1.0)
    from scipy.stats import wilcoxon  # takes longer to import than a report of one estimator to write

    result: Any = wilcoxon(logs)
    return PairedComparison(logs.size, interval, wins, float(result.pvalue))


def median_ratio(
    first: ArrayLike,
    second: ArrayLike,
    strata: ArrayLike | None = None,
    *,
    level: float = 0.95,
    resamples: int = RESAMPLES,
    seed: int = 0,
) -> Interval:
    """Return the median of the second sample over that of the first, with its percentile bootstrap interval.

    Runs are resampled with all that they hold, the same in both samples, so that the interval knows that both saw the
    same noise, and levels that share their noise count as one run.

    Args:
        first: ``(runs, ...)``, positive where finite.
        second: The same runs under the other condition, same shape; only what is finite in both counts.
        strata: Labels ``(runs,)``, see ``median_interval``.
        level: Confidence level.
        resamples: Number of bootstrap samples; fewer are drawn of a large sample, as in ``median_interval``.
        seed: Seed of the resampling.

    Returns:
        NaN throughout where nothing is finite in both.
    """
    pair = np.stack([np.asarray(x, dtype=float).reshape(len(np.asarray(x)), -1) for x in (first, second)])
    pair = np.where(np.isfinite(pair).all(axis=0), pair, np.nan)
    used = np.isfinite(pair[0]).any(axis=1)
    if not used.any():
        return Interval(np.nan, np.nan, np.nan)
    pair, drawn = _paired_resamples(pair, used, strata, resamples, seed)
    medians = [np.nanmedian(values[drawn], axis=(1, 2)) for values in pair]
    lower, upper = _percentiles(medians[1] / medians[0], level)
    return Interval(float(np.nanmedian(pair[1]) / np.nanmedian(pair[0])), lower, upper)


def _paired_resamples(
    pair: Floats, used: NDArray[np.bool_], strata: ArrayLike | None, resamples: int, seed: int
) -> tuple[Floats, NDArray[np.int32]]:
    """Return the runs used of two samples ``(2, runs, ...)``, and the runs of every resample ``(resamples, runs)``."""
    order, sizes = _by_stratum(strata, used)
    pair = pair[:, used][:, order]
    draws = min(resamples, max(400, _LARGEST_DRAW // pair[0].size))
    return pair, _resampled_indices(sizes, draws, seed)


def _percentiles(drawn: Floats, level: float) -> tuple[float, float]:
    """Return the ends of the percentile interval of a statistic over its resamples ``(resamples,)``."""
    tail = (1.0 - level) / 2.0
    lower, upper = np.quantile(drawn, [tail, 1.0 - tail])
    return float(lower), float(upper)


def share_of_squares(
    without: ArrayLike, whole: ArrayLike, strata: ArrayLike | None = None, *, level: float = 0.95, seed: int = 0
) -> Interval:
    """Return by what share the mean square of the second sample is above that of the first, paired run by run.

    With errors ``a`` without a cause and ``b`` with it that is ``1 - sum(a^2) / sum(b^2)``, the share that the cause
    has; below zero where the errors are smaller with it. The interval is a percentile bootstrap over runs.

    Args:
        without: Errors by run, any shape.
        whole: The same runs under the other condition, same shape; only what is finite in both counts.
        strata: Labels, see ``median_interval``.
        level: Confidence level.
        seed: Seed of the resampling.

    Returns:
        NaN throughout where nothing is finite in both, or all errors are zero.
    """
    pair = np.stack([np.asarray(x, dtype=float).ravel() ** 2 for x in (without, whole)])
    used = np.isfinite(pair).all(axis=0)
    if not used.any() or not pair[1, used].any():
        return Interval(np.nan, np.nan, np.nan)
    pair, drawn = _paired_resamples(pair, used, strata, RESAMPLES, seed)
    sums = pair[:, drawn].sum(axis=2)
    lower, upper = _percentiles(1.0 - sums[0] / sums[1], level)
    return Interval(float(1.0 - pair[0].sum() / pair[1].sum()), lower, upper)


def holm(p_values: ArrayLike) -> Floats:
    """Return p-values adjusted for the number of comparisons (Holm 1979), in the order given.

    The smallest of m is multiplied by m, the next by m - 1 and so on; an adjusted value is never smaller
    than the one before it, nor larger than 1. Rejecting where it is below 0.05 keeps the probability of any
    false rejection below 0.05, whatever the dependence. NaN (a comparison that could not be made) stays NaN
    and is not counted.
    """
    p = np.asarray(p_values, dtype=float)
    adjusted = np.full(p.shape, np.nan)
    tested = np.flatnonzero(np.isfinite(p))
    order = tested[np.argsort(p[tested], kind="stable")]
    factors = np.arange(order.size, 0, -1)
    adjusted[order] = np.minimum(np.maximum.accumulate(factors * p[order]), 1.0)
    return adjusted


def average_bounds(dimension: float, count: float, level: float = 0.95) -> tuple[float, float]:
    """Return the two-sided bounds of the average of ``count`` independent chi-square variables.

    The sum of ``count`` independent chi-square variables of ``dimension`` degrees of freedom is chi-square
    with ``count * dimension`` (Bar-Shalom, Li & Kirubarajan, *Estimation with Applications to Tracking and
    Navigation*, 2001, 5.4.2). For NIS, ``count`` is the number of updates of all runs, since the innovations
    of a consistent filter are white. For NEES it is the number of runs: state errors are correlated over
    time, and the average over one run cannot vary more than a single sample, so the bounds are on the safe
    side.

    Returns:
        Lower and upper bound of the average; its expectation is ``dimension``. NaN where ``count`` is 0.
    """
    if not count * dimension > 0:
        return np.nan, np.nan
    tail = (1.0 - level) / 2.0
    freedom = count * dimension
    lower, upper = (2.0 * float(gammaincinv(freedom / 2.0, p)) / count for p in (tail, 1.0 - tail))
    return lower, upper


def tail_mean(values: ArrayLike, share: float = 0.05) -> float:
    """Return the mean of the largest ``share`` of values: their conditional value at risk at level ``1 - share``.

    A value at the edge of the tail counts with the part of its weight that lies in it (Rockafellar and Uryasev 2002,
    Proposition 8), so that the result does not jump where ``share`` times their number is no whole number.

    Args:
        values: Any number of them; one that is infinite makes the result so if it is in the tail.
        share: Above 0, at most 1.
    """
    largest = np.sort(np.ravel(np.asarray(values, dtype=float)))[::-1]
    remaining = share * largest.size - np.arange(largest.size)
    weights = np.clip(remaining, 0.0, 1.0)
    counted = weights > 0
    return float(np.sum(largest[counted] * weights[counted]) / np.sum(weights))


WORSE = 0.05
"""Share by which a mean square error must grow to count as worse."""

_SURE, _DRAWS = 0.975, 1000
"""Share of the draws of a block bootstrap in which it must grow, and their number."""


def grows(growth: Floats) -> bool:
    """Return whether a mean square error grows by more than ``WORSE``, and surely.

    Args:
        growth: Growth of the squared error in blocks of the drives, over its mean before ``(blocks,)``; what is not
            finite does not count.
    """
    usable = growth[np.isfinite(growth)]
    if not usable.size or usable.mean() < WORSE:
        return False
    drawn = np.random.default_rng(0).integers(len(usable), size=(_DRAWS, len(usable)))
    return bool(np.mean(usable[drawn].mean(axis=1) > 0) >= _SURE)


def over_replicates(value: float, deviations: ArrayLike, level: float = 0.95) -> Interval:
    """Return an estimate that is the mean of independent replicates with its interval by Student's t.

    Args:
        value: The estimate.
        deviations: Of each replicate from it, ``(replicate,)``, at least two.
        level: Confidence level.
    """
    off = np.asarray(deviations, dtype=float)
    half = float(stdtrit(off.size - 1, 0.5 + level / 2) * off.std(ddof=1) / np.sqrt(off.size))
    return Interval(value, value - half, value + half)
