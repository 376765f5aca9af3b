"""Rank the factors of a study: which share of the variance of an error does each of them explain?

Sobol indices of a ``saltelli`` design (``harness.study.design``) by SALib: first order by Saltelli et al. 2010 (doi
10.1016/j.cpc.2009.09.018, table 2, line b), total by Jansen 1999 (line f). The first-order index is the share of the
variance that is gone once the factor is known; the total index is the share that is left while it alone is unknown.
They differ by what the factor does together with others.

A diverged run is infinitely wrong, and leaving it out would destroy the pairs of points that the estimates are made of.
``scored`` therefore gives it the largest error that any other run had for the same target on the same drive. The
influence of that rule is seen from the indices of the ranks, which it hardly changes, and of the share of diverged
runs, which it does not change.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from harness.common.arrays import Floats
from harness.common.statistics import Interval

RESAMPLES = 500
FEWEST = 16
"""Samples below which indices are not estimated."""


@dataclass(frozen=True)
class Indices:
    """Sobol indices of one outcome with their 95 % bootstrap intervals, one of each per factor.

    Attributes:
        samples: Base samples N that they are estimated from.
        first: First-order indices.
        total: Total indices.
        lead: By how much the largest total index exceeds the second; NaN with a single factor. Both come from the
            same resamples, so the interval is narrower than those of the two suggest.
    """

    samples: int
    first: tuple[Interval, ...]
    total: tuple[Interval, ...]
    lead: Interval

    @property
    def order(self) -> list[int]:
        """Factors from the largest total index to the smallest."""
        return [int(i) for i in np.argsort([-t.value for t in self.total], kind="stable")]


def sobol_indices(
    outcome: ArrayLike, factors: int, *, seed: int = 0, resamples: int = RESAMPLES, level: float = 0.95
) -> Indices | None:
    """Return the Sobol indices of an outcome of a ``saltelli`` design.

    The bootstrap draws base samples, each with all its points. Of the functions with known indices in
    ``tests/study/test_sobol_indices.py`` its intervals hold the true index in 86 to 100 % of scramblings from 256 base
    samples on, mostly in more than the nominal 95 %, since points of a Sobol sequence are spread more evenly than
    independent ones; with 128 it is 80 % in the worst case.

    Args:
        outcome: One finite value per point in the order of the design, ``(N * (factors + 2),)``.
        factors: Number of factors.
        seed: Seed of the bootstrap.
        resamples: Number of bootstrap samples.
        level: Confidence level.

    Returns:
        The indices, or ``None`` if the outcome does not vary, so that there is nothing to explain.

    Raises:
        ValueError: If the number of values fits no such design, or one of them is not finite.
    """
    from SALib.analyze import sobol

    values = np.asarray(outcome, dtype=np.float64)
    if values.ndim != 1 or values.size == 0 or values.size % (factors + 2):
        raise ValueError(
            f"{values.shape} values fit no design of {factors} factors, which has N * {factors + 2} points"
        )
    if not np.isfinite(values).all():
        raise ValueError("an outcome is not finite; score diverged runs first (harness.study.sobol_indices.scored)")
    if np.ptp(values) <= 1e-12 * np.abs(values).max():
        return None
    names = [str(i) for i in range(factors)]
    problem = {"num_vars": factors, "names": names, "bounds": [[0.0, 1.0]] * factors}
    with np.errstate(invalid="ignore", divide="ignore"):  # a resample of equal outcomes has no indices
        estimated = sobol.analyze(
            problem,
            values,
            calc_second_order=False,
            num_resamples=resamples,
            keep_resamples=True,
            seed=seed + 1,  # SALib takes 0 for no seed
        )
    ends = 50.0 * np.array([1.0 - level, 1.0 + level])

    def intervals(kind: str) -> tuple[Interval, ...]:
        lower, upper = np.nanpercentile(estimated[f"{kind}_conf_all"], ends, axis=0)
        return tuple(Interval(*map(float, row)) for row in zip(estimated[kind], lower, upper, strict=True))

    lead = Interval(np.nan, np.nan, np.nan)
    if factors > 1:
        first, second = np.argsort(-estimated["ST"], kind="stable")[:2]
        resampled = estimated["ST_conf_all"][:, first] - estimated["ST_conf_all"][:, second]
        lead = Interval(
            float(estimated["ST"][first] - estimated["ST"][second]), *map(float, np.nanpercentile(resampled, ends))
        )
    return Indices(values.size // (factors + 2), intervals("S1"), intervals("ST"), lead)


def converging(outcome: ArrayLike, factors: int, *, seed: int = 0, resamples: int = RESAMPLES) -> list[Indices]:
    """Return the indices from the first 16, 32, 64 ... base samples of a design, up to all of them.

    The first points of a scrambled Sobol sequence are a smaller design of the same kind, so these are the results that
    a study of that size would have had.
    """
    values = np.asarray(outcome, dtype=np.float64)
    total = values.size // (factors + 2)
    sizes = [n for n in (1 << k for k in range(total.bit_length())) if FEWEST <= n <= total]
    growing = (sobol_indices(values[: n * (factors + 2)], factors, seed=seed, resamples=resamples) for n in sizes)
    return [indices for indices in growing if indices is not None]


def scored(rmse: Floats) -> Floats:
    """Return errors in which every diverged run has the largest error of any other on its drive.

    Args:
        rmse: ``(estimator, drive, sample, repeat)``, infinite where a run diverged, NaN where there is none.

    Returns:
        The same shape; NaN where there is none, and on a drive on which every run diverged.
    """
    finished = np.where(np.isfinite(rmse), rmse, -np.inf)
    largest = finished.max(axis=(0, 2, 3), keepdims=True)
    return np.where(np.isinf(rmse), np.where(np.isfinite(largest), largest, np.nan), rmse)


def over_drives(scores: Floats) -> Floats:
    """Return one error per point: the root of the mean square over drives and repeats, all drives alike.

    Args:
        scores: ``(..., drive, sample, repeat)``, infinite where a run diverged; a drive without any score (NaN) is
            left out.

    Returns:
        ``(..., sample)``.
    """
    squares = np.square(scores)
    used = ~np.isnan(squares)
    count = used.sum(axis=(-3, -1))
    total = np.where(used, squares, 0.0).sum(axis=(-3, -1))
    return np.asarray(np.sqrt(np.divide(total, count, out=np.full(total.shape, np.nan), where=count > 0)))


def ranks(values: ArrayLike) -> Floats:
    """Return the ranks of values, ties shared: what remains of an outcome when only its order counts."""
    from scipy.stats import rankdata  # only designs with indices need what takes long to import

    return np.asarray(rankdata(values), dtype=np.float64)
