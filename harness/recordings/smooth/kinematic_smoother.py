"""Signals that were measured with noise, and their rates: given all samples, or the samples so far.

No rate is ever a difference of samples. A signal is taken for an integrated random walk: its highest rate, the first or
the second, wanders. How fast it wanders and how large the noise is follow from the signal itself by maximum likelihood,
and so does which rate it is. The intensity changes along the signal, because a driver steers now and rests then: a
filter over several intensities side by side finds the probability of each at every sample. Samples are smoothed
backwards (Rauch, Tung and Striebel 1965) with the mean intensity.

Noise that a signal cannot lack is that of its resolution: readings that are multiples of a step have the variance
``step^2 / 12``. The error of rounding is the same in several equal readings in a row, which no mean over them takes
away, so that much is added to the variance of what is smoothed.

``filtered`` takes the past alone. Quantities that cannot be estimated without the future are given: the noise is
stated, and the intensities lie around a fixed bandwidth. The interacting multiple model filter finds the
probability of each from the past.
"""

from __future__ import annotations

import functools
from dataclasses import dataclass
from types import ModuleType

import numpy as np
import scipy

from harness.common.arrays import Floats, Mask
from harness.engine.compile import load_source
from harness.engine.kernel_source import kernel_source
from harness.recordings.smooth import smoother_loops

MODES = 10.0 ** np.array([-4.0, -2.0, 0.0, 2.0, 4.0])
"""Intensities between which a signal changes, over its likeliest constant one: each a factor of three in bandwidth."""

CHANGE = 1.0
"""s; mean time between two changes of the intensity."""

_QUIETEST = 1e-8
"""Least standard deviation of the noise over the range of the signal: what arithmetic leaves of an exact one."""

_LEVELS = 10
"""Different readings from which a step between them counts as a resolution: a command may have two or three levels."""

_SLOWEST, _FASTEST = 1e-2, 0.5
"""Bandwidths among which the likeliest is sought: over the length of the signal, and over its sampling rate."""

_REFINED = 0.2
"""Of the logarithm of the intensity, to which it is found: a twentieth of the variance of the smoothed signal."""


@dataclass(frozen=True)
class Smoothed:
    """A signal given all its samples.

    Attributes:
        value: ``(samples,)``.
        rate: Its derivative in time ``(samples,)``.
        covariance: Of the errors of both and, where it wanders, of the second rate ``(samples, n, n)``, n of 2 or 3.
        lagged: Covariance of these errors with those of the sample before ``(samples, n, n)``; 0 at the first.
        second_rate: Derivative of the rate, where that is what wanders; else NaN ``(samples,)``.
        noise: Standard deviation of the noise of a sample, resolution included.
        resolution: Step of which all readings are multiples; 0 if there is none.
        order: Number of rates in the state.
        log_likelihood: Of the samples.
    """

    value: Floats
    rate: Floats
    covariance: Floats
    lagged: Floats
    second_rate: Floats
    noise: float
    resolution: float
    order: int
    log_likelihood: float


@functools.cache
def kinematic_loops() -> ModuleType:
    """Return the loops of ``smoother_loops``, compiled."""
    return load_source("kinematic_smoother", kernel_source("kinematic_smoother", smoother_loops.LOOPS))


def smoothed(values: Floats, step: float, measured: Mask | None = None) -> Smoothed:
    """Return a signal and its rate given all samples, with their covariance.

    Args:
        values: Samples in any unit ``(samples,)``; NaN where missing.
        step: s between them.
        measured: Which of them were measured, where not all were: the others repeat or join those ``(samples,)``.

    Raises:
        ValueError: If fewer than four samples were measured.
    """
    y = np.where(measured, values, np.nan) if measured is not None else np.array(values, dtype=float)
    finite = np.isfinite(y)
    if finite.sum() < 4:
        raise ValueError("a signal takes four measured samples to be smoothed")
    if np.ptp(y[finite]) == 0:
        nothing, exact = np.zeros(len(y)), np.zeros((len(y), 2, 2))
        return Smoothed(np.full(len(y), y[finite][0]), nothing, exact, exact, nothing, 0.0, 0.0, 1, np.inf)
    return max(
        (_IntensitySearch(y, step, rates).best() for rates in (1, 2)), key=lambda candidate: candidate.log_likelihood
    )


def resolution_of(values: Floats) -> float:
    """Return the step of which all values of a signal are multiples, 0 if there is none or too few levels tell."""
    levels = np.unique(values[np.isfinite(values)])
    if len(levels) < _LEVELS:
        return 0.0
    gaps = np.diff(levels)
    beyond_rounding = gaps[gaps > 1e-9 * np.abs(levels).max()]
    if not len(beyond_rounding):  # a constant that arithmetic has rounded
        return 0.0
    step = beyond_rounding.min()
    multiples = gaps / step
    return float(step) if np.abs(multiples - np.rint(multiples)).max() < 0.05 else 0.0


def run_lengths(values: Floats) -> Floats:
    """Return for each sample how many equal ones it stands among, missing ones skipped; 1 where missing."""
    lengths = np.ones(len(values))
    finite = np.flatnonzero(np.isfinite(values))
    edges = np.flatnonzero(np.diff(values[finite])) + 1
    counts = np.diff(edges, prepend=0, append=len(finite))
    lengths[finite] = np.repeat(counts, counts)
    return lengths


class _IntensitySearch:
    """Noise and intensity of a signal by maximum likelihood.

    Args:
        y: Samples, NaN where missing.
        step: s.
        rates: 1 or 2 of them in the state.
    """

    def __init__(self, y: Floats, step: float, rates: int) -> None:
        self.y, self.step, self.rates = y, step, rates
        finite = np.isfinite(y)
        self.resolution = resolution_of(y)
        rounding = self.resolution**2 / 12.0
        self.floor = max(rounding, (_QUIETEST * np.ptp(y[finite])) ** 2)
        self.common = rounding * (1.0 - 1.0 / run_lengths(y))
        fastest = np.ptp(y[finite]) / step
        self.first = np.array([np.ptp(y[finite]) ** 2, fastest**2, (fastest / step) ** 2])[: rates + 1]
        self.shape = np.ones(len(y))
        span = step * len(y)
        self.bounds = self._ratio(_SLOWEST / span), self._ratio(_FASTEST / step)

    def _ratio(self, bandwidth: float) -> float:
        """Return the logarithm of intensity over noise that has a bandwidth in Hz."""
        return float(np.log(self.step * (2 * np.pi * bandwidth) ** (2 * self.rates + 2)))

    def best(self) -> Smoothed:
        """Return the signal with the likeliest noise and intensity, constant or changing, whichever is likelier."""
        noise, intensity, likelihood = self._likeliest(*self.bounds, 7)
        level = MODES * intensity
        chances = np.empty((len(self.y), len(MODES)))
        leave = 1.0 - np.exp(-self.step / CHANGE)
        nothing = np.empty((0, 0)), np.empty((0, 0, 0))
        noises = np.full(len(self.y), noise)
        changing = kinematic_loops().run_modes(self.y, noises, level, leave, self.step, self.first, chances, *nothing)
        kinematic_loops().smooth_modes(chances, leave)
        if changing > likelihood:
            self.shape = chances @ MODES
            middle = np.log(intensity / noise)
            noise, intensity, _ = self._likeliest(middle + np.log(MODES[1]), middle + np.log(MODES[3]), 3)
            likelihood = changing
        return self._smoothed(noise, intensity, likelihood)

    def _likeliest(self, low: float, high: float, count: int) -> tuple[float, float, float]:
        """Return the likeliest noise and intensity with the shape at hand, and the log-likelihood.

        Args:
            low: Logarithm of the ratio of both from which it is sought.
            high: The same up to which.
            count: Points on the way from one to the other that are tried first.
        """
        nothing, alike = (np.empty((0, 0)), np.empty((0, 0, 0))), np.ones(len(self.y))
        start = max(float(np.nanvar(np.diff(self.y[np.isfinite(self.y)], 3))) / 20.0, self.floor)

        def at(ratio: float) -> tuple[float, float]:
            """Return the noise that is likeliest for a ratio of intensity to noise, and the log-likelihood there."""
            squares, logarithms, count = kinematic_loops().run_filter(
                self.y, alike, np.exp(ratio) * self.shape, self.step, self.first / start, *nothing
            )
            if not np.isfinite(squares + logarithms):  # beyond what arithmetic can do
                return self.floor, -1e30
            noise = max(squares / count, self.floor)
            return noise, -0.5 * (squares / noise + logarithms + count * np.log(2 * np.pi * noise))

        grid = np.linspace(low, high, count)
        values = [at(r)[1] for r in grid]
        i = int(np.argmax(values))
        inside = grid[max(i - 1, 0)], grid[min(i + 1, count - 1)]
        optimum = scipy.optimize.minimize_scalar(
            lambda r: -at(r)[1], bounds=inside, method="bounded", options={"xatol": _REFINED}
        )
        noise, likelihood = at(optimum.x)
        return noise, noise * float(np.exp(optimum.x)), likelihood

    def _smoothed(self, noise: float, intensity: float, likelihood: float) -> Smoothed:
        samples, n = len(self.y), self.rates + 1
        means, covariances, lagged = np.empty((samples, n)), np.empty((samples, n, n)), np.empty((samples, n, n))
        intensities = intensity * self.shape
        kinematic_loops().run_filter(
            self.y, np.full(samples, noise), intensities, self.step, self.first, means, covariances
        )
        kinematic_loops().run_smoother(intensities, self.step, means, covariances, lagged)
        covariances[:, 0, 0] += self.common
        lagged[1:, 0, 0] += np.sqrt(self.common[1:] * self.common[:-1])
        second = means[:, 2].copy() if n > 2 else np.full(samples, np.nan)
        return Smoothed(
            means[:, 0].copy(),
            means[:, 1].copy(),
            covariances,
            lagged,
            second,
            float(np.sqrt(noise)),
            self.resolution,
            self.rates,
            float(likelihood),
        )


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
        covariance = self.covariance.copy()
        share = np.minimum(1.0, self.noise**2 / covariance[:, 0, 0])
        covariance[:, 0, 1] = covariance[:, 1, 0] = share * covariance[:, 0, 1]
        covariance[:, 0, 0] = self.noise**2
        return covariance


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
