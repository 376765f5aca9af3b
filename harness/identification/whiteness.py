"""Is what a filter left unexplained white? Ljung-Box test and cumulative periodogram of whitened innovations."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy import stats

from harness.common.arrays import Floats

LAGS = 20
"""Lags of the Ljung-Box test."""

REJECTED = 0.01
"""p-value below which a series counts as coloured; in a long one that may be little."""

FEWEST = 4 * LAGS
"""Samples below which nothing is tested."""


@dataclass(frozen=True)
class Whiteness:
    """Tests of one series of innovations.

    Attributes:
        variance: Mean square; 1 if the filter states its uncertainty rightly.
        correlation: Sum of the squared correlations with the past, over the lags.
        ljung_box: p-value against correlation over time.
        periodogram: p-value of the cumulative periodogram against that of white noise.
        frequency: Share of the sampling frequency, 0 to 0.5.
        cumulative: Share of the power below it.
        band: Half-width of the 95 % band about the straight line.
    """

    variance: float
    correlation: float
    ljung_box: float
    periodogram: float
    frequency: Floats
    cumulative: Floats
    band: float


def is_white(found: Whiteness) -> bool:
    """Whether no test rejects that a series is white; one that is too short is not tested."""
    return not min(found.ljung_box, found.periodogram) < REJECTED


def whiteness(series: Floats) -> Whiteness:
    """Test a series ``(samples,)``; missing samples (NaN) leave the correlation of the others as it is.

    The statistic of Ljung and Box (1978) is ``n (n + 2) sum r_k^2 / (n - k)`` over the lags, chi-square with as many
    degrees of freedom; with gaps, ``n - k`` is the number of pairs. The cumulative periodogram (Bartlett 1955) is
    compared with a straight line by the distribution of Kolmogorov; it joins the samples across gaps.
    """
    seen = np.isfinite(series)
    n = int(seen.sum())
    if n < FEWEST or np.ptp(series[seen]) == 0:
        nothing = np.empty(0)
        mean = float(np.mean(series[seen] ** 2)) if n else np.nan
        return Whiteness(mean, np.nan, np.nan, np.nan, nothing, nothing, np.nan)
    filled = np.where(seen, series - series[seen].mean(), 0.0)
    power = float(filled @ filled) / n
    total = 0.0
    for k in range(1, LAGS + 1):
        pairs = int((seen[k:] & seen[:-k]).sum())
        if pairs:
            r = float(filled[k:] @ filled[:-k]) / pairs / power
            total += pairs * (n + 2) / n * r * r
    spectrum = np.abs(np.fft.rfft(filled[seen])) ** 2
    ordinates = spectrum[1 : (n - 1) // 2 + 1]
    cumulative = np.cumsum(ordinates) / ordinates.sum()
    count = len(ordinates)
    line = np.arange(1, count + 1) / count
    distance = float(np.abs(cumulative - line).max())
    return Whiteness(
        variance=float(np.mean(series[seen] ** 2)),
        correlation=total / (n + 2),
        ljung_box=float(stats.chi2.sf(total, LAGS)),
        periodogram=float(stats.kstwobign.sf(distance * np.sqrt(count - 1))),
        frequency=np.arange(1, count + 1) / n,
        cumulative=cumulative,
        band=float(stats.kstwobign.ppf(0.95) / np.sqrt(count - 1)),
    )
