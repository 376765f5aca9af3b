"""Sensors: what they do wrong, their noise, and sampling at 100 Hz."""

from __future__ import annotations

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from plant_drives import RUN_IN, STEP
from plant_equations import GRAVITY, OUTPUTS

Array = NDArray[np.float64]

SAMPLE = 0.01
"""s; sampling of a recording."""

NOISE: dict[str, dict[str, float]] = {
    "semitrailer": {
        "steering_wheel_angle": 1e-3,  # rad; a steering-angle sensor resolves 0.1 deg
        "speed": 2e-3,  # m/s; mean of the wheels over one sample
        "yaw_rate_tractor": 3e-3,  # rad/s; gyroscope of a stability control
        "yaw_rate_trailer": 3e-3,
        "articulation_angle": 1e-3,  # rad; kingpin angle sensor
        "lateral_force_axle_21": 300.0,  # N; measuring axle
        "lateral_acceleration_tractor": 0.05,  # m/s^2
    },
    "car": {
        "steering_wheel_angle": 1e-3,
        "speed": 2e-3,
        "yaw_rate": 3e-3,
        "lateral_acceleration": 0.05,
        "lateral_velocity": 0.02,  # m/s; optical sensor
    },
}
"""Standard deviation of the white noise of every recorded channel."""

UNITS = {
    "steering_wheel_angle": "rad",
    "speed": "m/s",
    "yaw_rate": "rad/s",
    "yaw_rate_tractor": "rad/s",
    "yaw_rate_trailer": "rad/s",
    "articulation_angle": "rad",
    "lateral_force_axle_21": "N",
    "lateral_acceleration": "m/s^2",
    "lateral_acceleration_tractor": "m/s^2",
    "lateral_velocity": "m/s",
}
"""Of every recorded channel."""

ACCELEROMETER = {"semitrailer": "lateral_acceleration_tractor", "car": "lateral_acceleration"}
_TURNING = {"semitrailer": "yaw_acceleration_tractor", "car": "yaw_acceleration"}


class Channel(NamedTuple):
    """What is wrong with one sensor."""

    bias: float = 0.0  # unit of the channel
    gain_error: float = 0.0  # share
    gain_loss_per_speed: float = 0.0  # s/m; the gain is 1 - this times the speed
    sensor_delay: float = 0.0  # s
    lever_arm: float = 0.0  # m that the accelerometer sits ahead of the CoG
    roll_per_acceleration: float = 0.0  # rad per m/s^2, lean of its body out of the turn
    misalignment: float = 0.0  # rad that it is turned to the left about the vertical axis


ROLL_FREQUENCY, ROLL_DAMPING = 8.0, 0.4
"""rad/s, and share of the critical damping, of the body that carries the accelerometer."""


def _swung(signal: Array) -> Array:
    """Return a signal at every step as a spring-borne body follows it (semi-implicit Euler, at rest first)."""
    position, rate, values = signal[0], 0.0, []
    for goal in signal.tolist():
        rate += STEP * (ROLL_FREQUENCY**2 * (goal - position) - 2.0 * ROLL_DAMPING * ROLL_FREQUENCY * rate)
        position += STEP * rate
        values.append(position)
    return np.array(values)


def outputs(vehicle: str) -> tuple[str, ...]:
    """Return the measured channels that are no inputs."""
    return tuple(name for name in NOISE[vehicle] if name not in ("steering_wheel_angle", "speed"))


def record(
    vehicle: str,
    truth: Array,
    inputs: Mapping[str, Array],
    wrong: Mapping[str, Channel],
    rng: np.random.Generator,
) -> dict[str, Array]:
    """Return the columns of a recording, ``time`` first, each ``(samples,)``, with noise.

    Args:
        vehicle: ``"semitrailer"`` or ``"car"``.
        truth: Outputs of the equations at every step since the run-in, ``(steps + 1, ny)``.
        inputs: The driver's ``steering_wheel_angle`` and ``speed`` at every step.
        wrong: Sensors with something wrong, by channel.
        rng: Noise.
    """
    at = np.arange(round(RUN_IN / STEP), len(truth), round(SAMPLE / STEP))
    columns = {"time": np.arange(len(at)) * SAMPLE}
    for name, signal in sensed(vehicle, truth, inputs, wrong).items():
        columns[name] = signal[at] + NOISE[vehicle][name] * rng.standard_normal(len(at))
    return columns


def sensed(vehicle: str, truth: Array, inputs: Mapping[str, Array], wrong: Mapping[str, Channel]) -> dict[str, Array]:
    """Return what each sensor senses at every step, with what is wrong with it, and without noise.

    Args:
        vehicle: ``"semitrailer"`` or ``"car"``.
        truth: Outputs of the equations at every step since the run-in, ``(steps + 1, ny)``.
        inputs: The driver's ``steering_wheel_angle`` and ``speed`` at every step.
        wrong: Sensors with something wrong, by channel.
    """
    named = dict(zip(OUTPUTS[vehicle], truth.T, strict=True))
    found = {}
    for name in NOISE[vehicle]:
        if name in inputs:
            found[name] = inputs[name]
            continue
        channel, signal = wrong.get(name, Channel()), named[name]
        signal = signal + channel.lever_arm * named[_TURNING[vehicle]]
        roll = channel.roll_per_acceleration * _swung(signal) if channel.roll_per_acceleration else 0.0
        signal = signal * np.cos(roll) + GRAVITY * np.sin(roll)
        along = inputs["speed"] if name == "lateral_velocity" else np.gradient(inputs["speed"], STEP)
        signal = signal * np.cos(channel.misalignment) - along * np.sin(channel.misalignment)
        late = round(channel.sensor_delay / STEP)
        signal = np.concatenate([np.full(late, signal[0]), signal[: len(signal) - late]])
        gain = 1.0 + channel.gain_error - channel.gain_loss_per_speed * inputs["speed"]
        found[name] = gain * signal + channel.bias
    return found
