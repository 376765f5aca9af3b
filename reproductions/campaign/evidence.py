"""Ratios of errors with intervals, and the verdict on a claim that they allow."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from enum import Enum

import numpy as np

from harness.common.arrays import Floats
from harness.common.statistics import Interval

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


def ratio_of_medians(errors: Floats, reference: Floats, seed: int = 0) -> tuple[Interval, int]:
    """Return the median of ``errors`` over that of ``reference`` with a percentile bootstrap interval.

    The drives are chosen, not drawn: every resample keeps their shares. Pairs are drawn together, since the studies
    use common random numbers: what a drive or a noise does to both groups does not widen the interval.

    Args:
        errors: RMSE of the group in question, ``(drive, sample, repeat)``; NaN where there is none.
        reference: That of the group compared with, in which the same place is the same drive and noise. A pair needs
            both numbers.
        seed: Seed of the bootstrap.

    Returns:
        The ratio, NaN if there is no pair; and the number of pairs.
    """
    above, below = errors.reshape(errors.shape[0], -1), reference.reshape(reference.shape[0], -1)
    both = np.isfinite(above) & np.isfinite(below)
    if not both.any():
        return Interval(np.nan, np.nan, np.nan), 0
    rng = np.random.default_rng(seed)
    drawn = []
    for of_drive, of_reference, pair in zip(above, below, both, strict=True):
        pairs = np.stack([of_drive[pair], of_reference[pair]])
        if pairs.size:
            drawn.append(pairs[:, rng.integers(0, pairs.shape[1], (RESAMPLES, pairs.shape[1]))])
    first, second = np.median(np.concatenate(drawn, axis=2), axis=2)
    lower, upper = np.quantile(first / second, [0.025, 0.975])
    return Interval(float(np.median(above[both]) / np.median(below[both])), float(lower), float(upper)), int(both.sum())


def share(count: int, total: int) -> Interval:
    """Return a share with its exact (Clopper-Pearson) 95 % interval."""
    from scipy.stats import binomtest  # takes longer to import than what a study's report says of these findings

    interval = binomtest(count, total).proportion_ci(0.95, "exact")
    return Interval(count / total, float(interval.low), float(interval.high))
