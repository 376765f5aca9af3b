"""Noise of a signal by the signal alone: its white part, its steps, and at which spacing of samples it is white."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats
from harness.identification.data import DriveData

_FURTHEST_BELOW = 100.0
"""Factor by which the variance of a sensor's noise may be below that of the fourth differences: they count quick motion
as noise, but hardly ten times the deviation."""

_ALIKE = 1e-9
"""Share of a signal's range below which two values differ by rounding."""

_MOTION = 5.0
"""Hz; beyond it a vehicle hardly follows its steering, and what a signal has is noise."""

_FARTHEST = 20
"""Samples over which the noise may be correlated."""

_SEGMENT = 512
"""Samples of the segments whose spectra are averaged."""


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


def white_spacing(drives: Sequence[DriveData], tolerable: float, white: float) -> tuple[int, ...]:
    """Return for each output how many samples apart its noise is white ``(ny,)``; 1 where it is nearly so.

    Anti-aliasing filters, interpolation onto a common clock and vibration correlate the noise of consecutive samples. A
    filter that takes it as white explains its spectrum by process noise and by parameters of the vehicle. Its
    autocorrelation is the transform of the spectrum (Wiener and Khinchin); at the frequencies of the vehicle's own
    motion that is continued as it is just above them. Drives that are too short or too coarse to show it do not count.

    Args:
        drives: The recordings, of one step.
        tolerable: Largest correlation that is left as it is.
        white: Correlation below which samples are taken where it is more.
    """
    spectra = [_noise_spectrum(drives, a) for a in range(drives[0].measurements.shape[1])]
    return tuple(_spacing(spectrum, tolerable, white) for spectrum in spectra)


def _noise_spectrum(drives: Sequence[DriveData], output: int) -> Floats:
    """Return the spectrum of the noise of an output, of all drives together ``(frequencies,)``; 0 if none shows it."""
    from scipy.signal import welch  # takes longer to import than all else here

    spectrum = np.zeros(_SEGMENT // 2 + 1)
    for drive in drives:
        measured = np.flatnonzero(np.isfinite(drive.measurements[:, output]))
        step = float(np.median(np.diff(drive.time[measured]))) if len(measured) > 1 else 0.0
        if len(measured) < 2 * _SEGMENT or 2.0 * _MOTION * step >= 0.5:
            continue
        even = np.arange(drive.time[measured[0]], drive.time[measured[-1]], step)
        signal = np.interp(even, drive.time[measured], drive.measurements[measured, output])
        frequency, power = welch(signal, 1.0 / step, nperseg=_SEGMENT)
        above = (frequency >= _MOTION) & (frequency < 2.0 * _MOTION)
        spectrum += np.where(frequency < _MOTION, np.median(power[above]), power)
    return spectrum


def _spacing(spectrum: Floats, tolerable: float, white: float) -> int:
    """Return how many samples apart noise of a spectrum is white."""
    covariance = np.fft.irfft(spectrum)[: _FARTHEST + 1]
    if covariance[0] <= 0.0:
        return 1
    correlation = np.abs(covariance / covariance[0])
    largest = [float(correlation[k::k].max()) for k in range(1, _FARTHEST // 2 + 1)]
    if largest[0] <= tolerable:
        return 1
    return 1 + next((i for i, c in enumerate(largest) if c <= white), int(np.argmin(largest)))


def thinned(drive: DriveData, spacing: Sequence[int]) -> DriveData:
    """Return a recording with every so many samples of each output ``(ny,)``; those in between are missing."""
    measurements = drive.measurements.copy()
    for column, every in zip(measurements.T, spacing, strict=True):
        there = np.flatnonzero(np.isfinite(column))
        column[np.delete(there, np.s_[::every])] = np.nan
    return replace(drive, measurements=measurements)
