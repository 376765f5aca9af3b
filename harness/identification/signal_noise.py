"""Noise of a signal by the signal alone: its white part, and the steps in which it is recorded."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.identification.data import DriveData

_FURTHEST_BELOW = 100.0
"""Factor by which the variance of a sensor's noise may be below that of the fourth differences: they count quick motion
as noise, but hardly ten times the deviation."""

_ALIKE = 1e-9
"""Share of a signal's range below which two values differ by rounding."""


@dataclass(frozen=True)
class SignalNoise:
    """Noise of the outputs of some drives.

    Attributes:
        quantisation: Variance that the steps of each signal make ``(ny,)``.
        least: Variance below which no fit may take its noise ``(ny,)``: a filter whose process noise follows every
            sample would let it run to zero; 0 where a signal shows none.
    """

    quantisation: Floats
    least: Floats


def signal_noise(drives: Sequence[DriveData]) -> SignalNoise:
    """Return the noise of the outputs of drives."""
    outputs = range(drives[0].measurements.shape[1])
    steps = np.array([resolution(drives, a) for a in outputs]) ** 2 / 12.0
    white = np.array([white_noise(drives, a) for a in outputs])
    return SignalNoise(steps, np.maximum(steps, white / _FURTHEST_BELOW))


def resolution(drives: Sequence[DriveData], output: int) -> float:
    """Return the smallest step between values of an output: that of its quantisation, if it has one."""
    values = np.concatenate([d.measurements[:, output] for d in drives])
    values = np.unique(values[np.isfinite(values)])
    steps = np.diff(values)
    steps = steps[steps > _ALIKE * (values[-1] - values[0])] if steps.size else steps
    return float(steps.min()) if steps.size else 0.0


def white_noise(drives: Sequence[DriveData], output: int) -> float:
    """Return the variance of the white noise on an output of drives."""
    return white_variance([d.measurements[:, output] for d in drives])


def white_variance(signals: Sequence[Floats]) -> float:
    """Return the variance of the white noise on signals, from their fourth differences; 0 if there are none.

    They leave of a smooth signal only noise: white noise of variance ``r`` gives fourth differences of variance
    ``70 r``.
    """
    rest = np.concatenate([np.diff(s, 4) for s in signals])
    rest = rest[np.isfinite(rest)]
    # The median is robust against spikes; 0.6745 is the median magnitude of a standard normal number.
    return float(np.median(np.abs(rest)) / 0.6745) ** 2 / 70.0 if rest.size else 0.0
