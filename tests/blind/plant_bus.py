"""Bus quality: the sensors of field quality, each in a message of its own, as a logger of a bus leaves them.

A message has a rate and a phase of its own, which hold for the three drives of a case, and stamps that jitter; some of
its samples are lost. The file has a row per message, blank where the channels of others stand.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from plant_drives import RUN_IN, STEP
from plant_field import LOST, Logger, draw_logger, measured, stamps
from plant_sensors import Channel, sensed

Array = NDArray[np.float64]

INTERVALS = (5, 10, 20)
"""ms between the samples of a message: 200, 100 or 50 Hz."""

ON_TIME = 0.0002
"""s; standard deviation of a stamp: a message waits for others on the bus."""

RESOLUTION = 1e-5
"""s; of the stamps."""


@dataclass(frozen=True)
class BusLogger(Logger):
    """A measuring system whose channels are messages of a bus.

    Attributes:
        intervals: ms between samples by channel.
        phases: ms from the start of a recording to the first sample by channel.
    """

    intervals: dict[str, int]
    phases: dict[str, int]


def draw_bus(vehicle: str, rng: np.random.Generator) -> BusLogger:
    """Return a measuring system; its sensors are those that field quality draws."""
    sensors = draw_logger(vehicle, rng)
    intervals = {name: int(rng.choice(INTERVALS)) for name in sensors.noise}
    phases = {name: int(rng.integers(interval)) for name, interval in intervals.items()}
    return BusLogger(sensors.delays, sensors.radius, sensors.noise, intervals, phases)


def record(
    vehicle: str,
    truth: Array,
    inputs: Mapping[str, Array],
    wrong: Mapping[str, Channel],
    logger: BusLogger,
    rng: np.random.Generator,
) -> dict[str, Array]:
    """Return the columns of a recording, ``time`` first, NaN where a row is that of another message.

    Args:
        vehicle: ``"semitrailer"`` or ``"car"``.
        truth: Outputs of the equations at every step since the run-in, ``(steps + 1, ny)``.
        inputs: The driver's ``steering_wheel_angle`` and ``speed`` at every step.
        wrong: Sensors with something wrong, by channel.
        logger: The measuring system.
        rng: Noise, jitter, losses and outliers.
    """
    times, values, of = [], [], []
    for number, (name, signal) in enumerate(sensed(vehicle, truth, inputs, wrong).items()):
        interval, phase = (round(ms * 1e-3 / STEP) for ms in (logger.intervals[name], logger.phases[name]))
        at = np.arange(round(RUN_IN / STEP) + phase, len(truth), interval)
        time = phase * STEP + stamps(len(at), interval * STEP, ON_TIME, rng)
        kept = rng.random(len(at)) >= LOST
        times.append(np.round(time[kept] / RESOLUTION) * RESOLUTION)
        values.append(measured(name, signal, at, logger, rng)[kept])
        of.append(np.full(int(kept.sum()), number))
    order = np.argsort(np.concatenate(times), kind="stable")
    column, value = np.concatenate(of)[order], np.concatenate(values)[order]
    rows = {name: np.where(column == number, value, np.nan) for number, name in enumerate(logger.noise)}
    return {"time": np.concatenate(times)[order], **rows}
