"""Smooth shapes, speed along a path, and the steering that follows a curvature, shared by the drives.

Shapes are functions of time or of the way travelled, so that a drive is the same at every sample time.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import ModelError
from harness.models.contracts import DriveContext, Option, Profile

LIMIT = Option(
    "lateral_acceleration_limit",
    "m/s^2",
    3.0,
    0.1,
    20.0,
    "largest kinematic lateral acceleration, speed^2 tan(road-wheel angle) / wheelbase, before it is refused",
)

_ROUNDING = 1e-9
"""Share by which a drive that is laid out to reach the limit exactly may pass it."""

_GRID = 0.1
"""m; spacing of the way on which curvature and speed of a path are laid out."""


def common(duration: float, speed: float) -> tuple[Option, ...]:
    """Return the options of every drive but recorded ones, with these defaults."""
    return (
        Option("duration", "s", duration, 1.0, 3600.0, "length of the drive"),
        Option("lead_in", "s", 3.0, 0.0, 600.0, "time driven straight ahead before the steering begins"),
        Option("speed", "m/s", speed, 0.3, 40.0, "speed at the start"),
        LIMIT,
    )


SPEED_CHANGE = Option(
    "speed_change",
    "m/s",
    0.0,
    -40.0,
    40.0,
    "speed gained between the end of the lead-in and the end of the drive, along a smooth S; negative: lost",
)
FADE = Option("fade", "s", 4.0, 0.1, 60.0, "time in which the steering motion grows to its full amplitude")
DIRECTION = Option("direction", "text", "left", 0.0, 0.0, "side of the (first) turn: left or right")


AMPLITUDE = Option(
    "amplitude",
    "rad",
    0.0,
    -30.0,
    30.0,
    "steering-wheel angle; negative begins to the right; one that is not stated is no more than the limit allows",
)


def amplitude(default: float) -> Option:
    """Return the option of a steering-wheel amplitude in rad, whose default ``within_limit`` makes fit the vehicle."""
    return replace(AMPLITUDE, default=default)


def within_limit(amplitude: float, profile: Profile, context: DriveContext, limit: float) -> float:
    """Return the amplitude at which the largest angle of a drive reaches the limit at its largest speed.

    Args:
        amplitude: That the profile has.
        profile: The drive; its steering grows with the amplitude, and its speed does not depend on it.
        context: Wheelbase and steering ratio.
        limit: Of the kinematic lateral acceleration in m/s^2.

    Returns:
        The amplitude in rad; the one that the profile has, where it keeps to the limit.
    """
    if np.abs(lateral_acceleration(profile, context)).max() <= limit * (1 + _ROUNDING):
        return amplitude
    allowed = float(steering_of_curvature(limit / float(profile.speed.max()) ** 2, context))
    return amplitude * allowed / float(np.abs(profile.steering_wheel_angle).max())


def seed(default: int) -> Option:
    """Return the option of a seed of a random drive."""
    return Option("seed", "", default, 0, 2**32 - 1, "whole number that fixes the random choices")


def sign(options: dict[str, Any]) -> float:
    """Return +1 for ``direction = "left"`` and -1 for ``"right"``.

    Raises:
        ModelError: If it is neither.
    """
    sides = {"left": 1.0, "right": -1.0}
    if options["direction"] not in sides:
        raise ModelError(f'direction: \'{options["direction"]}\' is unknown; write "left" or "right"')
    return sides[options["direction"]]


def generator(options: dict[str, Any]) -> np.random.Generator:
    """Return the random generator of option ``seed``.

    Raises:
        ModelError: If the seed is not a whole number.
    """
    if options["seed"] != int(options["seed"]):
        raise ModelError(f"seed: {options['seed']} is not a whole number")
    return np.random.Generator(np.random.PCG64(int(options["seed"])))


def time_of(options: dict[str, Any], context: DriveContext) -> Floats:
    """Return the sample times in s, shape ``(samples,)``, from 0 to ``duration``.

    Raises:
        ModelError: If the lead-in leaves no time to drive.
    """
    if options["lead_in"] >= options["duration"]:
        raise ModelError(
            f"lead_in: {options['lead_in']:g} s leaves nothing of the duration of {options['duration']:g} s"
        )
    # The tolerance keeps the last sample where duration / step is a whole number but for rounding.
    return np.arange(int(options["duration"] / context.step + 1e-9) + 1, dtype=np.float64) * context.step


def smooth_step(x: Floats) -> Floats:
    """Return the S from 0 (x <= 0) to 1 (x >= 1) with zero slope and curvature at both ends, any shape."""
    y: Floats = np.clip(x, 0.0, 1.0)
    return y**3 * (10.0 + y * (6.0 * y - 15.0))


def smooth_ramp(x: Floats, rounding: float) -> Floats:
    """Return a ramp of slope 1 from x = 0 whose corner is rounded over ``[0, rounding]``, any shape.

    It is the integral of the S, so it runs ``rounding / 2`` behind ``max(x, 0)``.
    """
    y = np.clip(x / rounding, 0.0, 1.0)
    integral = y**4 * (2.5 + y * (y - 3.0))
    return rounding * integral + np.maximum(x - rounding, 0.0)


def limited(x: Floats, top: float, rounding: float) -> Floats:
    """Return a ramp of slope 1 from x = 0 to ``top`` with both corners rounded, any shape."""
    rounding = min(rounding, top)
    return smooth_ramp(x, rounding) - smooth_ramp(x - top, rounding)


def changing_speed(options: dict[str, Any], time: Floats) -> Floats:
    """Return the speed in m/s of options ``speed`` and ``speed_change``, shape as ``time``.

    Raises:
        ModelError: If the drive would end at a standstill or backwards.
    """
    final = options["speed"] + options["speed_change"]
    if final < 0.3:
        raise ModelError(
            f"speed_change: {options['speed_change']:g} m/s leaves {final:g} m/s of {options['speed']:g} m/s;"
            " at least 0.3 m/s must be left"
        )
    span = time[-1] - options["lead_in"]
    return options["speed"] + options["speed_change"] * smooth_step((time - options["lead_in"]) / span)


def steering_of_curvature(curvature: Floats | float, context: DriveContext) -> Floats:
    """Return the steering-wheel angle in rad that follows a path, ``ratio * atan(wheelbase * curvature)``.

    Args:
        curvature: Of the path of the rear axle in 1/m, left positive, any shape.
        context: Wheelbase and steering ratio.
    """
    return context.steering_ratio * np.arctan(context.wheelbase * curvature)


def lateral_acceleration(profile: Profile, context: DriveContext) -> Floats:
    """Return the kinematic lateral acceleration ``speed^2 tan(road-wheel angle) / wheelbase`` in m/s^2."""
    road = profile.steering_wheel_angle / context.steering_ratio
    return profile.speed**2 * np.tan(road) / context.wheelbase


def check_lateral_acceleration(profile: Profile, context: DriveContext, limit: float) -> None:
    """Refuse a drive that asks for more lateral acceleration than the limit.

    Args:
        profile: The drive.
        context: Wheelbase and steering ratio.
        limit: In m/s^2.

    Raises:
        ModelError: With the peak, its time and what to lower; also if the road wheels turn past 75 degrees.
    """
    road = np.abs(profile.steering_wheel_angle) / context.steering_ratio
    if road.max() > np.radians(75.0):
        n = int(road.argmax())
        raise ModelError(
            f"turns the road wheels to {np.degrees(road[n]):.0f} deg at {profile.time[n]:.2f} s, "
            f"which no axle does; lower the steering-wheel angle below {75 * context.steering_ratio:.0f} deg"
        )
    demand = np.abs(lateral_acceleration(profile, context))
    n = int(demand.argmax())
    if demand[n] > limit * (1 + _ROUNDING):
        speed, wheel = profile.speed[n], profile.steering_wheel_angle[n]
        slower = speed * np.sqrt(limit / demand[n])
        straighter = context.steering_ratio * np.arctan(limit * context.wheelbase / speed**2)
        raise ModelError(
            f"asks for {demand[n]:.2f} m/s^2 of lateral acceleration at {profile.time[n]:.2f} s "
            f"({speed:.2f} m/s with the steering wheel at {np.degrees(wheel):.1f} deg), "
            f"the limit is {limit:g} m/s^2; lower the speed there to {slower:.2f} m/s or the steering-wheel "
            f"angle to {np.degrees(straighter):.1f} deg, or raise {LIMIT.name}"
        )


@dataclass(frozen=True)
class Arc:
    """A piece of a path: curvature that rises and falls smoothly along the way.

    Attributes:
        length: Way from the first curvature to the last in m.
        curvature: Curvature on the plateau in 1/m, left positive; 0 for a straight.
        transition: Way over which the curvature rises, and again falls, in m (at most half the length).
        speed: Speed wanted on this piece in m/s.
    """

    length: float
    curvature: float
    transition: float
    speed: float

    @staticmethod
    def turning(angle: float, radius: float, transition: float, speed: float) -> Arc:
        """Return the arc that turns the heading by ``angle`` (rad, left positive) on ``radius`` (m).

        The S-shaped rise and fall turn half as much per metre as the plateau, so they lengthen the arc; where
        a small turn leaves no room for them they are shortened, and the radius is kept.
        """
        way = abs(angle) * radius
        transition = min(transition, way)
        return Arc(way + transition, float(np.sign(angle)) / radius, transition, speed)


def follow(
    arcs: Sequence[Arc],
    options: dict[str, Any],
    context: DriveContext,
    acceleration: float,
    lateral: float | None = None,
) -> Profile:
    """Drive a path of arcs after the straight lead-in; straight on when it ends before the drive does.

    The way is travelled at ``speed`` (of the trailer, for a semitrailer); each arc's own speed is reached by
    braking before it and left by accelerating after it.

    Args:
        arcs: Pieces in order.
        options: Validated options with ``duration``, ``lead_in`` and ``speed``.
        context: Sampling, wheelbase and steering ratio.
        acceleration: Largest longitudinal acceleration and deceleration in m/s^2.
        lateral: The driver slows for bends to keep speed^2 times curvature below this (m/s^2); None: never.
    """
    time = time_of(options, context)
    way, curvature, speed, elapsed = _lay_out(arcs, options, acceleration, lateral)
    travelled = np.interp(time, elapsed, way)
    return Profile(
        time,
        steering_of_curvature(np.interp(travelled, way, curvature), context),
        np.interp(travelled, way, speed),
    )


def _lay_out(
    arcs: Sequence[Arc], options: dict[str, Any], acceleration: float, lateral: float | None
) -> tuple[Floats, Floats, Floats, Floats]:
    """Return way, curvature, speed and elapsed time on a grid of the way, each of shape ``(points,)``."""
    lead = options["speed"] * options["lead_in"]
    end = lead + sum(a.length for a in arcs) + options["speed"] * options["duration"] + 10.0
    way = np.arange(int(end / _GRID) + 2, dtype=np.float64) * _GRID
    curvature = np.zeros_like(way)
    wanted = np.full_like(way, options["speed"])
    begin = lead
    for arc in arcs:
        there = slice(*np.searchsorted(way, [begin, begin + arc.length]))
        x = way[there] - begin
        rise = max(arc.transition, 1e-9)
        curvature[there] = arc.curvature * np.minimum(smooth_step(x / rise), smooth_step((arc.length - x) / rise))
        wanted[there] = arc.speed
        begin += arc.length
    if lateral is not None:
        wanted = np.minimum(wanted, np.sqrt(lateral / np.maximum(np.abs(curvature), 1e-9)))
    speed = _anticipate(way, wanted, acceleration, reach=2.0 * float(wanted.min()))
    elapsed = np.concatenate([[0.0], np.cumsum(2 * _GRID / (speed[1:] + speed[:-1]))])
    return way, curvature, speed, elapsed


def _anticipate(way: Floats, wanted: Floats, acceleration: float, reach: float) -> Floats:
    """Return the highest speed below ``wanted`` whose changes the driver can brake and accelerate for.

    ``v^2`` may change by ``2 a`` per metre, so it is the lower envelope of lines of that slope; both
    directions are running minima. The kinks are then rounded by a moving mean that is fed with the minimum
    over its own reach, so that the result never exceeds ``wanted``.
    """
    slope = 2.0 * acceleration * way
    square = wanted**2
    square = np.minimum.accumulate(square - slope) + slope
    square = (np.minimum.accumulate((square + slope)[::-1]))[::-1] - slope
    half = max(round(0.5 * reach / _GRID), 1)
    padded = np.pad(np.sqrt(square), 2 * half, mode="edge")
    lowest = np.lib.stride_tricks.sliding_window_view(padded, 2 * half + 1).min(axis=-1)
    weights = np.hanning(2 * half + 3)[1:-1]
    return np.convolve(lowest, weights / weights.sum(), mode="valid")


def fill(
    manoeuvre: Callable[[int], Sequence[Arc]],
    options: dict[str, Any],
    acceleration: float,
    lateral: float | None = None,
) -> list[Arc]:
    """Repeat a manoeuvre for as long as another one ends within the duration.

    Args:
        manoeuvre: Repetition number to arcs.
        options: Validated options with ``duration``, ``lead_in`` and ``speed``.
        acceleration: As in ``follow``.
        lateral: As in ``follow``.

    Raises:
        ModelError: If not even one fits.
    """
    arcs: list[Arc] = []
    for repetition in itertools.count():
        more = [*arcs, *manoeuvre(repetition)]
        way, _, _, elapsed = _lay_out(more, options, acceleration, lateral)
        end = options["speed"] * options["lead_in"] + sum(a.length for a in more)
        needed = float(np.interp(end, way, elapsed))
        if needed > options["duration"]:
            break
        arcs = more
    if not arcs:
        raise ModelError(
            f"duration: lead-in and one manoeuvre take {needed:.1f} s, more than {options['duration']:g} s; "
            "raise the duration or the speed"
        )
    return arcs


def alternating_turns(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return turns by ``angle`` on ``radius`` to alternating sides, each after a straight, while time allows.

    Args:
        options: Validated options with those of ``common`` and ``radius``, ``angle``, ``transition``,
            ``turn_speed``, ``straight``, ``direction`` and ``acceleration``.
        context: Sampling, wheelbase and steering ratio.

    Raises:
        ModelError: If not even one turn fits into the duration.
    """
    side = sign(options)
    straight = Arc(options["straight"], 0.0, 0.0, options["speed"])
    speed = min(options["turn_speed"], options["speed"])

    def turn(repetition: int) -> list[Arc]:
        angle = (-1) ** repetition * side * options["angle"]
        return [straight, Arc.turning(angle, options["radius"], options["transition"], speed)]

    arcs = fill(turn, options, options["acceleration"])
    return follow(arcs, options, context, options["acceleration"])
