"""One drive of the blind plant from the driver's inputs to a recording."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import plant_bus
import plant_field
from numpy.typing import NDArray
from plant_bus import BusLogger
from plant_cases import Truth
from plant_drives import RUN_IN, STEP, Drive
from plant_drives import draw as draw_drive
from plant_environment import Changes, draw_changes, inputs
from plant_equations import OUTPUTS, STATES, integrate
from plant_field import Logger
from plant_sensors import Channel, record

Array = NDArray[np.float64]
_Seen = tuple[str, Array, dict[str, Array], dict[str, Channel]]
"""Vehicle, true outputs, the driver's inputs, and sensors with something wrong."""


@dataclass(frozen=True)
class Driven:
    """A drive, the times at which things change in it, the true outputs at every step, and the recording."""

    drive: Drive
    changes: Changes
    truth: Array
    recording: dict[str, Array]


def solve(truth: Truth, u: Array, step: float) -> Array:
    """Return the outputs ``(steps + 1, ny)`` for inputs at half steps ``(2 * steps + 1, nu)``, from a straight run."""
    out = np.zeros((len(u) // 2 + 1, len(OUTPUTS[truth.vehicle])))
    integrate(np.zeros(STATES[truth.vehicle]), np.ascontiguousarray(u), truth.equations(), step, out)
    return out


def drive(
    truth: Truth, seed: np.random.SeedSequence, logger: Logger | None = None, stated: Drive | None = None
) -> Driven:
    """Drive once.

    Args:
        truth: What is true of vehicle and surroundings.
        seed: Decides manoeuvres, change times, road and noise, each by a stream of its own.
        logger: The measuring system of a recording in field or bus quality; a clean one by default.
        stated: What is driven; drawn by default.

    Raises:
        FloatingPointError: If the vehicle left the range in which its equations hold.
    """
    streams = [np.random.default_rng(s) for s in seed.spawn(4)]
    plan = stated or draw_drive(truth.vehicle, streams[0])
    changes = draw_changes(streams[1], float(plan.time[-1]))
    u = inputs(plan, truth.column(), truth.surroundings(), changes, streams[2])
    out = solve(truth, u, STEP)
    if not np.isfinite(out).all() or np.abs(out[:, :3]).max() > 12.0:
        bad = int(np.argmax(~np.isfinite(out).all(axis=1) | (np.abs(out[:, :3]).max(axis=1) > 12.0)))
        raise FloatingPointError(f"the {truth.vehicle} spins {bad * STEP - RUN_IN:.2f} s after the start")
    known = {"steering_wheel_angle": plan.steering_wheel_angle[::2], "speed": plan.speed[::2]}
    seen = (truth.vehicle, out, known, truth.sensors())
    return Driven(plan, changes, out, _recorded(seen, logger, streams[3]))


def _recorded(seen: _Seen, logger: Logger | None, rng: np.random.Generator) -> dict[str, Array]:
    """Return what a measuring system makes of a drive."""
    if logger is None:
        return record(*seen, rng)
    if isinstance(logger, BusLogger):
        return plant_bus.record(*seen, logger, rng)
    return plant_field.record(*seen, logger, rng)
