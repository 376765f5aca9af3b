"""Limits of a test drive: of driver and robot, of the road, and of every version of the vehicle that is possible."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import read_toml
from harness.common.registry import closest
from harness.common.units import to_si
from harness.models.assembly.model import StateSpaceModel
from harness.models.contracts import Profile
from harness.study.motion import path_of, velocities


@dataclass(frozen=True)
class Limits:
    """What a drive has to keep to; SI units.

    Attributes:
        lowest_speed: m/s.
        highest_speed: m/s.
        lateral_acceleration: Largest of any body's CoG in m/s^2.
        longitudinal_acceleration: Largest magnitude, of braking too, in m/s^2.
        friction: Largest acceleration in the plane of any body's CoG over that of gravity.
        steering_wheel_angle: Largest magnitude in rad.
        steering_rate: Largest magnitude in rad/s.
        articulation: Largest magnitude of the articulation angle in rad.
        road_length: Along the first heading, of the path of each body's CoG, in m.
        road_width: Across it, of the paths of all together, in m.
        duration: Longest single drive in s.
    """

    lowest_speed: float = 5.0
    highest_speed: float = 20.0
    lateral_acceleration: float = 3.0
    longitudinal_acceleration: float = 4.0
    friction: float = np.inf
    steering_wheel_angle: float = np.pi
    steering_rate: float = 8.0
    articulation: float = 0.8
    road_length: float = np.inf
    road_width: float = np.inf
    duration: float = 30.0


UNITS = {
    "lowest_speed": "m/s", "highest_speed": "m/s", "lateral_acceleration": "m/s^2",
    "longitudinal_acceleration": "m/s^2", "friction": "", "steering_wheel_angle": "rad",
    "steering_rate": "rad/s", "articulation": "rad", "road_length": "m", "road_width": "m", "duration": "s",
}  # fmt: skip
"""SI unit of each limit."""

SHORTEST_DRIVE = 5.0
"""s of a drive at least."""

_GRAVITY = 9.81
_EXIT = 1.0
"""s straight on behind a drive for which there has to be road: until then a driver has turned or braked."""


def limits_of(file: Path | None, stated: Mapping[str, object]) -> Limits:
    """Return the limits that a file and single ones state; those of ``Limits`` for what neither does.

    Args:
        file: TOML with limits by name: numbers in SI units, or text with a unit.
        stated: Limits by name, which take the place of those in the file.

    Raises:
        UserError: If one is unknown, not positive or of the wrong unit, or no speed and no time is left by them.
    """
    content: dict[str, tuple[Any, str]] = {}
    if file is not None:
        content = {name: (value, str(file)) for name, value in read_toml(file).items()}
    content |= {name: (value, "limit") for name, value in stated.items()}
    numbers = {}
    for name, (value, where) in content.items():
        if name not in UNITS:
            raise UserError(f"{where}: no limit '{name}'{closest(name, list(UNITS))}")
        numbers[name] = to_si(value, UNITS[name], f"{where}, {name}")
        if not numbers[name] > 0:
            raise UserError(f"{where}, {name}: {value!r} must be above zero")
    limits = replace(Limits(), **numbers)
    if limits.lowest_speed > limits.highest_speed:
        raise UserError(
            f"limits: lowest_speed {limits.lowest_speed:g} m/s is above highest_speed {limits.highest_speed:g} m/s"
        )
    if limits.duration < SHORTEST_DRIVE:
        raise UserError(f"limits: duration {limits.duration:g} s is shorter than any manoeuvre, {SHORTEST_DRIVE:g} s")
    return limits


def stated(limits: Limits) -> dict[str, float | None]:
    """Return limits by name, ``None`` for what is not limited."""
    values = {f.name: float(getattr(limits, f.name)) for f in fields(limits)}
    return {name: value if np.isfinite(value) else None for name, value in values.items()}


class PlannedMotion(NamedTuple):
    """How a vehicle moves in a drive.

    Attributes:
        paths: ``x`` and ``y`` of each body's CoG in m, from its own first place, with the exit; none if its states do
            not say.
        lateral_acceleration: Of each body's CoG in m/s^2 ``(bodies, samples)``.
        articulation: rad ``(samples,)``; zero of one body.
        longitudinal_acceleration: Of the speed that is driven, in m/s^2 ``(samples,)``.
    """

    paths: tuple[tuple[Floats, Floats], ...]
    lateral_acceleration: Floats
    articulation: Floats
    longitudinal_acceleration: Floats


def motion_of(model: StateSpaceModel, values: Mapping[str, Floats], time: Floats) -> PlannedMotion:
    """Return how a vehicle moves.

    Args:
        model: Its equations.
        values: States and inputs over time ``(samples,)``, parameters as numbers, SI.
        time: s ``(samples,)``.
    """
    paths, accelerations, exit_steps = [], [], _EXIT / (time[1] - time[0])
    for body in model.bodies:
        moving = velocities(model, body, values)
        if moving is None:
            continue
        forward, lateral, rate = (np.broadcast_to(v, time.shape) for v in moving)
        accelerations.append(np.gradient(lateral, time) + forward * rate)
        x, y = (np.append(p, p[-1] + exit_steps * (p[-1] - p[-2])) for p in path_of((forward, lateral, rate), time))
        paths.append((x, y))
    articulation = values.get("articulation_angle", np.zeros(len(time)))
    longitudinal = np.gradient(values["speed"], time)
    return PlannedMotion(tuple(paths), np.array(accelerations).reshape(-1, len(time)), articulation, longitudinal)


def passed_by_driver(profile: Profile, limits: Limits) -> str:
    """Return which limit of speed, steering or time a drive passes; empty if none."""
    wheel, step = profile.steering_wheel_angle, profile.time[1] - profile.time[0]
    reached = [
        (float(np.abs(wheel).max()), limits.steering_wheel_angle, "steering_wheel_angle"),
        (float(np.abs(np.diff(wheel)).max() / step), limits.steering_rate, "steering_rate"),
        (float(profile.speed.max()), limits.highest_speed, "highest_speed"),
        (limits.lowest_speed, float(profile.speed.min()), "lowest_speed"),
        (float(np.abs(np.diff(profile.speed)).max() / step), limits.longitudinal_acceleration,
         "longitudinal_acceleration"),
        (float(profile.time[-1]), limits.duration, "duration"),
    ]  # fmt: skip
    return _first(reached)


def passed_by_vehicle(motion: PlannedMotion, limits: Limits) -> str:
    """Return which limit of acceleration, articulation or road a motion passes; empty if none."""
    length = max((float(np.ptp(x)) for x, _ in motion.paths), default=0.0)
    width = float(np.ptp(np.concatenate([np.zeros(1), *(y for _, y in motion.paths)])))  # where all begin
    in_plane = np.hypot(motion.lateral_acceleration, motion.longitudinal_acceleration)
    reached = [
        (float(np.abs(motion.lateral_acceleration).max(initial=0.0)), limits.lateral_acceleration,
         "lateral_acceleration"),
        (float(in_plane.max(initial=0.0)) / _GRAVITY, limits.friction, "friction"),
        (float(np.abs(motion.articulation).max()), limits.articulation, "articulation"),
        (length, limits.road_length, "road_length"),
        (width, limits.road_width, "road_width"),
    ]  # fmt: skip
    return _first(reached)


def _first(reached: Sequence[tuple[float, float, str]]) -> str:
    tolerance = 1.0 + 1e-6
    return next((name for value, limit, name in reached if not value <= limit * tolerance), "")
