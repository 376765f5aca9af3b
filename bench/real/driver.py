"""Drives of a test engineer, the road under them, and the steering column.

A drive is a speed and a lateral acceleration that is asked for: quick steering, a steady circle to either side, lane
changes, slalom and random steering, at different speeds, braking and accelerating between them. Everything is laid out
at half steps, which Runge-Kutta reads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numba import njit

from bench.real.vehicle import STEP, Floats

DURATION = 120.0
"""s; length of a drive."""

RUN_IN = 6.0
"""s before it, straight ahead at its first speed."""

HALF_STEP = STEP / 2


class Driver(NamedTuple):
    """How a vehicle is driven, in SI units."""

    slowest: float
    fastest: float
    hardest: float  # lateral acceleration in bends
    tightest: float  # radius of a bend
    speeding_up: float
    braking: tuple[float, float]
    wheelbase: float
    understeer: float  # rad per m/s^2, as the driver knows the vehicle
    ratio: float
    tempo: float  # factor on the times of quick manoeuvres


DRIVERS = {
    "car": Driver(8.0, 30.0, 5.2, 20.0, 2.0, (2.0, 4.5), 2.7, 0.0027, 15.6, 1.0),
    "semitrailer": Driver(8.0, 23.0, 3.0, 28.0, 0.45, (0.9, 2.4), 3.7, 0.0026, 20.0, 1.7),
    "multi_body": Driver(8.0, 28.0, 4.8, 20.0, 2.0, (2.0, 4.0), 2.58, 0.0022, 16.0, 1.0),
}


@dataclass(frozen=True)
class Drive:
    """A drive at half steps, with its run-in.

    Attributes:
        time: In s, 0 at the end of the run-in.
        wheel: Steering-wheel angle in rad.
        speed: That is wanted, m/s.
        speed_rate: Its rate, m/s^2.
        bank: Of the road, rad, left side higher.
        rough: Of every wheel, share of its static load, ``(2 k + 1, wheels)``.
        manoeuvres: Name, begin (s), lateral acceleration that was asked for (m/s^2) and speed (m/s).
    """

    time: Floats
    wheel: Floats
    speed: Floats
    speed_rate: Floats
    bank: Floats
    rough: Floats
    manoeuvres: tuple[tuple[str, float, float, float], ...]


def smooth_step(x: Floats) -> Floats:
    """Return a step from 0 at ``x = 0`` to 1 at ``x = 1`` whose first two derivatives are continuous."""
    x = np.clip(x, 0.0, 1.0)
    return x * x * x * (10.0 - 15.0 * x + 6.0 * x * x)


def _pulse(t: Floats, begin: float, span: float, ramp: float) -> Floats:
    return smooth_step((t - begin) / ramp) - smooth_step((t - begin - span + ramp) / ramp)


def _steps(t: Floats, span: float, tempo: float, rng: np.random.Generator) -> Floats:
    """Turn the wheel quickly to one side and the other, and hold it."""
    y, at, side = np.zeros_like(t), 0.3, rng.choice([-1.0, 1.0])
    while at < span - 2.5 * tempo:
        hold = rng.uniform(1.2, 2.2) * tempo
        y += side * rng.uniform(0.5, 0.8) * _pulse(t, at, hold, rng.uniform(0.18, 0.35) * tempo)
        at, side = at + hold + rng.uniform(0.5, 1.2) * tempo, -side
    return y


def _circle(t: Floats, span: float, side: float) -> Floats:
    """Hold a bend; a second one is tighter."""
    half = 0.5 * span
    return side * (0.55 * _pulse(t, 0.2, half, 1.5) + 0.85 * _pulse(t, half, half - 0.3, 1.5))


def _lane_changes(t: Floats, span: float, tempo: float, rng: np.random.Generator) -> Floats:
    y, at, side = np.zeros_like(t), 0.3, rng.choice([-1.0, 1.0])
    while at < span - 3.5 * tempo:
        period = rng.uniform(2.0, 3.0) * tempo
        s = (t - at) / period
        y += side * rng.uniform(0.6, 0.95) * np.where((s > 0) & (s < 1), np.sin(2 * np.pi * s), 0.0)
        at, side = at + period + rng.uniform(0.8, 2.0) * tempo, -side
    return y


def _slalom(t: Floats, span: float, tempo: float, rng: np.random.Generator) -> Floats:
    """Swing, faster and faster."""
    first, last = 0.25 / tempo, rng.uniform(0.8, 1.3) / tempo
    s = np.clip(t - 0.3, 0.0, span - 0.6)
    phase = 2 * np.pi * (first * s + (last - first) * s**2 / (2 * span))
    return 0.6 * np.sin(phase) * _pulse(t, 0.3, span - 0.6, 0.8)


def _random(t: Floats, span: float, tempo: float, rng: np.random.Generator) -> Floats:
    y = np.zeros_like(t)
    for f in rng.uniform(0.1, 0.9, 7) / tempo:
        y += 0.3 * np.sin(2 * np.pi * f * t + rng.uniform(0.0, 6.28))
    return y * _pulse(t, 0.2, span - 0.4, 1.0)


MANOEUVRES = ("steps", "circle_left", "circle_right", "lane_changes", "slalom", "random", "lane_changes", "steps")


def _asked(name: str, t: Floats, span: float, tempo: float, rng: np.random.Generator) -> Floats:
    if name.startswith("circle"):
        return _circle(t, span, 1.0 if name.endswith("left") else -1.0)
    shapes = {"steps": _steps, "lane_changes": _lane_changes, "slalom": _slalom, "random": _random}
    return shapes[name](t, span, tempo, rng)


def draw_drive(vehicle: str, wheels: int, rng: np.random.Generator, seconds: float = DURATION) -> Drive:
    """Return a random drive in which every manoeuvre occurs.

    Args:
        vehicle: Name in ``DRIVERS``.
        wheels: How many it has.
        rng: Decides order, sides, sizes, speeds and road.
        seconds: Its length.
    """
    driver = DRIVERS[vehicle]
    t = np.arange(-round(RUN_IN / HALF_STEP), round(seconds / HALF_STEP) + 1) * HALF_STEP
    order = list(rng.permutation(MANOEUVRES))
    ends = 1.5 + np.cumsum(rng.dirichlet(np.full(len(order), 50.0))) * (seconds - 2.5)
    v = rng.uniform(0.4, 0.8) * driver.fastest
    rate, asked, plan, begin = np.zeros_like(t), np.zeros_like(t), [], 1.5
    for name, end in zip(order, ends, strict=True):
        goal = rng.uniform(driver.slowest + 2.0, driver.fastest)
        braking = rng.uniform(*driver.braking)
        span = end - begin
        change = float(np.clip(goal - v, -0.35 * braking * span, 0.55 * driver.speeding_up * span))
        change = float(np.clip(v + change, driver.slowest + 1.0, driver.fastest)) - v
        duration = abs(change) / (0.6 * (braking if change < 0.0 else driver.speeding_up)) + 0.8
        duration = min(duration, span - 0.5)
        rate += change / duration * _hump((t - begin) / duration)
        # A driver brakes first and then turns, or brakes a little longer in the bend; he accelerates in it.
        wait = rng.uniform(0.6, 1.0) * duration if change < 0.0 else 0.2
        there = slice(*np.searchsorted(t, [begin + wait, end]))
        slow = min(v, v + change)
        size = min(rng.uniform(0.5, 1.0) * driver.hardest, slow**2 / driver.tightest)
        asked[there] = size * _asked(name, t[there] - begin - wait, span - wait, driver.tempo, rng)
        v, begin = v + change, end
        plan.append((str(name), float(begin), float(size), float(v)))
    speed = v - _accumulated(rate)[-1] + _accumulated(rate)
    wheel = driver.ratio * (driver.wheelbase / np.maximum(speed, 6.0) ** 2 + driver.understeer) * asked
    wheel += math.radians(0.35) * coloured(rng, t.size, HALF_STEP, 0.35, 0.8) * driver.tempo
    bank = rng.uniform(0.003, 0.02) + 0.006 * coloured(rng, t.size, HALF_STEP, 0.07, 0.7)
    loads = np.stack([_uneven(rng, t.size) for _ in range(wheels)], axis=1)
    rough = 0.05 * np.sqrt(np.maximum(speed, 1.0) / 20.0)[:, None] * loads
    calm = smooth_step((t + RUN_IN) / 2.0)
    return Drive(t, wheel * calm, speed, rate, bank * calm, rough * calm[:, None], tuple(plan))


def _hump(x: Floats) -> Floats:
    """Return what has the area 1 between 0 and 1, with smooth edges: pedals take a third of the time."""
    edge = 0.3
    return (smooth_step(x / edge) - smooth_step((x - 1.0 + edge) / edge)) / (1.0 - edge)


def _accumulated(rate: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum(0.5 * (rate[1:] + rate[:-1])) * HALF_STEP])


def coloured(rng: np.random.Generator, count: int, step: float, frequency: float, damping: float) -> Floats:
    """Return noise of unit deviation behind a second-order filter of a natural frequency (Hz), ``(count,)``."""
    every = max(1, int(1.0 / (40.0 * frequency * step)))
    few = count // every + 2
    w = np.fft.rfftfreq(few, step * every) / frequency
    shaped = np.fft.rfft(rng.standard_normal(few)) / (1.0 - w**2 + 2j * damping * w)
    shaped[0] = 0.0
    noise = np.fft.irfft(shaped, few)
    at = np.arange(count) / every
    return np.asarray(np.interp(at, np.arange(few), noise / noise.std()))


def _uneven(rng: np.random.Generator, count: int) -> Floats:
    """Return the load of a wheel on a rough road: the body bounces, the wheel hops."""
    body, hop = coloured(rng, count, HALF_STEP, 1.3, 0.3), coloured(rng, count, HALF_STEP, 11.0, 0.2)
    return 0.6 * body + 0.8 * hop


@njit(cache=True)
def _play(angle, half):
    """Return an angle behind a play of ``half`` to either side: it waits at every reversal."""
    out = np.empty_like(angle)
    y = angle[0]
    for k in range(angle.size):
        y = min(max(y, angle[k] - half), angle[k] + half)
        out[k] = y
    return out


@njit(cache=True)
def _lag(angle, share):
    out = np.empty_like(angle)
    y = angle[0]
    for k in range(angle.size):
        y += share * (angle[k] - y)
        out[k] = y
    return out


def column(wheel: Floats, ratio: float, lag: float, delay: float, play: float) -> Floats:
    """Return the road-wheel angle behind the column (rad), at half steps.

    Args:
        wheel: Steering-wheel angle.
        ratio: Of the steering.
        lag: Time constant in s.
        delay: In s.
        play: Half of it, at the road wheels, rad.
    """
    angle = wheel / ratio
    late = round(delay / HALF_STEP)
    angle = np.concatenate([np.full(late, angle[0]), angle[: angle.size - late]])
    angle = _lag(angle, 1.0 - math.exp(-HALF_STEP / lag)) if lag > 0.0 else angle
    return np.asarray(_play(angle, play) if play > 0.0 else angle)


def steady_wheel(vehicle: str, acceleration: float, speed: float) -> float:
    """Return the steering-wheel angle of a bend (rad) as the driver knows the vehicle."""
    d = DRIVERS[vehicle]
    return d.ratio * (d.wheelbase / speed**2 + d.understeer) * acceleration
