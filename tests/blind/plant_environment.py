"""Between driver and equations: the steering column, and what road, wind, load and drivetrain do over time."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from plant_drives import DURATION, RUN_IN, STEP, Drive, rise
from plant_equations import INPUTS

Array = NDArray[np.float64]


class Column(NamedTuple):
    """Steering column; angles are those of the steering wheel."""

    offset: float = 0.0  # rad
    progression: float = 0.0  # 1/rad^2, the ratio shortens by this share per angle squared
    lag: float = 0.0  # s, time constant of first order
    delay: float = 0.0  # s, pure
    play: float = 0.0  # rad, half of the backlash


class Surroundings(NamedTuple):
    """What changes along a drive."""

    bank: float = 0.0  # rad, right side lower
    bank_deviation: float = 0.0  # rad, standard deviation of a bank that varies along the road
    friction_drop: float = 0.0  # share of the friction lost at a time of the drive
    payload_shift: float = 0.0  # m, CoG of the trailer to the front at a time of the drive
    stiffness_drift: float = 0.0  # 1/s, relative rate of all cornering stiffness
    torque_pulse: float = 0.0  # N m, yaw moment of a jerk of the drivetrain


class Changes(NamedTuple):
    """Times of a drive in s at which things happen, if they happen at all."""

    gust_begin: float
    gust_end: float
    friction: float
    payload: float


def draw_changes(rng: np.random.Generator, duration: float = DURATION) -> Changes:
    """Return change times that leave at least a quarter of the drive on either side."""
    begin = rng.uniform(0.25, 0.45) * duration
    length = rng.uniform(0.15, 0.3) * duration
    return Changes(begin, begin + length, *(rng.uniform(0.3, 0.7, 2) * duration))


def steered(angle: Array, column: Column) -> Array:
    """Return the angle behind the column, expressed at the steering wheel, shape as ``angle`` (half steps)."""
    half = STEP / 2
    angle = (angle + column.offset) * (1.0 + column.progression * angle**2)
    if column.delay > 0.0:
        shift = round(column.delay / half)
        angle = np.concatenate([np.full(shift, angle[0]), angle[:-shift]])
    if column.lag > 0.0:
        angle = _first_order(angle, half / column.lag)
    if column.play > 0.0:
        angle = _play(angle, column.play)
    return angle


def _first_order(angle: Array, ratio: float) -> Array:
    """Return the exact response to straight lines between the samples; ``ratio`` is their distance over the lag."""
    keep = np.exp(-ratio)
    new, old = 1.0 - (1.0 - keep) / ratio, (1.0 - keep) / ratio - keep
    y, previous, values = angle[0], angle[0], []
    for u in angle.tolist():
        y = keep * y + old * previous + new * u
        previous = u
        values.append(y)
    return np.array(values)


def _play(angle: Array, half_width: float) -> Array:
    """Return the hysteresis of a joint with play: it follows only where the gap is closed."""
    y, values = angle[0], []
    for u in angle.tolist():
        y = min(max(y, u - half_width), u + half_width)
        values.append(y)
    return np.array(values)


def _winding_bank(distance: Array, deviation: float, rng: np.random.Generator) -> Array | float:
    """Return a random bank in rad of a standard deviation, with wavelengths of 80 to 600 m."""
    waves, phases = 2.0 * np.pi / np.geomspace(80.0, 600.0, 12), rng.uniform(0.0, 2.0 * np.pi, 12)
    if deviation == 0.0:
        return 0.0
    return deviation * np.sqrt(2.0 / 12) * sum(np.sin(k * distance + p) for k, p in zip(waves, phases, strict=True))


def _pulses(t: Array, rng: np.random.Generator) -> Array:
    """Return half-sine jerks of 0.3 s to either side, about one in three seconds."""
    y, begin = np.zeros_like(t), 0.0
    while (begin := begin + rng.uniform(1.5, 4.5)) < t[-1]:
        there = slice(*np.searchsorted(t, [begin, begin + 0.3]))
        y[there] = rng.choice([-1.0, 1.0]) * np.sin(np.pi * (t[there] - begin) / 0.3)
    return y


def inputs(drive: Drive, column: Column, around: Surroundings, changes: Changes, rng: np.random.Generator) -> Array:
    """Return the inputs of the equations at half steps, ``(half steps, len(INPUTS))``."""
    t = drive.time
    begin = round(2 * RUN_IN / STEP)
    distance = np.concatenate([[0.0], np.cumsum((drive.speed[1:] + drive.speed[:-1]) * STEP / 4)])
    # Both draws happen in every case: the same drive then has the same road, whatever is wrong with the vehicle.
    bank, pulses = _winding_bank(distance, around.bank_deviation, rng), _pulses(t, rng)
    after = np.clip(t, 0.0, None)
    columns = {
        "steering_wheel_angle": steered(drive.steering_wheel_angle, column),
        "speed": drive.speed,
        "speed_rate": drive.speed_rate,
        "gust": rise(t, changes.gust_begin, 0.5) - rise(t, changes.gust_end, 0.5),
        "bank": around.bank + bank,
        "grip": 1.0 - around.friction_drop * rise(t, changes.friction, 1.0),
        "shift": around.payload_shift * rise(t, changes.payload, 1.0),
        "stiffness": np.exp(around.stiffness_drift * after),
        "moment": around.torque_pulse * pulses,
        "distance": distance - distance[begin],
    }
    table = np.empty((len(t), len(INPUTS)))
    for i, name in enumerate(INPUTS):
        table[:, i] = columns[name]
    return table
