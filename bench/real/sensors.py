"""Ordinary sensors and their logger: where they sit, how late and noisy they are, and what stands in a file.

What belongs to the vehicle (places, delays, noise, small errors of gain, wheel radius) is drawn once for a case; bias,
its wandering, jitter and lost samples belong to a drive.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from bench.real.driver import RUN_IN, Drive
from bench.real.vehicle import GRAVITY, PHI, PHI_REAR, PITCH, STEP, UNIT, Floats, R, U

SAMPLE = 0.01
"""s between two samples."""

SPEED_STEP = 1.0 / 256.0 / 3.6
"""m/s; 1/256 km/h, as SAE J1939 counts wheel speeds."""

DELAY = (0.010, 0.020)
"""s; least and largest delay of a channel."""

JITTER = 0.0005
"""s; standard deviation of a time stamp, where the logger has a clock of its own."""

LOST = 0.0005
"""Share of the samples that are missing."""

CAR = ("steering_wheel_angle", "speed", "yaw_rate", "lateral_acceleration")
CHANNELS = {
    "car": CAR,
    "multi_body": CAR,
    "semitrailer": (
        "steering_wheel_angle",
        "speed",
        "yaw_rate_tractor",
        "yaw_rate_trailer",
        "articulation_angle",
        "lateral_force_axle_21",
        "lateral_acceleration_tractor",
    ),
}
UNITS = {"steering_wheel_angle": "rad", "speed": "m/s", "articulation_angle": "rad", "lateral_force_axle_21": "N"}
UNITS |= dict.fromkeys(("yaw_rate", "yaw_rate_tractor", "yaw_rate_trailer"), "rad/s")
UNITS |= dict.fromkeys(("lateral_acceleration", "lateral_acceleration_tractor"), "m/s^2")


def quantity(channel: str) -> str:
    """Return what a channel measures, without the body."""
    return next(q for q in _LARGEST if channel.startswith(q))


_LARGEST = {
    "steering_wheel_angle": (0.0, 0.0, math.radians(0.1)),
    "speed": (0.01, 0.02, SPEED_STEP),
    "yaw_rate": (math.radians(0.1), math.radians(0.3), math.radians(0.01)),
    "articulation_angle": (math.radians(0.06), math.radians(0.12), math.radians(0.02)),
    "lateral_force_axle": (250.0, 400.0, 20.0),
    "lateral_acceleration": (0.04, 0.08, 0.005),
}
"""Least and largest standard deviation of the noise, and the step of a channel, by what it measures."""

_WANDER = {"yaw_rate": math.radians(0.08), "lateral_acceleration": 0.02, "lateral_force_axle": 150.0}
_GAIN = {"yaw_rate": 0.005, "lateral_acceleration": 0.01, "articulation_angle": 0.005, "lateral_force_axle": 0.02}


@dataclass(frozen=True)
class Logger:
    """A measuring system.

    Attributes:
        delays: s by channel.
        noise: Standard deviation by channel.
        gains: Reading over true value by channel, 1 where it is right.
        places: Of the accelerometer: ahead of the CoG, and above the roll axis (m).
        tilt: rad; by which the gyroscopes see the roll rate.
        radius: Share by which the speed reads too much.
        own_clock: Whether stamps jitter and the clock runs by a share of 20 ppm off.
    """

    delays: Mapping[str, float]
    noise: Mapping[str, float]
    gains: Mapping[str, float]
    places: tuple[float, float]
    tilt: float
    radius: float
    own_clock: bool


@dataclass(frozen=True)
class Fault:
    """What has changed of the sensors.

    Attributes:
        gains: Further share by channel.
        biases: By channel, SI.
        delays: Further s by channel.
        radius: Further share by which the speed reads too much.
    """

    gains: Mapping[str, float] = field(default_factory=dict)
    biases: Mapping[str, float] = field(default_factory=dict)
    delays: Mapping[str, float] = field(default_factory=dict)
    radius: float = 0.0


def draw_logger(vehicle: str, rng: np.random.Generator) -> Logger:
    """Return a measuring system."""
    channels = CHANNELS[vehicle]
    return Logger(
        {c: float(rng.uniform(*DELAY)) for c in channels},
        {c: float(rng.uniform(*_LARGEST[quantity(c)][:2])) for c in channels},
        {c: 1.0 + _GAIN.get(quantity(c), 0.0) * float(rng.uniform(-1.0, 1.0)) for c in channels},
        (float(rng.uniform(-0.15, 0.15)), float(rng.uniform(0.1, 0.35))),
        float(rng.uniform(-0.01, 0.01)),
        float(rng.uniform(-0.003, 0.003)),
        bool(rng.random() < 0.5),
    )


def signals(
    vehicle: str, drive: Drive, states: Floats, axles: Floats, felt: Floats, logger: Logger
) -> dict[str, Floats]:
    """Return what each channel has to measure at every step, the run-in among it; arrays as ``integrate`` has them."""
    wheel = drive.wheel[::2]
    ahead, above = logger.places
    roll = 0.5 * (states[:, PHI] + states[:, PHI_REAR])
    rolling = 0.5 * (states[:, PHI + 1] + states[:, PHI_REAR + 1])
    acceleration = felt[:, 0, 0] + ahead * felt[:, 0, 1] - above * felt[:, 0, 3]
    acceleration = acceleration * np.cos(roll) + GRAVITY * np.sin(roll)
    gyroscope = states[:, R] + logger.tilt * rolling
    if vehicle == "car":
        speed = states[:, U] * (1.0 + axles[:, 1, 3])  # the wheels that are not driven
        return dict(zip(CAR, (wheel, speed, gyroscope, acceleration), strict=True))
    trailer = states[:, UNIT + R] + logger.tilt * 0.5 * (states[:, UNIT + PHI + 1] + states[:, UNIT + PHI_REAR + 1])
    speed = states[:, UNIT + U] * (1.0 + axles[:, 3, 3])
    angle = states[:, 2 * UNIT + 2]
    values = (wheel, speed, gyroscope, trailer, angle, axles[:, 2, 0], acceleration)
    return dict(zip(CHANNELS[vehicle], values, strict=True))


def record(truth: Mapping[str, Floats], logger: Logger, fault: Fault, rng: np.random.Generator) -> dict[str, Floats]:
    """Return the columns of a recording, ``time`` first, each ``(samples,)``; what is missing is NaN.

    Args:
        truth: Of every channel at every step, the run-in among it.
        logger: The measuring system.
        fault: What has changed of it.
        rng: Noise, wandering bias, jitter and losses.
    """
    steps = next(iter(truth.values())).size
    fine = np.arange(steps) * STEP - RUN_IN
    t = np.arange(round(fine[-1] / SAMPLE) + 1) * SAMPLE
    stamps = t
    if logger.own_clock:
        stamps = t * (1.0 + 2e-5 * rng.uniform(-1.0, 1.0)) + np.clip(JITTER * rng.standard_normal(t.size), -4e-3, 4e-3)
    columns = {"time": stamps}
    for name, signal in truth.items():
        late = logger.delays[name] + fault.delays.get(name, 0.0)
        values = np.interp(t - late, fine, signal) * logger.gains[name] * (1.0 + fault.gains.get(name, 0.0))
        if name == "speed":
            values = values * (1.0 + logger.radius) * (1.0 + fault.radius)
        values = values + fault.biases.get(name, 0.0) + logger.noise[name] * rng.standard_normal(t.size)
        values = values + _wander(t, _WANDER.get(quantity(name), 0.0), rng)
        step = _LARGEST[quantity(name)][2]
        values = np.round(values / step) * step
        values[rng.random(t.size) < LOST] = np.nan
        columns[name] = values
    return columns


def _wander(t: Floats, size: float, rng: np.random.Generator) -> Floats:
    """Return a bias that changes over minutes: a constant and two slow waves."""
    y = np.full(t.size, size * rng.uniform(-0.6, 0.6))
    for period, share in ((rng.uniform(120.0, 300.0), 0.4), (rng.uniform(40.0, 100.0), 0.2)):
        y += size * share * np.sin(2 * np.pi * t / period + rng.uniform(0.0, 6.28))
    return y


def extent(states: Floats, felt: Floats) -> dict[str, float]:
    """Return least and largest speed (m/s), largest lateral and longitudinal acceleration (m/s^2) and roll (rad)."""
    begin = round(RUN_IN / STEP)
    return {
        "slowest": round(float(states[begin:, U].min()), 2),
        "fastest": round(float(states[begin:, U].max()), 2),
        "lateral_acceleration": round(float(np.abs(felt[begin:, :, 0]).max()), 2),
        "longitudinal_acceleration": round(float(np.abs(states[begin:, PITCH]).max()), 2),
        "roll": round(float(np.abs(states[begin:, PHI]).max()), 4),
    }
