"""Manoeuvres of the standards, each with its free quantities, as drives of ``models/drives``.

A manoeuvre is a point of the unit cube: each coordinate is one free quantity between its bounds, and the first says how
hard the vehicle is driven, from a tenth of what the limits allow up to all of it.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.config import DriveSpec, ModelSpec, single_drive
from harness.experiment.limits import SHORTEST_DRIVE, Limits
from harness.models.contracts import Profile
from harness.models.drives import spline

_LEAST = 0.1
"""Share of what the limits allow at which the gentlest manoeuvre is driven."""

_BEYOND = 1.5
"""Kinematic lateral acceleration over its limit up to which angles are tried: a vehicle that understeers does less."""

LEAD_IN = 1.0
"""s straight ahead before the steering begins."""


@dataclass(frozen=True)
class SearchRange:
    """What the quantities of a manoeuvre may be.

    Attributes:
        limits: Of the drive.
        wheelbase: m.
        ratio: Steering-wheel angle over road-wheel angle.
        short: Duration of a manoeuvre of one steering motion in s.
        shortest: Of the shortest drive in s; the limits then refuse it where the road is too short.
        lead_in: How long a manoeuvre of one steering motion is straight ahead before it, in s.
        seed: Of what is random in a drive.
    """

    limits: Limits
    wheelbase: float
    ratio: float
    short: float = 8.0
    shortest: float = SHORTEST_DRIVE
    lead_in: float = LEAD_IN
    seed: int = 0

    @classmethod
    def of(
        cls, spec: ModelSpec, limits: Limits, shortest: float = 0.0, lead_in: float = LEAD_IN, seed: int = 0
    ) -> SearchRange:
        """Return the room of a model, with the shortest recording that is taken and what is left out of its begin."""
        least = max(cls.shortest, shortest)
        return cls(limits, spec.wheelbase, spec.steering_ratio, max(cls.short, least), least, lead_in, seed)

    def speed(self, share: float) -> float:
        """Return a speed between the limits in m/s."""
        return between(self.limits.lowest_speed, self.limits.highest_speed, share)

    def angle(self, share: float, speed: float) -> float:
        """Return a steering-wheel angle in rad, up to what the limits allow at a speed."""
        return between(_LEAST, 1.0, share) * self._largest(speed)

    def angle_share(self, angle: float, speed: float) -> float:
        """Return the share of an angle that ``angle`` returns, from 0 to 1."""
        return share_between(_LEAST, 1.0, angle / self._largest(speed))

    def _largest(self, speed: float) -> float:
        curvature = _BEYOND * self.limits.lateral_acceleration / speed**2
        return min(self.limits.steering_wheel_angle, self.ratio * math.atan(self.wheelbase * curvature))

    def duration(self, speed: float, ways_back: bool = False) -> float:
        """Return how long may be driven at a speed in s; the road is as long as it is where nothing turns back."""
        road = math.inf if ways_back else 0.98 * self.limits.road_length / speed
        return max(math.floor(10.0 * min(self.limits.duration, road)) / 10.0, self.shortest)


def between(low: float, high: float, share: float) -> float:
    """Return a positive number between two, evenly spread in its logarithm."""
    return low * (high / low) ** share


def share_between(low: float, high: float, value: float) -> float:
    """Return where a number lies between two as ``between`` takes it, from 0 to 1."""
    if not low < high or not value > 0:
        return 0.0
    return min(max(math.log(value / low) / math.log(high / low), 0.0), 1.0)


Options = dict[str, float | str]


@dataclass(frozen=True)
class Manoeuvre:
    """A kind of drive with free quantities.

    Attributes:
        name: As the user names it.
        standard: Where it comes from.
        kind: File in ``models/drives``.
        free: Number of free quantities.
        options: From a point of the unit cube and the room to the options of the kind.
        like: From a drive and the room to points whose drives are most like it; none where it has a form of its own.
    """

    name: str
    standard: str
    kind: str
    free: int
    options: Callable[[Floats, SearchRange], Options]
    like: Callable[[Profile, SearchRange], list[Floats]] | None = None

    def drive(self, point: Floats, room: SearchRange, name: str) -> DriveSpec:
        """Return the drive at a point ``(free,)`` of the unit cube."""
        options = {k: rounded(v) if isinstance(v, float) else v for k, v in self.options(point, room).items()}
        options = {"lead_in": LEAD_IN, **options}
        options |= {"lateral_acceleration_limit": 20.0}  # the limits are those of the simulation
        return single_drive({"name": name, "kind": self.kind, **options}, f"drive '{name}'")


def rounded(value: float) -> float:
    """Return a number to four digits, as a plan states it."""
    return float(f"{value:.4g}")


def _circle(p: Floats, room: SearchRange) -> Options:
    speed = room.speed(p[1])
    radius = max(speed**2 / (between(_LEAST, 1.0, p[0]) * room.limits.lateral_acceleration), 6.0)
    return {"speed": speed, "radius": radius, "duration": room.duration(speed, ways_back=True), "transition": 3.0}


def _speeding_circle(p: Floats, room: SearchRange) -> Options:
    last = room.speed(p[1])
    first = max(room.limits.lowest_speed, 0.3 * last)
    radius = max(last**2 / (between(_LEAST, 1.0, p[0]) * room.limits.lateral_acceleration), 6.0)
    duration = room.duration(last, ways_back=True)
    return {"speed": first, "speed_change": last - first, "radius": radius, "duration": duration, "transition": 3.0}


def _ramp(p: Floats, room: SearchRange) -> Options:
    speed = room.speed(p[1])
    angle, duration = room.angle(p[0], speed), room.duration(speed)
    return {"speed": speed, "amplitude": angle, "rate": angle / max(duration - 3.0, 2.0), "duration": duration}


def _step(p: Floats, room: SearchRange) -> Options:
    speed, rise = room.speed(p[1]), between(0.15, 1.0, p[2])
    angle = room.angle(p[0], speed)
    return {"speed": speed, "amplitude": angle, "rise_time": rise, "duration": min(room.short, room.duration(speed)),
            "lead_in": room.lead_in}  # fmt: skip


def _sine(p: Floats, room: SearchRange) -> Options:
    speed = room.speed(p[1])
    frequency = between(0.1, 2.5, p[2])
    return {
        "speed": speed, "amplitude": room.angle(p[0], speed), "frequency": frequency, "fade": 1.0,
        "duration": room.duration(speed),
    }  # fmt: skip


def _sweep(p: Floats, room: SearchRange) -> Options:
    speed = room.speed(p[1])
    return {
        "speed": speed, "amplitude": room.angle(p[0], speed), "first_frequency": between(0.05, 0.5, p[2]),
        "last_frequency": between(0.8, 4.0, p[3]), "fade": 1.0, "duration": room.duration(speed),
    }  # fmt: skip


def _random(p: Floats, room: SearchRange) -> Options:
    speed = room.speed(p[1])
    limits = room.limits
    variation = 0.5 * p[3] * min(speed - limits.lowest_speed, limits.highest_speed - speed)
    rise = between(0.2, 2.0, p[2])
    return {
        "speed": speed, "amplitude": room.angle(p[0], speed), "rise_time": rise, "longest_hold": 2.0 * rise,
        "speed_variation": variation, "seed": 1 + room.seed, "duration": room.duration(speed + variation),
    }  # fmt: skip


def _lane_change(p: Floats, room: SearchRange) -> Options:
    speed, offset = room.speed(p[1]), 3.5
    # Of an S-shaped path the largest lateral acceleration is 5.77 offset (speed / length)^2.
    change = speed * math.sqrt(5.77 * offset / (between(_LEAST, 1.0, p[0]) * room.limits.lateral_acceleration))
    change, stay = max(change, 8.0), between(5.0, 50.0, p[2])
    duration = max(math.ceil(room.lead_in + (2.0 * change + stay) / speed + 2.0), room.short)
    return {
        "speed": speed, "offset": offset, "change": change, "back": change, "stay": stay, "duration": float(duration),
        "lead_in": room.lead_in,
    }  # fmt: skip


def _dwell(p: Floats, room: SearchRange) -> Options:
    speed = room.speed(p[1])
    duration = min(room.short, room.duration(speed))
    return {"speed": speed, "amplitude": room.angle(p[0], speed), "frequency": 0.7, "duration": duration,
            "lead_in": room.lead_in}  # fmt: skip


def _brake(p: Floats, room: SearchRange) -> Options:
    limits = room.limits
    speed = max(room.speed(p[1]), min(1.5 * limits.lowest_speed, limits.highest_speed))
    radius = max(speed**2 / (between(_LEAST, 1.0, p[0]) * limits.lateral_acceleration), 6.0)
    final, deceleration = max(limits.lowest_speed, 0.4 * speed), 0.9 * limits.longitudinal_acceleration
    deceleration = between(min(1.0, deceleration), deceleration, p[2])
    seconds = room.lead_in + 3.0 + 1.5 + (speed - final) / deceleration + 2.0
    return {
        "speed": speed, "radius": radius, "deceleration": deceleration, "final_speed": final, "transition": 3.0,
        "hold": 1.5, "duration": max(float(math.ceil(seconds)), room.shortest), "lead_in": room.lead_in,
    }  # fmt: skip


SPLINE = "spline"
"""Its kind."""

_STEERING, _SPEEDS = 12, 3
"""Control points of a spline."""

_FASTER = 1.4
"""Largest speed of a spline over that at its start."""

_CLOSEST, _WIDEST = 0.05, 2.5
"""Shortest and longest time between control points in s."""

_SPACINGS, _FINER = 200, 3
"""Times between control points that are tried to imitate a drive, and how often more finely about the best."""

_EVERY = 5
"""Samples of it of which one is taken."""


def _spline(p: Floats, room: SearchRange) -> Options:
    speed = room.speed(p[1])
    limits, (steering, speeds) = room.limits, np.split(p[4:], [_STEERING])
    factors = [between(1.0 / _FASTER, _FASTER, float(share)) for share in speeds]
    allowed = np.clip(factors, limits.lowest_speed / speed, limits.highest_speed / speed)
    longest = room.duration(speed * max(1.0, float(allowed.max())))
    duration = math.floor(10.0 * between(room.shortest, longest, p[3]) + 1e-6) / 10.0
    return {
        "speed": speed, "amplitude": room.angle(p[0], speed), "steering": _text(2.0 * steering - 1.0),
        "spacing": between(_CLOSEST, _WIDEST, p[2]), "speeds": _text(allowed), "duration": duration,
    }  # fmt: skip


def _text(points: Floats) -> str:
    return " ".join(f"{value:.3g}" for value in points)


def _as_spline(profile: Profile, room: SearchRange) -> list[Floats]:
    """Return the spline that misses least of the steering of a drive, with its speed, as long and repeated on."""
    speed, t, wheel = (a[::_EVERY] for a in (profile.speed, profile.time - LEAD_IN, profile.steering_wheel_angle))
    low, high, largest = 0.0, 1.0, room.angle(1.0, float(speed[0]))
    for _ in range(_FINER):  # many periods are in step only where the spacing is right
        shares = np.linspace(low, high, _SPACINGS)
        tables = [spline.weights(t / between(_CLOSEST, _WIDEST, float(share)), _STEERING) for share in shares]
        solved = [np.clip(np.linalg.lstsq(table, wheel, rcond=None)[0], -largest, largest) for table in tables]
        missed = [float(np.std(table @ points - wheel)) for table, points in zip(tables, solved, strict=True)]
        best = int(np.argmin(missed))
        low, high = shares[max(best - 1, 0)], shares[min(best + 1, _SPACINGS - 1)]
    changes = np.linalg.lstsq(spline.weights(t * (_SPEEDS / t[-1]), _SPEEDS), speed / speed[0] - 1.0, rcond=None)
    amplitude, longest = float(np.abs(solved[best]).max()), room.duration(float(profile.speed.max()))
    lasts = dict.fromkeys([share_between(room.shortest, longest, float(profile.time[-1])), 1.0])
    return [
        np.array([
            room.angle_share(amplitude, speed[0]),
            share_between(room.limits.lowest_speed, room.limits.highest_speed, speed[0]),
            shares[best],
            last,
            *(0.5 + 0.5 * solved[best] / max(amplitude, 1e-9)),
            *(share_between(1.0 / _FASTER, _FASTER, 1.0 + float(c)) for c in changes[0]),
        ])
        for last in lasts
    ]  # fmt: skip


MANOEUVRES: tuple[Manoeuvre, ...] = (
    Manoeuvre("circle", "ISO 4138, constant speed and radius", "steady_circle", 2, _circle),
    Manoeuvre("speeding-circle", "ISO 4138, constant radius, rising speed", "steady_circle", 2, _speeding_circle),
    Manoeuvre("ramp", "ISO 4138, slowly growing steering at constant speed", "ramp", 2, _ramp),
    Manoeuvre("step", "ISO 7401, step steer", "step", 3, _step),
    Manoeuvre("weave", "ISO 7401 and 13674, sinusoidal steering; a slalom at its frequency", "sine", 3, _sine),
    Manoeuvre("sweep", "ISO 7401, frequency sweep", "sine_sweep", 4, _sweep),
    Manoeuvre("random", "ISO 7401, random steering", "random_sequence", 4, _random),
    Manoeuvre("lane-change", "ISO 3888, double lane change", "lane_change", 3, _lane_change),
    Manoeuvre("dwell", "ISO 19365, sine with dwell", "sine_with_dwell", 2, _dwell),
    Manoeuvre("brake", "ISO 7975, braking in a turn, steering held", "brake_in_turn", 3, _brake),
    Manoeuvre("spline", "free steering and speed", SPLINE, 4 + _STEERING + _SPEEDS, _spline, _as_spline),
)


def chosen(names: Sequence[str]) -> tuple[Manoeuvre, ...]:
    """Return the manoeuvres of some names; all of no name.

    Raises:
        UserError: If there is none of a name.
    """
    by_name = {m.name: m for m in MANOEUVRES}
    for name in names:
        if name not in by_name:
            raise UserError(f"manoeuvre: there is no '{name}'{closest(name, list(by_name))}: {', '.join(by_name)}")
    return tuple(by_name[n] for n in dict.fromkeys(names)) or MANOEUVRES
