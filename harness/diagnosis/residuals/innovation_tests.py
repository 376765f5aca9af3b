"""Tests of innovations: their size over time (NIS), and their correlation with the past of signals."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from harness.common.arrays import Floats

LARGEST_LAG = 2.0
"""s; longer than the memory of the vehicle dynamics."""


@dataclass(frozen=True)
class NisOverTime:
    """Normalised innovation squared (NIS), against the chi-square distribution that it has if the filter is right.

    Attributes:
        time: Middle of each window in s.
        nis: Its mean there, over the number of measured values.
        band: Ends of the 95 % band of that mean ``(2, windows)``.
        inside: Share of single samples inside the 95 % band of their own.
    """

    time: Floats
    nis: Floats
    band: Floats
    inside: float


def consistency(time: Floats, whitened: Floats, window: float = 1.0) -> NisOverTime:
    """Return the NIS of whitened innovations ``(samples, ny)`` over windows of so many seconds."""
    square, seen = np.nansum(whitened**2, axis=1), np.isfinite(whitened).sum(axis=1)
    low, high = stats.chi2.ppf([[0.025], [0.975]], np.maximum(seen, 1))
    inside = (square >= low) & (square <= high)
    edges = np.arange(time[0], time[-1] + window, window)
    which = np.digitize(time, edges) - 1
    count = np.bincount(which, seen, minlength=len(edges))
    total = np.bincount(which, square, minlength=len(edges))
    kept = count > 0
    band = stats.chi2.ppf([[0.025], [0.975]], count[kept]) / count[kept]
    share = float(inside[seen > 0].mean()) if kept.any() else np.nan
    return NisOverTime(edges[kept] + 0.5 * window, total[kept] / count[kept], band, share)


@dataclass(frozen=True)
class CrossCorrelation:
    """Correlation of whitened innovations with the past of signals.

    Attributes:
        lag: By how much the signal is earlier, in s ``(lags,)``.
        values: ``(lags, ny, signals)``.
        band: Half-width of the 95 % band about zero for white innovations ``(ny,)``.
    """

    lag: Floats
    values: Floats
    band: Floats


def cross_correlation(whitened: Sequence[Floats], signals: Sequence[Floats], step: float) -> CrossCorrelation:
    """Correlate the innovations of several drives with signals.

    White innovations are independent of everything before them, so the variance of a correlation is one over the
    number of pairs, whatever the signal looks like (Ljung 1999, 16.6).

    Args:
        whitened: By drive ``(samples, ny)``, NaN where missing.
        signals: By drive ``(samples, n)``.
        step: s between samples.
    """
    lags = np.unique(np.round(np.linspace(0, LARGEST_LAG / step, 41)).astype(int))
    mean = np.mean(np.concatenate(signals), axis=0)
    products = np.zeros((len(lags), whitened[0].shape[1], signals[0].shape[1]))
    for innovation, signal in zip(whitened, signals, strict=True):
        r, s = np.nan_to_num(innovation), signal - mean
        for j, lag in enumerate(lags[lags < len(s)]):
            products[j] += r[lag:].T @ s[: len(s) - lag]
    together = np.concatenate(whitened)
    pairs = np.isfinite(together).sum(axis=0)
    power = np.nansum(together**2, axis=0), np.sum((np.concatenate(signals) - mean) ** 2, axis=0)
    scale = np.sqrt(np.outer(*(np.maximum(p, 1e-300) for p in power)))
    return CrossCorrelation(lags * step, products / scale, 1.96 / np.sqrt(np.maximum(pairs, 1.0)))
