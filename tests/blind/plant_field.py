"""Field quality: a recording as a truck's own sensors and an ordinary logger leave it.

What is wrong with the recording belongs to the measuring system, so it is drawn once for the three drives of a case:
how late each channel is, how far the wheel radius is off, how noisy each gyroscope is. Drift, jitter, lost samples and
outliers belong to a drive. None of this is an effect of the vehicle.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray
from plant_cases import Drawn, Truth
from plant_drives import RUN_IN, STEP
from plant_sensors import NOISE, SAMPLE, Channel, sensed

Array = NDArray[np.float64]

SPEED_NOISE = 0.02
"""m/s; white, of an ordinary wheel-speed signal."""

SPEED_STEP = 1.0 / 256.0 / 3.6
"""m/s; 1/256 km/h, as SAE J1939 counts wheel speeds."""

SPEED_HELD = 2
"""Samples for which a speed is held: it comes at 50 Hz."""

WHEEL_RADIUS = 0.003
"""Largest share by which the wheel radius is off."""

STEERING_STEP = float(np.radians(0.1))
"""rad of the steering wheel."""

GYROSCOPE = tuple(np.radians([0.1, 0.3]))
"""rad/s; least and largest standard deviation of a gyroscope's noise."""

DRIFT = float(np.radians(0.1))
"""rad/s; largest bias of a gyroscope, which wanders over the minutes of a drive."""

DELAY = 0.040
"""s; largest delay of a channel."""

INPUT_DELAYS = {"steering_wheel_angle": "steering_delay", "speed": "speed_delay"}
"""What the library calls the delay of a recorded input."""

JITTER = 0.001
"""s; standard deviation of a time stamp."""

LOST = 0.001
"""Share of the samples that are missing."""

OUTLIERS = 1.0
"""Expected number of single outliers of a channel in a drive."""


@dataclass(frozen=True)
class Logger:
    """A measuring system.

    Attributes:
        delays: s by channel.
        radius: Share by which the speed reads too much.
        noise: Standard deviation of the white noise by channel.
    """

    delays: dict[str, float]
    radius: float
    noise: dict[str, float]

    def faults(self) -> list[dict[str, object]]:
        """Return what a trace may truly say of the recording, in the library's words."""
        late = [
            {"name": INPUT_DELAYS[c], "place": c, "delay": -d}  # the vehicle turns before the wheel is recorded
            if c in INPUT_DELAYS
            else {"name": "sensor_delay", "place": c, "delay": d}
            for c, d in self.delays.items()
        ]
        drift = [
            {"name": name, "place": c, "largest": DRIFT}
            for c in self.delays
            if c.startswith("yaw_rate")
            for name in ("sensor_bias", "sensor_drift")
        ]
        return [*late, *drift, {"name": "wheel_radius_error", "place": "", "share": self.radius}]


def draw_logger(vehicle: str, rng: np.random.Generator) -> Logger:
    """Return a measuring system."""
    noise = {**NOISE[vehicle], "speed": SPEED_NOISE}
    for name in noise:
        if name.startswith("yaw_rate"):
            noise[name] = float(rng.uniform(*GYROSCOPE))
    delays = {name: float(rng.uniform(0.0, DELAY)) for name in noise}
    return Logger(delays, float(rng.uniform(-WHEEL_RADIUS, WHEEL_RADIUS)), noise)


def beyond(truth: Truth) -> Truth:
    """Return a truth whose planted faults of sensors exceed what a recording of this quality has anyway."""

    def larger(key: str, value: float) -> float:
        if key == "delay" or key.startswith("sensor_delay@"):
            return value + DELAY
        return value + float(np.copysign(DRIFT, value)) if key.startswith("bias@yaw_rate") else value

    effects = [
        Drawn(e.name, e.magnitude, e.place, {k: larger(k, v) for k, v in e.values.items()}) for e in truth.effects
    ]
    return replace(truth, effects=effects)


def record(
    vehicle: str,
    truth: Array,
    inputs: Mapping[str, Array],
    wrong: Mapping[str, Channel],
    logger: Logger,
    rng: np.random.Generator,
) -> dict[str, Array]:
    """Return the columns of a recording, ``time`` first, each ``(samples,)``.

    Args:
        vehicle: ``"semitrailer"`` or ``"car"``.
        truth: Outputs of the equations at every step since the run-in, ``(steps + 1, ny)``.
        inputs: The driver's ``steering_wheel_angle`` and ``speed`` at every step.
        wrong: Sensors with something wrong, by channel.
        logger: The measuring system.
        rng: Noise, jitter, losses and outliers.
    """
    at = np.arange(round(RUN_IN / STEP), len(truth), round(SAMPLE / STEP))
    columns: dict[str, Array] = {}
    for name, signal in sensed(vehicle, truth, inputs, wrong).items():
        columns[name] = measured(name, signal, at, logger, rng, SPEED_HELD)
    time = stamps(len(at), SAMPLE, JITTER, rng)
    kept = rng.random(len(at)) >= LOST
    return {"time": time[kept], **{name: values[kept] for name, values in columns.items()}}


def measured(
    name: str, signal: Array, at: NDArray[np.intp], logger: Logger, rng: np.random.Generator, held: int = 1
) -> Array:
    """Return what a sensor makes of a signal at equidistant steps of it, the first of them in the run-in or behind it.

    Args:
        name: Of the channel.
        signal: At every step since the run-in.
        at: Steps at which samples are taken.
        logger: The measuring system.
        rng: Noise, drift and outliers.
        held: Samples for which a speed is held.
    """
    values = signal[at - round(logger.delays[name] / STEP)]
    values = values * (1.0 + logger.radius) if name == "speed" else values
    values = values + logger.noise[name] * rng.standard_normal(len(at))
    sample = float(at[1] - at[0]) * STEP
    values = values + (_drift(len(at), sample, rng) if name.startswith("yaw_rate") else 0.0)
    values = _resolved(name, values, held)
    spikes = rng.integers(1, len(at) - 1, rng.poisson(OUTLIERS))
    values[spikes] += rng.choice([-1.0, 1.0], len(spikes)) * rng.uniform(20.0, 50.0, len(spikes)) * logger.noise[name]
    return values


def stamps(samples: int, sample: float, jitter: float, rng: np.random.Generator) -> Array:
    """Return the stamps of equidistant samples, each off by some jitter."""
    off = np.clip(jitter * rng.standard_normal(samples), -0.4 * sample, 0.4 * sample)
    return np.asarray(np.arange(samples) * sample + off)


def _resolved(name: str, values: Array, held: int) -> Array:
    """Return a signal in the steps, and at the rate, in which its bus carries it."""
    if name == "speed":
        return np.asarray(np.round(values[np.arange(len(values)) // held * held] / SPEED_STEP) * SPEED_STEP)
    return np.asarray(np.round(values / STEERING_STEP) * STEERING_STEP) if name == "steering_wheel_angle" else values


def _drift(samples: int, sample: float, rng: np.random.Generator) -> Array:
    """Return a bias that wanders: a slow wave about a constant, of periods of minutes."""
    share, period, phase = rng.uniform(-1.0, 1.0), rng.uniform(100.0, 400.0), rng.uniform(0.0, 2.0 * np.pi)
    wave = np.sin(2.0 * np.pi * sample * np.arange(samples) / period + phase)
    return np.asarray(DRIFT * (0.5 * share + 0.5 * wave))
