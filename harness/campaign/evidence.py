"""Ratios of errors with intervals, and the verdict on a claim that they allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np
from numpy.typing import NDArray
from scipy import stats

from harness.statistics import Interval

RESAMPLES = 2000


class Verdict(Enum):
    """What our data say of a claim."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    UNDECIDED = "cannot be decided"


@dataclass(frozen=True)
class Evidence:
    """One number behind a claim.

    Attributes:
        what: What it is about, e.g. ``EKF, lateral force``.
        value: The number with its 95 % interval.
        region: Where it must lie for the claim to hold, both ends included.
        theirs: The dissertation's number; NaN where it gives none.
        n: Number of runs behind it.
    """

    what: str
    value: Interval
    region: tuple[float, float]
    theirs: float
    n: int

    @property
    def verdict(self) -> Verdict:
        """Whether the whole interval lies in the region, wholly outside, or across its edge."""
        low, high = self.region
        if not np.isfinite(self.value.value):
            return Verdict.UNDECIDED
        if low <= self.value.lower and self.value.upper <= high:
            return Verdict.REPRODUCED
        return Verdict.NOT_REPRODUCED if self.value.upper < low or self.value.lower > high else Verdict.UNDECIDED


def judge(evidence: Sequence[Evidence]) -> Verdict:
    """Return the verdict on a claim: one number against it refutes it, all must lie within to confirm it."""
    verdicts = {e.verdict for e in evidence}
    if Verdict.NOT_REPRODUCED in verdicts:
        return Verdict.NOT_REPRODUCED
    return Verdict.UNDECIDED if Verdict.UNDECIDED in verdicts or not verdicts else Verdict.REPRODUCED


def ratio_of_medians(
    errors: NDArray[np.float64], reference: NDArray[np.float64], *, paired: bool = True, seed: int = 0
) -> tuple[Interval, int]:
    """Return the median of ``errors`` over that of ``reference`` with a percentile bootstrap interval.

    The drives are chosen, not drawn: every resample keeps their shares. Pairs are drawn together, since the studies
    use common random numbers: what a drive or a noise does to both groups does not widen the interval.

    Args:
        errors: RMSE of the group in question, ``(drive, sample, repeat)``; NaN where there is none.
        reference: The same of the group compared with.
        paired: Whether the same place in both is the same drive and noise; then a pair needs both numbers. Else both
            groups are drawn on their own and may differ in samples and repeats.
        seed: Seed of the bootstrap.

    Returns:
        The ratio, NaN if a group is empty; and the runs of ``errors`` that it stands on.
    """
    above = errors.reshape(errors.shape[0], -1)
    below = reference.reshape(reference.shape[0], -1)
    if paired:
        both = np.isfinite(above) & np.isfinite(below)
        above, below = np.where(both, above, np.nan), np.where(both, below, np.nan)
    count = int(np.isfinite(above).sum())
    if not count or not np.isfinite(below).any():
        return Interval(np.nan, np.nan, np.nan), 0
    rng = np.random.default_rng(seed)
    first = _resampled(above, rng)
    medians = np.median(above[np.isfinite(above)]), np.median(below[np.isfinite(below)])
    second = _resampled(below, np.random.default_rng(seed) if paired else rng)
    ratios = first / second
    lower, upper = np.quantile(ratios, [0.025, 0.975])
    return Interval(float(medians[0] / medians[1]), float(lower), float(upper)), count


def _resampled(values: NDArray[np.float64], rng: np.random.Generator) -> NDArray[np.float64]:
    """Return the median of each resample; every row is redrawn within itself, so equal generators draw pairs."""
    parts = []
    for row in values:
        finite = row[np.isfinite(row)]
        if finite.size:
            parts.append(finite[rng.integers(0, finite.size, (RESAMPLES, finite.size))])
    return np.median(np.concatenate(parts, axis=1), axis=1)


def share(count: int, total: int) -> Interval:
    """Return a share with its exact (Clopper-Pearson) 95 % interval."""
    found = stats.binomtest(count, total).proportion_ci(0.95, "exact")
    return Interval(count / total, float(found.low), float(found.high))
