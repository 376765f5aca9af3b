"""Covariance R of the measurement noise, from a recorded output at rest (KIT 2015, section 3).

At rest the true output is constant, so what the samples scatter is noise. ``noise_at_rest`` takes a recording,
``batch`` the samples at once, ``Running`` one sample after another in constant memory; all agree. A filter takes the
diagonal as its variances per sample, ``MEASUREMENT_NOISE`` of a parameter set.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.registry import closest

STANDSTILL = 0.05
"""m/s; a recording whose speed exceeds this is not at rest."""


@dataclass(frozen=True)
class Noise:
    """Noise of an output at rest.

    Attributes:
        mean: Mean of the samples ``(ny,)``.
        covariance: Their covariance with the denominator N - 1, ``(ny, ny)``.
        samples: Number of complete samples N.
    """

    mean: Floats
    covariance: Floats
    samples: int

    @property
    def variances(self) -> Floats:
        """The diagonal of the covariance ``(ny,)``, as the filters take it."""
        return np.diagonal(self.covariance).copy()


@dataclass(frozen=True)
class Running:
    """Mean and scatter of the samples seen so far; ``add`` returns the next one and changes nothing.

    Attributes:
        mean: ``(ny,)``.
        scatter: Sum of outer products of the deviations from the mean, ``(ny, ny)``.
        samples: Number of complete samples.
    """

    mean: Floats
    scatter: Floats
    samples: int = 0

    @staticmethod
    def start(outputs: int) -> Running:
        """Return the state before the first sample of so many outputs."""
        return Running(np.zeros(outputs), np.zeros((outputs, outputs)))

    def add(self, sample: ArrayLike) -> Running:
        """Return the state after one more sample ``(ny,)``; a sample with a missing (NaN) part is left out.

        ``m(n) = m(n-1) + d / n`` and ``S(n) = S(n-1) + (n - 1) / n d d'`` with ``d = y(n) - m(n-1)`` (Welford 1962),
        which loses no digits however far the mean lies from zero.
        """
        y = np.asarray(sample, dtype=float)
        if np.isnan(y).any():
            return self
        n = self.samples + 1
        d = y - self.mean
        return Running(self.mean + d / n, self.scatter + (n - 1) / n * np.outer(d, d), n)

    def noise(self) -> Noise:
        """Return mean and covariance.

        Raises:
            UserError: If fewer than two complete samples were added.
        """
        _refuse_few(self.samples)
        return Noise(self.mean, self.scatter / (self.samples - 1), self.samples)


def batch(samples: ArrayLike) -> Noise:
    """Return mean and covariance of samples ``(N, ny)``; those with a missing (NaN) part are left out.

    Raises:
        UserError: If there are fewer than two complete samples.
    """
    y = np.asarray(samples, dtype=float)
    y = y[~np.isnan(y).any(axis=1)]
    _refuse_few(len(y))
    mean = y.mean(axis=0)
    return Noise(mean, (y - mean).T @ (y - mean) / (len(y) - 1), len(y))


def noise_at_rest(recording: xr.Dataset, outputs: Sequence[str], start: float = -np.inf, stop: float = np.inf) -> Noise:
    """Return the noise of recorded outputs over a stretch at rest.

    Args:
        recording: Variables over ``time``; ``speed``, if there, must stay below ``STANDSTILL``.
        outputs: Names of the variables.
        start: First time in s.
        stop: Last time in s.

    Raises:
        UserError: If an output is not recorded, the vehicle moves, a signal never changes (a sensor that is off, or
            one whose noise is below its resolution), or there are too few samples.
    """
    for name in outputs:
        if name not in recording:
            names = [str(v) for v in recording.data_vars]
            raise UserError(f"the recording has no '{name}'{closest(name, names)}")
    time = recording["time"].to_numpy()
    inside = (time >= start) & (time <= stop)
    if "speed" in recording:
        moving = inside & (np.abs(recording["speed"].to_numpy()) > STANDSTILL)
        if moving.any():
            raise UserError(
                f"the vehicle moves at {time[moving][0]:g} s (faster than {STANDSTILL} m/s); choose start and stop "
                "inside a standstill, because at speed the output itself changes"
            )
    noise = batch(np.column_stack([recording[name].to_numpy()[inside] for name in outputs]))
    for name, variance in zip(outputs, noise.variances, strict=True):
        if variance == 0:
            raise UserError(
                f"'{name}' has the same value in all {noise.samples} samples: the sensor is off, or its noise is below "
                "its resolution; state its variance by hand, such as the resolution squared over 12"
            )
    return noise


def _refuse_few(samples: int) -> None:
    if samples < 2:
        raise UserError(
            f"a covariance needs at least two complete samples, there are {samples}; choose a longer stretch"
        )
