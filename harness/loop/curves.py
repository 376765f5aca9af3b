"""A disturbance as a smooth function of one signal: a penalised cubic B-spline, and what it looks like in words.

Beyond the values that were fitted the curve stays at its end (Eilers and Marx 1996 for the penalty on differences).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.interpolate import BSpline

from harness.loop.channels import Channel
from harness.loop.drivers import Driver
from harness.loop.turning import Turning
from harness.report import style
from models.quantities import print_unit, quantity, words

Floats = NDArray[np.float64]

DEGREE = 3
FUNCTIONS = 9
"""Numbers that describe a curve."""

_ENDS = 0.002
"""Share of the samples to either side that lies beyond the ends of a curve."""

_PURE = 0.8
"""Share of a curve's power from which it counts as odd or even."""

_FLAT = 0.3
"""Slope at the end of a curve over its steepest one, below which it saturates."""


@dataclass(frozen=True)
class Basis:
    """The functions that a curve is made of.

    Attributes:
        knots: ``(FUNCTIONS + DEGREE + 1,)``.
    """

    knots: Floats

    @staticmethod
    def over(values: Floats) -> Basis:
        """Return a basis for samples of a signal, with evenly spaced knots."""
        low, high = np.quantile(values, [_ENDS, 1.0 - _ENDS])
        inner = np.linspace(low, max(high, low + 1e-12), FUNCTIONS - DEGREE + 1)
        return Basis(np.concatenate([np.full(DEGREE, inner[0]), inner, np.full(DEGREE, inner[-1])]))

    @property
    def ends(self) -> tuple[float, float]:
        """Where the curve becomes constant."""
        return float(self.knots[0]), float(self.knots[-1])

    def of(self, values: Floats) -> Floats:
        """Return the functions at samples of the signal ``(samples, FUNCTIONS)``."""
        return BSpline.design_matrix(np.clip(values, *self.ends), self.knots, DEGREE).toarray()

    @staticmethod
    def roughness() -> Floats:
        """Return the sum of squared second differences as a matrix ``(FUNCTIONS, FUNCTIONS)``."""
        D = np.diff(np.eye(FUNCTIONS), 2, axis=0)
        return D.T @ D


@dataclass(frozen=True)
class Curve:
    """A disturbance at an entry as a function of a signal.

    Attributes:
        channel: The entry.
        driver: The signal.
        basis: Its functions.
        weights: Of the functions ``(FUNCTIONS,)``.
        covariance: Of the weights.
        stability: Share of the halves of the data in which the dictionary chose the pair.
        predicted: Gain in log-likelihood of drives from which it was not fitted, in cross-validation.
    """

    channel: Channel
    driver: Driver
    basis: Basis
    weights: Floats
    covariance: Floats
    stability: float
    predicted: float

    def at(self, values: Floats) -> Floats:
        """Return the disturbance at samples of the signal."""
        return self.basis.of(values) @ self.weights

    def error(self, values: Floats) -> Floats:
        """Return the standard error there."""
        functions = self.basis.of(values)
        return np.sqrt(np.maximum(np.einsum("si,ij,sj->s", functions, self.covariance, functions), 0.0))


def described(found: Curve | Turning) -> str:
    """Say what a disturbance looks like."""
    return _turning(found) if isinstance(found, Turning) else _curve(found)


def _turning(turning: Turning) -> str:
    grows = f" at {style.number(turning.speed)} m/s and growing with the square of the speed" if turning.growth else ""
    size = amount(turning.amplitude, turning.channel)
    return f"{entry(turning.channel)}, once per {style.number(turning.wavelength)} m driven, reaching {size}{grows}"


def _curve(curve: Curve) -> str:
    """Say what a curve looks like: ``coupling moment, odd in the articulation angle, reaching 16 kN·m``."""
    low, high = curve.basis.ends
    reach = min(-low, high)
    kind = "a function of"
    if reach > 0.3 * max(-low, high):
        grid = np.linspace(0.0, reach, 100)
        left, right = curve.at(-grid), curve.at(grid)
        odd, even = 0.5 * (right - left), 0.5 * (right + left)
        total = np.sum(odd**2) + np.sum(even**2)
        kind = "odd in" if np.sum(odd**2) > _PURE * total else "even in" if np.sum(even**2) > _PURE * total else kind
    grid = np.linspace(low, high, 200)
    values = curve.at(grid)
    slopes = np.abs(np.gradient(values, grid))
    ends = max(slopes[2], slopes[-3])
    largest = float(np.abs(values).max())
    verb = "saturating at" if ends < _FLAT * slopes.max() and np.argmax(slopes) not in (0, 199) else "reaching"
    return f"{entry(curve.channel)}, {kind} the {curve.driver.words}, {verb} {amount(largest, curve.channel)}"


def entry(channel: Channel) -> str:
    """Return an entry in words."""
    if channel.kind == "equation":
        return f"equation of the {words(channel.ports[0])}"
    return f"sensor of the {words(channel.name)}" if channel.kind == "sensor" else words(channel.name)


def amount(value: float, channel: Channel) -> str:
    """Write a disturbance with its unit as reports do."""
    unit, scale = shown(channel)
    return style.with_unit(scale * value, unit)


def shown(channel: Channel) -> tuple[str, float]:
    """Return the unit in which reports show a disturbance, and how many of it make an SI unit."""
    if channel.kind == "equation":
        return print_unit(channel.unit), 1.0
    q = quantity(channel.ports[0].removeprefix("sensor_"))
    from models.signals import SIGNALS

    known = SIGNALS.get(q.name)
    return (q.unit, q.scale) if known and known.unit == channel.unit else (print_unit(channel.unit), 1.0)
