"""One column as one signal in one unit, and how usual its values are."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from harness.common.arrays import Floats
from harness.common.units import scale
from harness.models.signals import SIGNALS

_USUAL = {
    "speed": (12.0, 1.0), "longitudinal_velocity": (12.0, 1.0), "lateral_velocity": (0.3, 1.5),
    "yaw_rate": (0.12, 1.2), "roll_rate": (0.03, 1.5), "yaw_acceleration": (0.3, 1.5),
    "lateral_acceleration": (1.5, 1.0), "longitudinal_acceleration": (0.8, 1.0),
    "steering_wheel_angle": (0.6, 1.3), "road_wheel_angle": (0.05, 1.3), "heading": (2.0, 1.5),
    "articulation_angle": (0.1, 1.5), "sideslip_angle": (0.02, 1.5), "roll_angle": (0.03, 1.5),
}  # fmt: skip
"""Root mean square of a signal in a drive, SI, with the standard deviation of its logarithm."""
LARGEST = {"rad": 30.0, "rad/s": 10.0, "rad/s^2": 100.0, "m/s": 130.0, "m/s^2": 80.0}
"""Largest magnitudes that vehicles reach, in SI units; a heading turns further."""
_UNITS: dict[str, tuple[tuple[str, float], ...]] = {
    "rad": (("rad", 0.0), ("deg", 0.0)),
    "rad/s": (("rad/s", 0.0), ("deg/s", 0.0)),
    "rad/s^2": (("rad/s^2", 0.0), ("deg/s^2", 0.0)),
    "m/s": (("m/s", 0.0), ("km/h", 0.0), ("mph", -2.0), ("knot", -4.0)),
    "m/s^2": (("m/s^2", 0.0), ("g_0", 0.0)),
}
"""Units that a column may have where none is stated, by the SI unit of its signal, and how usual they are."""
_AS_NAMED = {"steering_wheel_angle": "deg", "road_wheel_angle": "deg", "articulation_angle": "deg"}
"""Units that are customary where a name is in words."""
_CUSTOM = 0.7
"""What a customary unit counts; SI where the column has the name of the signal, or a symbol."""
STATED = 0.7
"""What a stated unit counts."""
WORST = -3.5
"""Least that unusual values count."""


@dataclass(frozen=True, eq=False)
class Guess:
    """One entry of the map.

    Attributes:
        signal: Signal.
        column: Column of the file.
        unit: Unit of the column.
        values: Its values as recorded ``(samples,)``.
        table: Number of the table that holds it.
        stated: Whether file or name state the unit.
        why: Reasons, in words.
        sign: -1 where the column counts the other way.
        sure: How surely the name says so.
        usual: What its values in this unit count.
        free: Whether another unit was possible.
    """

    signal: str
    column: str
    unit: str
    values: Floats
    table: int
    stated: bool
    why: tuple[str, ...] = ()
    sign: int = 1
    sure: float = 0.0
    usual: float = 0.0
    free: bool = False

    @property
    def factor(self) -> float:
        """From the column to SI units, with the sign."""
        return self.sign * scale(self.unit, SIGNALS[self.signal].unit, self.column)

    @property
    def si(self) -> Floats:
        """Values in SI units."""
        return self.factor * self.values

    @property
    def points(self) -> float:
        """What name, values and a stated unit count."""
        return self.sure + self.usual + STATED * self.stated


def in_units(guess: Guess, by: str, symbol: bool = False) -> list[Guess]:
    """Return a guess whose unit is not stated in each unit in which its values are those of a vehicle.

    Args:
        guess: It.
        by: What the name says, as the first reason.
        symbol: Whether the name is a symbol, as papers and models have them in SI units.
    """
    si = SIGNALS[guess.signal].unit
    finite = np.abs(guess.values[np.isfinite(guess.values)])
    large = float(np.quantile(finite, 0.995))
    options = ((guess.unit, 0.0),) if guess.stated else _UNITS.get(si, ((si, 0.0),))
    custom = _AS_NAMED.get(guess.signal, "") if guess.sure < 5.0 and not symbol else si
    made = []
    for unit, usual in options:
        possible = replace(guess, unit=unit)
        factor = abs(possible.factor)
        if guess.signal == "heading" or factor * large <= LARGEST.get(si, np.inf):
            usual += _usual(guess.signal, factor * _size(finite)) + _CUSTOM * (unit == custom)
            made.append(replace(possible, usual=usual))
    best = max((g.usual for g in made), default=0.0)
    said = f"unit by its values to {float(finite.max()):.4g}"
    return [
        replace(
            g,
            usual=g.usual - best + _unusual(guess.signal, abs(g.factor) * _size(finite)),
            free=not g.stated and len(made) > 1,
            why=(by, *(guess.why if guess.stated else (said,))),
        )
        for g in made
    ]


def _size(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.minimum(values, np.quantile(values, 0.99)) ** 2)))


def _usual(signal: str, size: float) -> float:
    middle, spread = _USUAL.get(signal, (1.0, np.inf))
    return 0.0 if size <= 0 else float(-0.5 * (np.log(size / middle) / spread) ** 2)


def _unusual(signal: str, size: float) -> float:
    """Return what values count against a signal: nothing in a calm drive, or within 2.5 times their spread."""
    middle, spread = _USUAL.get(signal, (1.0, np.inf))
    off = 0.0 if size <= 0 or signal == "heading" else np.log(size / middle) / spread
    beyond = max((abs(off) if signal == "speed" else off) - 2.5, 0.0)
    return float(max(-2.0 * beyond**2, WORST))
