"""Order analysis: a disturbance that is periodic in the distance driven, as those of wheels and shafts are.

It is no function of a signal, because no signal has its phase, and too fast for a slowly varying disturbance. The
adjoint of the linearised filter gives the gradient of the log-likelihood with respect to a disturbance at every sample
(Bryson and Frazier 1963). Over the distance driven instead of time, its spectrum has a line for everything that
rotates, whatever the speed. The phase belongs to each drive, as a time of change does; wavelength, amplitude and growth
with speed are common to all drives, and are tested on the drives left out.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import ndimage, optimize

from harness.common.arrays import Floats
from harness.diagnosis.innovations.disturbance_inputs import DisturbanceInput
from harness.diagnosis.innovations.innovation_model import InnovationModel, InputDirection
from harness.diagnosis.residuals.disturbance_ranking import DisturbanceRanking

WAVELENGTHS = (0.5, 10.0)
"""m; from the second order of a small wheel to a slow shaft."""

GROWTH = (0, 2)
"""Powers of the speed: a tyre that is not round, and an unbalanced wheel."""

_BIN = 0.04
"""m; far below the shortest wavelength."""

_PADDED = 4
"""Points of the spectrum per line that the longest drive resolves."""

_KNOTS = 12
"""Wavelengths at which the power of the response is computed; it is smooth in between."""

_NEAR = 400
"""Lines to either side whose median is the background of a line; a disturbance at random times has no line."""

_SAMPLES = 4.0
"""Least number of samples per turn, on average."""


@dataclass(frozen=True)
class Spectrum:
    """Gain of a periodic disturbance at each wavelength, at one input.

    Attributes:
        wavelength: m, descending ``(lines,)``.
        gain: In log-likelihood of the fitted drives ``(lines,)``.
    """

    wavelength: Floats
    gain: Floats

    def background(self) -> Floats:
        """Return the gain by chance over that in white noise ``(lines,)``, 1 at least."""
        return np.maximum(1.0, ndimage.median_filter(self.gain, 2 * _NEAR + 1, mode="nearest"))


@dataclass(frozen=True)
class PeriodicDisturbance:
    """A disturbance that is periodic in the distance driven.

    Attributes:
        disturbance_input: The input.
        wavelength: m.
        growth: Power of the speed with which it grows.
        speed: At which it has its amplitude, in m/s.
        amplitude: In the unit of the channel.
        gain: In log-likelihood of the fitted drives.
        clarity: The same over the background of its line.
        spectrum: From which it was taken.
    """

    disturbance_input: DisturbanceInput
    wavelength: float
    growth: int
    speed: float
    amplitude: float
    gain: float
    clarity: float
    spectrum: Spectrum

    def waves(self, distance_drive: DistanceDomainDrive) -> Waves:
        """Return its two waves over a drive, a quarter of a turn apart."""
        s, v = distance_drive.distance, distance_drive.speed
        now, middle = self._at(s, v), self._at(0.5 * (s[:-1] + s[1:]), 0.5 * (v[:-1] + v[1:]))
        during = now.copy()
        during[:-1] = (now[:-1] + 4.0 * middle + now[1:]) / 6.0
        return Waves(now, during)

    def _at(self, distance: Floats, speed: Floats) -> Floats:
        return self.amplitude * _waves(1.0 / self.wavelength, distance, (speed / self.speed) ** self.growth)


@dataclass(frozen=True)
class Waves:
    """Disturbances, each ``(samples, n)``. A fast one differs between a sample and the step behind it.

    Attributes:
        now: At every sample.
        during: Mean over the step behind it.
    """

    now: Floats
    during: Floats

    def of(self, shares: Floats) -> Waves:
        """Return sums of them with shares ``(n,)``, as one."""
        return Waves(self.now @ shares[:, None], self.during @ shares[:, None])


@dataclass(frozen=True)
class DistanceDomainDrive:
    """A drive in which a periodic disturbance is sought.

    Attributes:
        model: Its innovations.
        residual: Whitened innovations that are to be explained ``(samples, ny)``.
        distance: m ``(samples,)``.
        speed: m/s ``(samples,)``.
    """

    model: InnovationModel
    residual: Floats
    distance: Floats
    speed: Floats

    def pull(self, input_direction: InputDirection, adjoint: Floats) -> Floats:
        """Return the derivative of the log-likelihood to a disturbance at every sample ``(samples,)``."""
        later = np.concatenate([adjoint[1:], np.zeros((1, adjoint.shape[1]))])
        derivative = np.einsum("ka,ka->k", input_direction.direct, self.residual) + np.einsum(
            "ki,ki->k", input_direction.entry, later
        )
        derivative[0] = 0.0  # the first sample is not used
        return derivative

    def response(self, input_direction: InputDirection, waves: Waves) -> Floats:
        """Return how disturbances move the whitened innovations ``(samples, ny, n)``."""
        during = InputDirection(input_direction.entry - input_direction.through, np.zeros_like(input_direction.direct))
        now = InputDirection(input_direction.entry - during.entry, input_direction.direct)
        return self.model.responses(during, waves.during) + self.model.responses(now, waves.now)

    def phase(self, input_direction: InputDirection, waves: Waves) -> tuple[Floats, float, Floats]:
        """Return the best phase of waves a quarter of a turn apart: its shares of both, gain, and what it explains."""
        X = self.response(input_direction, waves)
        b = np.tensordot(X, self.residual, ((0, 1), (0, 1)))
        G = np.tensordot(X, X, ((0, 1), (0, 1)))
        # Along the circle the gain has two maxima at most; a grid of degrees finds the higher one.
        angles = np.radians(np.arange(360.0))
        circle = np.array([np.cos(angles), np.sin(angles)])
        gains = b @ circle - 0.5 * np.einsum("ia,ij,ja->a", circle, G, circle)
        best = circle[:, int(np.argmax(gains))]
        return best, float(gains.max()), X @ best


def in_distance_domain(ranking: DisturbanceRanking, speeds: Sequence[Floats]) -> list[DistanceDomainDrive]:
    """Return the drives of a localised model with the speed of each ``(samples,)``."""
    distance_drives = []
    for linear, v in zip(ranking.linear, speeds, strict=True):
        model = linear.innovations
        distance = np.concatenate([[0.0], np.cumsum(0.5 * model.step * (v[1:] + v[:-1]))])
        distance_drives.append(DistanceDomainDrive(model, model.residual, distance, v))
    return distance_drives


def find_periodic(
    ranking: DisturbanceRanking,
    disturbance_inputs: Sequence[DisturbanceInput],
    distance_drives: Sequence[DistanceDomainDrive],
    needed: float,
) -> PeriodicDisturbance | None:
    """Return the periodic disturbance of the largest gain in log-likelihood; ``None`` if none gains what is needed.

    Args:
        ranking: Of the fitted drives.
        disturbance_inputs: Inputs at which it may act.
        distance_drives: The same drives.
        needed: Gain over the background, beyond what the best of as many tries as there are lines reaches by chance.
    """
    mean = float(np.concatenate([r.speed for r in distance_drives]).mean())
    lines = _lines(distance_drives, mean)
    if len(lines) < _KNOTS:
        return None
    adjoints = [r.model.adjoint(r.residual) for r in distance_drives]
    best: PeriodicDisturbance | None = None
    for disturbance_input in disturbance_inputs:
        input_directions = ranking.input_directions(disturbance_input)
        pulls = [
            r.pull(input_direction, z)
            for r, input_direction, z in zip(distance_drives, input_directions, adjoints, strict=True)
        ]
        power = np.array(
            [
                _power(r, input_direction, lines)
                for r, input_direction in zip(distance_drives, input_directions, strict=True)
            ]
        )
        if not power.any():
            continue
        spectrum = _spectrum(pulls, power, distance_drives, lines)
        for growth in GROWTH:
            candidate = _taken(disturbance_input, input_directions, pulls, distance_drives, spectrum, growth, mean)
            if best is None or candidate.clarity > best.clarity:
                best = candidate
    if best is None or best.clarity < needed + np.log(len(lines) * len(disturbance_inputs)):
        return None
    return best


def _lines(distance_drives: Sequence[DistanceDomainDrive], mean: float) -> Floats:
    """Return the wave numbers of the spectrum in 1/m, ascending."""
    longest = max(float(r.distance[-1]) for r in distance_drives)
    shortest = max(WAVELENGTHS[0], _SAMPLES * mean * distance_drives[0].model.step)
    if longest < 10 * WAVELENGTHS[1]:
        return np.zeros(0)
    size = _transformed(longest)
    numbers = np.arange(size // 2 + 1) / (size * _BIN)
    return numbers[(numbers >= 1.0 / WAVELENGTHS[1]) & (numbers <= 1.0 / shortest)]


def _transformed(longest: float) -> int:
    return int(2 ** np.ceil(np.log2(_PADDED * longest / _BIN)))


def _waves(number: float, distance: Floats, size: Floats) -> Floats:
    turn = 2.0 * np.pi * number * distance
    return size[:, None] * np.column_stack([np.cos(turn), np.sin(turn)])


def _power(distance_drive: DistanceDomainDrive, input_direction: InputDirection, lines: Floats) -> Floats:
    """Return the power of the response to a wave of each wave number ``(lines,)``."""
    knots = np.geomspace(lines[0], lines[-1], _KNOTS)
    ones = np.ones_like(distance_drive.distance)
    waves = np.concatenate([_waves(k, distance_drive.distance, ones) for k in knots], axis=1)
    squares = np.einsum("kan,kan->n", *2 * [distance_drive.model.responses(input_direction, waves)])
    return np.interp(lines, knots, 0.5 * (squares[::2] + squares[1::2]))


def _spectrum(
    pulls: Sequence[Floats], power: Floats, distance_drives: Sequence[DistanceDomainDrive], lines: Floats
) -> Spectrum:
    """Return the gain at every line: the sum over drives, each at its best phase, of one amplitude."""
    size = _transformed(max(float(r.distance[-1]) for r in distance_drives))
    first = round(float(lines[0]) * size * _BIN)
    total = np.zeros(len(lines))
    for pull, distance_drive in zip(pulls, distance_drives, strict=True):
        binned = np.bincount(np.round(distance_drive.distance / _BIN).astype(int), pull, size)[:size]
        total += np.abs(np.fft.rfft(binned))[first : first + len(lines)]
    return Spectrum(1.0 / lines, 0.5 * total**2 / np.maximum(power.sum(axis=0), 1e-300))


def _taken(
    disturbance_input: DisturbanceInput,
    input_directions: Sequence[InputDirection],
    pulls: Sequence[Floats],
    distance_drives: Sequence[DistanceDomainDrive],
    spectrum: Spectrum,
    growth: int,
    mean: float,
) -> PeriodicDisturbance:
    """Return the highest line of a spectrum at its exact wavelength, with its size."""
    background = spectrum.background()
    top = int(np.argmax(spectrum.gain / background))
    numbers, sizes = 1.0 / spectrum.wavelength, [(r.speed / mean) ** growth for r in distance_drives]
    width = numbers[1] - numbers[0]

    def less(number: float) -> float:
        return -sum(
            float(np.hypot(*(pull @ _waves(number, r.distance, size))))
            for pull, r, size in zip(pulls, distance_drives, sizes, strict=True)
        )

    near = (numbers[top] - width, numbers[top] + width)
    number = float(
        optimize.minimize_scalar(less, near, bounds=near, method="bounded", options={"xatol": 1e-3 * width}).x
    )
    first = PeriodicDisturbance(disturbance_input, 1.0 / number, growth, mean, 1.0, 0.0, 0.0, spectrum)
    push = power = 0.0
    for r, input_direction in zip(distance_drives, input_directions, strict=True):
        X = r.response(input_direction, first.waves(r))
        b = np.tensordot(X, r.residual, ((0, 1), (0, 1)))
        push += float(np.hypot(*b))
        power += float(np.sum((X @ (b / max(float(np.hypot(*b)), 1e-300))) ** 2))
    amplitude = push / max(power, 1e-300)
    gain = 0.5 * push * amplitude
    return PeriodicDisturbance(
        disturbance_input, 1.0 / number, growth, mean, amplitude, gain, gain / background[top], spectrum
    )
