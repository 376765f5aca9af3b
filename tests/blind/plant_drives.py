"""What the driver does: two minutes of manoeuvres in random order at speeds that change, or a drive that is stated.

A manoeuvre asks for lateral acceleration; the steering-wheel angle follows from the curvature and an understeer
gradient, so a drive is as hard at every speed. Everything is laid out on half steps, which Runge-Kutta reads.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]

STEP = 1e-3
"""s; step of the integration."""

RUN_IN = 8.0
"""s driven before the recording starts, so that it does not start with a transient."""

DURATION = 120.0
"""s; length of a recording."""


@dataclass(frozen=True)
class Driver:
    """Habits by vehicle: lengths in m, speeds in m/s, accelerations in m/s^2.

    The hardest lateral acceleration stays short of where a laden truck lifts a wheel (about 3.5 m/s^2), and of where
    a car's tyres on a dry road would let go.
    """

    wheelbase: float
    steering_ratio: float
    understeer: float  # rad per m/s^2
    slowest: float
    fastest: float
    hardest: float
    speeding_up: float
    highest_frequency: float = 1.0  # Hz at the end of a sweep


DRIVERS = {
    "semitrailer": Driver(3.71, 23.0, 0.004, 10.0, 22.0, 2.8, 1.6),
    "car": Driver(2.70, 16.0, 0.002, 12.0, 30.0, 5.5, 2.5, 1.5),
}


@dataclass(frozen=True)
class Drive:
    """The driver's inputs at half steps from ``-RUN_IN`` to the end, arrays ``(half steps,)``.

    Attributes:
        time: s.
        steering_wheel_angle: rad, left positive.
        speed: m/s.
        speed_rate: m/s^2, exact derivative of the speed.
        manoeuvres: Name, begin and end (s), and largest lateral acceleration asked for (m/s^2).
    """

    time: Array
    steering_wheel_angle: Array
    speed: Array
    speed_rate: Array
    manoeuvres: tuple[dict[str, Any], ...]


def rise(t: Array, begin: float, duration: float) -> Array:
    """Return half a cosine from 0 before ``begin`` to 1 after ``begin + duration``."""
    return 0.5 - 0.5 * np.cos(np.pi * np.clip((t - begin) / duration, 0.0, 1.0))


def _random(t: Array, span: float, driver: Driver, rng: np.random.Generator) -> Array:
    """Return random levels, each reached within 0.5 to 1.5 s and held for up to 1.5 s."""
    y, level, begin = np.zeros_like(t), 0.0, 0.0
    while begin < span - 4.0:
        goal, duration = rng.uniform(-1.0, 1.0), rng.uniform(0.5, 1.5)
        y += (goal - level) * rise(t, begin, duration)
        level, begin = goal, begin + duration + rng.uniform(0.0, 1.5)
    return y - level * rise(t, span - 2.0, 1.5)


def _lane_changes(t: Array, span: float, driver: Driver, rng: np.random.Generator) -> Array:
    """Return one lane change after the other, to either side by turns."""
    y, begin, side = np.zeros_like(t), 0.0, rng.choice([-1.0, 1.0])
    while (period := rng.uniform(2.5, 5.0)) + begin < span:
        s = np.clip((t - begin) / period, 0.0, 1.0)
        y += side * np.sin(2.0 * np.pi * s) * np.sin(np.pi * s)
        begin, side = begin + period + rng.uniform(0.5, 2.0), -side
    return y


def _circle(t: Array, span: float, driver: Driver, rng: np.random.Generator) -> Array:
    """Return a steady circle with slow entry and exit."""
    return rng.choice([-1.0, 1.0]) * (rise(t, 0.0, 3.0) - rise(t, span - 3.5, 3.0))


def _steps(t: Array, span: float, driver: Driver, rng: np.random.Generator) -> Array:
    """Return quick steps (0.3 s) to one side and back, then to the other."""
    y, begin, side = np.zeros_like(t), 0.0, rng.choice([-1.0, 1.0])
    while begin + 5.0 < span:
        hold = rng.uniform(2.0, 3.5)
        y += side * (rise(t, begin, 0.3) - rise(t, begin + hold, 0.3))
        begin, side = begin + hold + rng.uniform(1.0, 1.5), -side
    return y


def _sweep(t: Array, span: float, driver: Driver, rng: np.random.Generator) -> Array:
    """Return a sine that gets faster from 0.1 Hz on."""
    s = np.clip(t, 0.0, span)
    growth = (driver.highest_frequency / 0.1) ** (s / span)
    phase = 2.0 * np.pi * 0.1 * span / np.log(driver.highest_frequency / 0.1) * (growth - 1.0)
    return rng.choice([-0.7, 0.7]) * np.sin(phase) * (rise(t, 0.0, 1.0) - rise(t, span - 1.5, 1.5))


MANOEUVRES: dict[str, Callable[[Array, float, Driver, np.random.Generator], Array]] = {
    "random": _random,
    "lane_changes": _lane_changes,
    "circle": _circle,
    "steps": _steps,
    "sweep": _sweep,
}


def half_steps(duration: float = DURATION) -> Array:
    """Return the times in s on which drives are laid out; index ``2 * RUN_IN / STEP`` is time 0."""
    return (np.arange(round(2 * (RUN_IN + duration) / STEP) + 1) - round(2 * RUN_IN / STEP)) * (STEP / 2)


def stated(time: Array, steering_wheel_angle: Array, speed: Array) -> Drive:
    """Return a drive of straight lines between stated values, behind a run-in with the first of them.

    Args:
        time: s, rising, the first 0 ``(samples,)``.
        steering_wheel_angle: rad, left positive ``(samples,)``.
        speed: m/s ``(samples,)``.
    """
    t = half_steps(round(time[-1] / STEP) * STEP)
    slopes = np.append(np.diff(speed) / np.diff(time), 0.0)
    rate = np.where(t < 0.0, 0.0, slopes[np.clip(np.searchsorted(time, t, side="right") - 1, 0, len(time) - 1)])
    return Drive(t, np.interp(t, time, steering_wheel_angle), np.interp(t, time, speed), rate, ())


def draw(vehicle: str, rng: np.random.Generator) -> Drive:
    """Return a random drive in which every manoeuvre occurs once, and one of them twice.

    Args:
        vehicle: ``"semitrailer"`` or ``"car"``.
        rng: Decides order, sides, sizes and speeds.
    """
    driver, t = DRIVERS[vehicle], half_steps()
    order = [*MANOEUVRES, str(rng.choice(list(MANOEUVRES)))]
    rng.shuffle(order)
    ends = np.cumsum(rng.dirichlet(np.full(len(order), 40.0))) * (DURATION - 4.0) + 2.0
    begins = np.concatenate([[2.0], ends[:-1]])
    v = rng.uniform(driver.slowest, driver.fastest)
    speed, rate, wanted, plan = np.full_like(t, v), np.zeros_like(t), np.zeros_like(t), []
    for kind, begin, end in zip(order, begins, ends, strict=True):
        size = rng.uniform(0.5, 1.0) * driver.hardest
        span = end - begin - 1.0
        there = slice(*np.searchsorted(t, [begin, end]))
        wanted[there] = size * MANOEUVRES[kind](t[there] - begin, span, driver, rng)
        goal = rng.uniform(driver.slowest, driver.fastest)
        duration = min(max(abs(goal - v) * np.pi / 2 / driver.speeding_up, 2.0), end - begin)
        most = driver.speeding_up * duration * 2 / np.pi
        change = float(np.clip(goal - v, -most, most))
        speed += change * rise(t, begin, duration)
        s = np.clip((t - begin) / duration, 0.0, 1.0)
        rate += change * 0.5 * np.pi / duration * np.sin(np.pi * s)
        v += change
        plan.append({"name": kind, "begin": float(begin), "end": float(end), "lateral_acceleration": float(size)})
    road = (driver.wheelbase / speed**2 + driver.understeer) * wanted
    return Drive(t, driver.steering_ratio * road, speed, rate, tuple(plan))
