"""Bounds of a trust monitor by how often it may be wrong in an hour, from runs that are as believed.

Windows overlap, and the innovations of a filter whose noise is tuned are no white noise, so that bounds of independent
samples say nothing of false alarms. Each statistic counts here in the size that it reaches in one window of a hundred;
the largest of them has the one bound that it exceeds as often as is allowed. An alarm is an excess; what follows within
a window belongs to it.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from harness.common.arrays import Floats

RARE = 0.99
"""Quantile over windows that statistics are compared in."""

SMALLEST = 1.0
"""Least size that a statistic is taken to reach, in standard deviations: of what never varies nothing is known."""


@dataclass(frozen=True)
class Calibrated:
    """Bounds in standard deviations of the averages.

    Attributes:
        nis: Lower and upper.
        bias: Of each measurement.
        hours: Of driving that they are from.
        alarms: In these.
    """

    nis: tuple[float, float]
    bias: tuple[float, ...]
    hours: float
    alarms: int


def peaks(statistics: Floats, window: int) -> Floats:
    """Return the largest of NIS, negative NIS, and magnitude of each innovation by window ``(windows, 2 + ny)``."""
    sides = np.column_stack([statistics[:, 0], -statistics[:, 0], np.abs(statistics[:, 1:])])
    sides = np.where(np.isfinite(sides), sides, np.inf)
    return np.maximum.reduceat(sides, np.arange(0, len(sides), window), axis=0)


def calibrated(runs: Sequence[Floats], per_hour: float, hours: float) -> Calibrated:
    """Return bounds.

    Args:
        runs: ``peaks`` of each run.
        per_hour: Alarms allowed.
        hours: Of driving in them; the last window of a run may be cut.
    """
    together = np.concatenate(runs)
    typical = np.maximum(np.quantile(together, RARE, axis=0, method="inverted_cdf"), SMALLEST)
    evidence = [(each / typical).max(axis=1) for each in runs]
    allowed = per_hour * hours
    candidates = np.unique(np.concatenate(evidence))
    low, high = 0, len(candidates) - 1
    while low < high:  # the first that no more than allowed exceed
        middle = (low + high) // 2
        low, high = (low, middle) if _alarms(evidence, candidates[middle]) <= allowed else (middle + 1, high)
    bounds = typical * candidates[low]
    alarms = _alarms(evidence, candidates[low])
    return Calibrated((-float(bounds[1]), float(bounds[0])), tuple(map(float, bounds[2:])), hours, alarms)


def _alarms(evidence: Sequence[Floats], bound: float) -> int:
    return sum(int((np.diff((each > bound).astype(int), prepend=0) > 0).sum()) for each in evidence)


def independent(window: int, outputs: int, per_hour: float, step: float) -> tuple[tuple[float, float], float]:
    """Return bounds of the NIS and of a bias if samples were independent, in standard deviations.

    Of the average over ``n`` samples the NIS of ``m`` measurements is about chi-square of ``n m`` degrees over ``n``
    (Bar-Shalom, Li and Kirubarajan 2001, 5.4.2); windows are taken for trials, of which as many are allowed to alarm.
    """
    share = min(per_hour * window * step / 3600.0, 1.0) / (2 + outputs)
    degrees = float(window * outputs)
    low, high = scipy.stats.chi2.ppf([share, 1.0 - share], degrees)
    scale = np.sqrt(2.0 * degrees)
    return (float((low - degrees) / scale), float((high - degrees) / scale)), float(scipy.stats.norm.isf(share / 2.0))
