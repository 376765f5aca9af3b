"""Inputs of a drive: random manoeuvres one after another, a speed that changes meanwhile, wind, and the road.

A manoeuvre asks for a lateral acceleration; the steering-wheel angle is that of the published truck in a steady bend.
Everything is laid out at half steps, which Runge-Kutta reads.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from bench.foreign.vehicle import GRAVITY, STEP, Floats, truck

DURATION = 120.0
"""s; length of a drive."""

HALF_STEP = STEP / 2

_TRUCK = truck()
_WHEELBASE = _TRUCK.front_axle + _TRUCK.drive_axle
_UNDERSTEER = _TRUCK.load_11 / (_TRUCK.stiffness_11 * GRAVITY) - _TRUCK.load_12 / (_TRUCK.stiffness_12 * GRAVITY)
"""rad per m/s^2 at the front wheels."""

_LARGEST_ANGLE = 4.2
"""rad of the steering wheel in a bend, as far as a driver turns it without changing hands."""

_NODES = 200
"""Half steps between the nodes of what wanders slowly: 0.1 s."""


def half_steps(seconds: float) -> Floats:
    """Return the times of all half steps of a drive, ``(2 n + 1,)``, in s."""
    return np.arange(round(seconds / HALF_STEP) + 1, dtype=float) * HALF_STEP


def smooth_step(x: Floats) -> Floats:
    """Return a step from 0 at ``x = 0`` to 1 at ``x = 1`` whose first two derivatives are continuous."""
    x = np.clip(x, 0, 1)
    return x * x * x * (10 - 15 * x + 6 * x * x)


def draw_speed(rng: np.random.Generator, t: Floats, slow: float = 10.0, fast: float = 24.0) -> tuple[Floats, Floats]:
    """Return the speed that the driver wants (m/s) and its rate (m/s^2): levels between slow and fast, held a while."""
    levels = [rng.uniform(slow, slow + 2), rng.uniform(fast - 3, fast), *rng.uniform(slow, fast, 3)]
    rng.shuffle(levels)
    v = np.full(t.size, levels[0])
    now = rng.uniform(10, 16)
    for before, after in pairwise(levels):
        gentle = 0.25 if after > before else 0.45  # m/s^2 at most: a laden truck brakes harder than it pulls
        duration = max(6.0, 1.875 * abs(after - before) / gentle)  # 1.875: the steepest slope of the smooth step
        v += (after - before) * smooth_step((t - now) / duration)
        now += duration + rng.uniform(4, 8)
        if now > t[-1] - 12:
            break
    v = np.maximum(v, slow - 0.5)
    return v, np.gradient(v, HALF_STEP)


def wheel_angle(acceleration: float, speed: float | Floats) -> float | Floats:
    """Return the steering-wheel angle (rad) of a lateral acceleration (m/s^2) in a steady bend, to first order."""
    return _TRUCK.steering_ratio * acceleration * (_WHEELBASE / speed**2 + _UNDERSTEER)


@dataclass
class Driver:
    """Draws the manoeuvres of a drive.

    Attributes:
        rng: Draws them.
        time: s, at half steps.
        speed: m/s, wanted at these.
        sign: To which side the next one begins.
    """

    rng: np.random.Generator
    time: Floats
    speed: Floats
    sign: int = 1

    def steering(self, hardest: float) -> Floats:
        """Return the steering-wheel angle of a drive (rad), whose manoeuvres ask for so many m/s^2 at most."""
        lane, bend, sweep, slalom = self._lane, self._bend, self._sweep, self._slalom
        kinds = (bend, lane, sweep, slalom, bend, lane, self._steps, sweep, bend, slalom)
        hand = np.zeros(self.time.size)
        count = int(self.rng.integers(len(kinds)))
        self.sign = 1 if self.rng.random() < 0.5 else -1
        now = 2.0
        while now < self.time[-1] - 3:
            manoeuvre = kinds[count % len(kinds)]
            count += 1
            self.sign = -self.sign
            speed = float(np.interp(now + 1, self.time[::_NODES], self.speed[::_NODES]))
            asked = self.rng.uniform(0.6, 1.0) * hardest
            angle, now = manoeuvre(now, speed, asked)
            hand += angle
            now += self.rng.uniform(1.0, 2.5)
        return hand + self._unrest()

    def _unrest(self) -> Floats:
        """Return a wheel angle of a degree or so that hands on it never hold still."""
        nodes = self.rng.standard_normal(self.time.size // _NODES + 2)
        for _ in range(2):
            nodes = np.convolve(nodes, np.ones(5) / 5, "same")
        nodes *= np.radians(1.0) / nodes.std()
        return np.interp(self.time, np.arange(nodes.size) * 0.1, nodes)

    def _bend(self, begin: float, _: float, asked: float) -> tuple[Floats, float]:
        """Hold a lateral acceleration while the speed changes."""
        duration = self.rng.uniform(6, 12)
        rise = self.rng.uniform(1.0, 2.5)
        held = np.clip(wheel_angle(0.85 * asked, np.maximum(self.speed, 8)), -_LARGEST_ANGLE, _LARGEST_ANGLE)
        return self.sign * held * self._pulse(begin, duration, rise), begin + (duration + rise)

    def _lane(self, begin: float, speed: float, asked: float) -> tuple[Floats, float]:
        """Change the lane and come back."""
        period = self.rng.uniform(2.2, 3.8)
        gap = self.rng.uniform(1.5, 3.0)
        there, back = (_swing((self.time - b) / period) for b in (begin, begin + period + gap))
        return self.sign * wheel_angle(0.85 * asked, speed) * (there - back), begin + (2 * period + gap)

    def _sweep(self, begin: float, speed: float, asked: float) -> tuple[Floats, float]:
        """Swing faster and faster."""
        duration = self.rng.uniform(9, 13)
        slow, fast = 0.15, self.rng.uniform(1.0, 1.8)  # Hz
        x = self.time - begin
        wave = np.sin(2 * np.pi * (slow * x + (fast - slow) * x**2 / (2 * duration)))
        within = np.where((x > 0) & (x < duration), wave, 0) * np.clip(np.minimum(x, duration - x), 0, 1)
        return self.sign * wheel_angle(0.45 * asked, speed) * within, begin + duration

    def _slalom(self, begin: float, speed: float, asked: float) -> tuple[Floats, float]:
        """Swing two or three times."""
        period = self.rng.uniform(2.8, 4.5)
        duration = self.rng.integers(2, 4) * period
        x = self.time - begin
        wave = np.where((x > 0) & (x < duration), np.sin(2 * np.pi * x / period), 0)
        wave *= np.clip(np.minimum(x, duration - x), 0, 0.6) / 0.6
        return self.sign * wheel_angle(0.65 * asked, speed) * wave, begin + duration

    def _steps(self, begin: float, speed: float, asked: float) -> tuple[Floats, float]:
        """Step to one side, to the other, and perhaps back."""
        angle = np.zeros(self.time.size)
        for _ in range(self.rng.integers(2, 4)):
            duration = self.rng.uniform(1.5, 3)
            rise = self.rng.uniform(0.35, 0.6)
            angle += self.sign * wheel_angle(0.5 * asked, speed) * self._pulse(begin, duration, rise)
            self.sign = -self.sign
            begin += duration
        return angle, begin

    def _pulse(self, begin: float, duration: float, rise: float) -> Floats:
        """Return 1 from ``begin + rise`` to ``begin + duration``, with smooth edges."""
        x = self.time - begin
        return smooth_step(x / rise) - smooth_step((x - duration) / rise)


def _swing(x: Floats) -> Floats:
    """Return a sine that begins and ends softly between 0 and 1."""
    soft = np.sin(np.pi * np.clip(x, 0, 1)) ** 0.5
    return np.where((x > 0) & (x < 1), np.sin(2 * np.pi * x) * soft, 0)


def draw_wind(rng: np.random.Generator, t: Floats) -> tuple[Floats, tuple[float, float]]:
    """Return the wind's force on the trailer (N, to the left), and when its gust begins and ends (s).

    1.5 kN all the time, 6 kN in one gust of 20 to 30 s, and on both a turbulence of 15 % with a time constant of 2 s.
    """
    force = np.full(t.size, 1500.0)
    begin, duration = rng.uniform(25, 65), rng.uniform(20, 30)
    force += 4500.0 * (smooth_step((t - begin) / 1.5) - smooth_step((t - begin - duration) / 1.5))
    shocks = rng.standard_normal(t.size // _NODES + 2)
    wanders = np.zeros(shocks.size)
    for k in range(1, shocks.size):
        wanders[k] = wanders[k - 1] * math.exp(-0.1 / 2.0) + shocks[k] * math.sqrt(1 - math.exp(-0.2 / 2.0))
    turbulent = 1 + 0.15 * np.interp(t, np.arange(wanders.size) * 0.1, wanders)
    return force * turbulent, (round(begin, 1), round(begin + duration, 1))


def draw_bank(rng: np.random.Generator, t: Floats) -> Floats:
    """Return the bank of a road (rad, left side higher): levels up to 0.03 held for 3 to 10 s, and ramps between."""
    bank, now, level = np.zeros(t.size), 0.0, rng.uniform(-0.03, 0.03)
    bank += level
    while now < t[-1]:
        now += rng.uniform(3, 10)
        following, ramp = rng.uniform(-0.03, 0.03), rng.uniform(1.5, 4)
        bank += (following - level) * smooth_step((t - now) / ramp)
        now, level = now + ramp, following
    return bank
