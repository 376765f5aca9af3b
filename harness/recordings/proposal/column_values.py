"""Values of columns: how usual they are as one signal in one unit, and whether two columns move alike.

Motions are averaged on one time base before they are compared.
"""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import uniform_filter1d

from harness.common.arrays import Floats
from harness.common.units import scale
from harness.models.signals import SIGNALS
from harness.recordings.proposal.column_names import read_name

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
"""Log odds of a customary unit; SI where the column has the name of the signal, or a symbol."""
STATED = 0.7
"""Log odds of a stated unit."""
WORST = -3.5
"""Least log odds of unusual values."""


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
        sure: Log odds by its name.
        usual: Log odds by its values in this unit.
        free: Whether another unit was possible.
        compass: Whether it is a heading that counts clockwise from north.
        rate: Log odds by its samples, against the column with most that may be the same motion.
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
    compass: bool = False
    rate: float = 0.0

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
        """Log odds by name, values, a stated unit and the samples."""
        return self.sure + self.usual + STATED * self.stated + self.rate


def in_units(guess: Guess, by: str, symbol: bool = False) -> list[Guess]:
    """Return a guess whose unit is not stated in each unit in which its values are those of a vehicle.

    Args:
        guess: It.
        by: Meaning of the name, as the first reason.
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
    reason = f"unit by its values to {float(finite.max()):.4g}"
    return [
        replace(
            g,
            usual=g.usual - best + _unusual(guess.signal, abs(g.factor) * _size(finite)),
            free=not g.stated and len(made) > 1,
            why=(by, *(guess.why if guess.stated else (reason,))),
        )
        for g in made
    ]


def _size(values: Floats) -> float:
    return float(np.sqrt(np.mean(np.minimum(values, np.quantile(values, 0.99)) ** 2)))


def _usual(signal: str, size: float) -> float:
    middle, spread = _USUAL.get(signal, (1.0, np.inf))
    return 0.0 if size <= 0 else float(-0.5 * (np.log(size / middle) / spread) ** 2)


def _unusual(signal: str, size: float) -> float:
    """Return the log odds of values for a signal: 0 in a calm drive, or within 2.5 times their spread."""
    middle, spread = _USUAL.get(signal, (1.0, np.inf))
    off = 0.0 if size <= 0 or signal == "heading" else np.log(size / middle) / spread
    beyond = max((abs(off) if signal == "speed" else off) - 2.5, 0.0)
    return float(max(-2.0 * beyond**2, WORST))


_CONTRADICTED = -3.0
"""Log odds of a comparison whose sides are uncorrelated."""
_OFF = -2.0
"""Least log odds of one whose sides differ by a factor: it does not determine which of the columns is wrong."""
ALIKE = 0.5
"""Correlation from which two motions are compared at all."""
_FREE = 0.7
"""Log odds that an agreement loses by each unit that had to be chosen."""
_WINDOW = 1.0
"""s over which motions are averaged before they are compared."""
_INSTANT = 1e-9
"""s; stamps that are no further apart are of one instant."""
_ROWS = 25
"""Rows that are averaged where there is no clock."""
_EARTH = 6.371e6
"""m"""
_MOVES = 1.0
"""m/s from which positions tell a course."""
_FEW = 50
"""Samples that a comparison needs."""
_TOLERANCE = 0.15
"""Standard deviation of the logarithm of a factor between two motions that are the same."""
_CALM = {
    "lateral_acceleration": 0.1, "longitudinal_acceleration": 0.08, "yaw_rate": 0.01, "speed": 0.3,
    "steering_wheel_angle": 1e-3, "road_wheel_angle": 1e-3,
}  # fmt: skip
"""Sizes of a motion below which it excites too little to contradict a column; for a steering angle the curvature."""


@dataclass(frozen=True)
class MotionPair:
    """Two motions that are the same.

    Attributes:
        name: Which are compared, in words.
        signals: Signals that take part.
        factor: The first over the second.
        alike: Their correlation.
        free: Guesses of it with a unit that is not stated.
    """

    name: str
    signals: tuple[str, ...]
    factor: float
    alike: float
    free: int = 0

    @property
    def agrees(self) -> bool:
        """Whether they are the same up to the sign."""
        return abs(self.alike) >= ALIKE and 0.5 < abs(self.factor) < 2.0

    @property
    def points(self) -> float:
        """Log odds that it adds for the columns in it."""
        if not np.isfinite(self.factor):
            return 0.0
        if abs(self.alike) < ALIKE:
            return _CONTRADICTED * (1.0 - abs(self.alike) / ALIKE)
        off = 0.5 * (np.log(abs(self.factor)) / _TOLERANCE) ** 2
        return float(max(4.0 * self.alike**2 - off - _FREE * self.free - (self.factor < 0), _OFF))


class Motion:
    """Series of all tables on one time base, averaged so that they can be compared.

    Args:
        clocks: Instants of each table in s, None where it has no clock; the first gives the time base.
    """

    def __init__(self, clocks: Sequence[Floats | None]) -> None:
        self._clocks = clocks
        self._kept: dict[tuple[str, int], Floats] = {}
        steps = np.empty(0) if clocks[0] is None else np.diff(clocks[0])
        steps = steps[steps > _INSTANT]
        self._window = max(1, round(_WINDOW / float(np.median(steps)))) if len(steps) else _ROWS
        self._every = max(1, self._window // 4)

    def series(self, guess: Guess, turning: bool = False) -> Floats:
        """Return a series in SI units; that of an angle that may turn on without its wraps."""
        key = (guess.column, guess.table)
        if key not in self._kept:
            values = guess.values.astype(float)
            there = np.isfinite(values)
            if turning:
                per = 2 * np.pi / abs(guess.factor)
                values[there] = np.unwrap(values[there], period=per)
            self._kept[key] = self._averaged(self._placed(values, guess.table))
        return guess.factor * self._kept[key]

    def rate(self, values: Floats) -> Floats:
        """Return the derivative of a series, NaN at its ends and without a clock."""
        rate, half = np.full(len(values), np.nan), max(1, self._window // self._every // 2)
        time = None if self._clocks[0] is None else self._clocks[0][:: self._every]
        if time is not None and len(time) == len(values) > 2 * half:
            with np.errstate(invalid="ignore", divide="ignore"):
                rate[half:-half] = (values[2 * half :] - values[: -2 * half]) / (time[2 * half :] - time[: -2 * half])
        return np.where(np.isfinite(rate), rate, np.nan)

    def _placed(self, values: Floats, table: int) -> Floats:
        """Return values at the instants of the first table; none where there is no common clock."""
        own, base = self._clocks[table], self._clocks[0]
        if table == 0:
            return values
        there = np.isfinite(values) & np.isfinite(np.nan if own is None else own)
        if own is None or base is None or there.sum() < _FEW:
            return np.empty(0)
        return np.interp(base, own[there], values[there], left=np.nan, right=np.nan)

    def _averaged(self, values: Floats) -> Floats:
        there = np.isfinite(values)
        if not there.any():
            return values[:: self._every]
        weight = uniform_filter1d(there.astype(float), self._window)
        mean = uniform_filter1d(np.where(there, values, 0.0), self._window)
        with np.errstate(invalid="ignore", divide="ignore"):
            return np.where(weight > 0.5, mean / weight, np.nan)[:: self._every]


def compared(name: str, signals: tuple[str, ...], first: Floats, second: Floats, free: int = 0) -> MotionPair:
    """Compare two series; a factor of NaN where they are too short, or the second hardly moves."""
    nothing = MotionPair(name, signals, np.nan, np.nan, free)
    if len(first) != len(second):
        return nothing
    there = np.isfinite(first) & np.isfinite(second)
    if there.sum() < _FEW:
        return nothing
    first, second = first[there], second[there]
    if signals[:1] != ("yaw_rate",):  # which has no offset worth the name, and may be the same all the time
        first, second = first - first.mean(), second - second.mean()
    size, by = (float(np.sqrt(values @ values / len(values))) for values in (first, second))
    if size == 0 or by <= (_CALM.get(signals[0], 0.0) if signals else 0.0):
        return nothing
    alike = float(first @ second / len(first) / size / by)
    return MotionPair(name, signals, float(np.copysign(size / by, alike)), alike, free)


@dataclass(frozen=True)
class Witness:
    """Motion by heading and positions.

    Attributes:
        turn: Yaw rate by them, rad/s; empty if it cannot be computed.
        speed: Speed by the positions, m/s; empty if there are none.
        signed: Whether the sign of the yaw rate is that of ISO 8855.
        heading: The heading, where the yaw rate is by it.
    """

    turn: Floats
    speed: Floats
    signed: bool = False
    heading: Guess | None = None


NOBODY = Witness(np.empty(0), np.empty(0))


def witness(motion: Motion, guesses: Mapping[str, Guess]) -> Witness:
    """Return the motion by heading and positions; positions determine the sign, a heading is smoother."""
    turn, speed = _over_ground(motion, guesses)
    heading = guesses.get("heading")
    if heading is None:
        return Witness(turn, speed, signed=len(turn) > 0)
    by_heading = motion.rate(motion.series(heading, turning=True))
    both = compared("", ("yaw_rate",), by_heading, turn)
    if both.agrees:
        return Witness(np.copysign(1.0, both.factor) * by_heading, speed, True, heading)
    return Witness(turn, speed, True) if np.isfinite(both.factor) else Witness(by_heading, speed, False, heading)


def _over_ground(motion: Motion, guesses: Mapping[str, Guess]) -> tuple[Floats, Floats]:
    """Return rate of the course in rad/s and speed in m/s by positions; both empty where there are none."""
    course, speed = course_over_ground(motion, guesses)
    return (motion.rate(course), speed) if len(course) else (course, speed)


def course_over_ground(motion: Motion, guesses: Mapping[str, Guess]) -> tuple[Floats, Floats]:
    """Return course in rad, to the left from east, and speed in m/s by positions; both empty where there are none."""
    east, north = guesses.get("position_x"), guesses.get("position_y")
    to_east = to_north = 1.0
    if east is None or north is None:
        east, north = guesses.get("longitude"), guesses.get("latitude")
        if east is None or north is None:
            return np.empty(0), np.empty(0)
        to_east, to_north = _EARTH * float(np.cos(np.nanmedian(north.si))), _EARTH
    x, y = (motion.rate(scale * motion.series(g)) for scale, g in ((to_east, east), (to_north, north)))
    speed = np.hypot(x, y) if len(x) == len(y) else np.empty(0)
    moving = np.isfinite(speed) & (speed > _MOVES)
    if moving.sum() < _FEW or np.nanmedian(speed) > LARGEST["m/s"]:
        return np.empty(0), np.empty(0)
    course = np.full(len(x), np.nan)
    course[moving] = np.unwrap(np.arctan2(y[moving], x[moving]))
    return course, speed


_SAME_COURSE = 0.8
"""Mean cosine of course and heading from which one tells the convention of the other."""
_COMPASS = re.compile(r"\b(gps|gnss|compass|bearing|azimuth|course|cog|kurs|track)\b")
"""Words of a heading that counts clockwise from north."""


def with_convention(g: Guess, motion: Motion, guesses: Mapping[str, Guess]) -> Guess:
    """Return a heading marked as one of a compass where the course over ground, the yaw rate or its name says so."""
    if g.signal != "heading":
        return g
    values, (course, _) = motion.series(g, turning=True), course_over_ground(motion, guesses)
    if len(course) == len(values):
        turns = np.exp(1j * (course - values)), np.exp(1j * (course + values - np.pi / 2))
        plain, compass = (float(np.nanmean(turn).real) if np.isfinite(turn).any() else 0.0 for turn in turns)
        why = "90° less the course over ground: a compass" if compass > max(plain, _SAME_COURSE) else ""
    else:
        rate = guesses.get("yaw_rate")
        both = MotionPair("", (), np.nan, np.nan)
        if rate is not None:
            both = compared("", ("yaw_rate",), motion.series(rate), motion.rate(values))
        named = _COMPASS.search(read_name(g.column).words) is not None
        why = "by its name of a compass, clockwise from north" if named and not both.factor > 0 else ""
    return replace(g, compass=True, why=(*g.why, why)) if why else g
