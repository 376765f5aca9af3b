"""A signal measured with noise, and its rate, as they are known while it comes in: from the past alone.

The kinematic model is that of ``kinematic_smoother``: a random walk of the rate, of an intensity that changes. What
cannot be had without the future is replaced by what is known beforehand: the noise is stated, and the intensities lie
around a fixed bandwidth. The interacting multiple model filter finds the probability of each from the past.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats, Mask
from harness.recordings.kinematic_smoother import CHANGE, MODES, kinematic_loops

BANDWIDTH = 1.0
"""Hz; at the middle intensity the signal is as strong as its noise there: the others reach from 0.1 to 10 Hz."""

_FIRST = 1.0
"""s over which the fastest signal has wandered before the first sample, for the spread of its first rate."""


@dataclass(frozen=True)
class Filtered:
    """A signal given its samples so far.

    Attributes:
        value: ``(samples,)``.
        rate: Its derivative in time ``(samples,)``.
        covariance: Of the errors of both ``(samples, 2, 2)``.
        lagged: Covariance of these errors with those of the sample before ``(samples, 2, 2)``; 0 at the first.
        noise: Standard deviation of the noise of a sample.
    """

    value: Floats
    rate: Floats
    covariance: Floats
    lagged: Floats
    noise: float

    @property
    def of_the_sample(self) -> Floats:
        """Return the covariance of the noise of each sample and the error of the rate ``(samples, 2, 2)``.

        A filter corrects by ``K = P H' / R``, so that the noise has the covariance ``K R = P H'`` with its errors;
        where the filters of several intensities differ, of a mixture with more than ``R``, no more than its share.
        """
        found = self.covariance.copy()
        share = np.minimum(1.0, self.noise**2 / found[:, 0, 0])
        found[:, 0, 1] = found[:, 1, 0] = share * found[:, 0, 1]
        found[:, 0, 0] = self.noise**2
        return found


def filtered(values: Floats, step: float, noise: float, measured: Mask | None = None) -> Filtered:
    """Return a signal and its rate given the samples up to each, with their covariance.

    Args:
        values: Samples in any unit ``(samples,)``; NaN where missing, not all.
        step: s between them.
        noise: Standard deviation of the noise of a sample, above zero.
        measured: Which of them were measured, where not all were ``(samples,)``.
    """
    y = np.array(values, dtype=float) if measured is None else np.where(measured, values, np.nan)
    samples, variance = len(y), noise**2
    intensities = variance * step * (2 * np.pi * BANDWIDTH) ** 4 * MODES
    first = np.array([variance, intensities[-1] * _FIRST])
    means, covariances, chances = np.empty((samples, 2)), np.empty((samples, 2, 2)), np.empty((samples, len(MODES)))
    leave = 1.0 - np.exp(-step / CHANGE)
    kinematic_loops().run_modes(
        y, np.full(samples, variance), intensities, leave, step, first, chances, means, covariances
    )
    kept = np.tile(np.eye(2), (samples, 1, 1))  # I - K H of the mixture, with K = P H' / R
    kept[:, :, 0] -= np.where(np.isfinite(y), 1.0, 0.0)[:, None] * covariances[:, :, 0] / variance
    lagged = np.zeros((samples, 2, 2))
    lagged[1:] = kept[1:] @ np.array([[1.0, step], [0.0, 1.0]]) @ covariances[:-1]
    return Filtered(means[:, 0].copy(), means[:, 1].copy(), covariances, lagged, noise)
