"""Steering that jumps smoothly between random angles at random times; the speed may vary likewise."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import ModelError
from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=90.0, speed=15.0),
    shapes.amplitude(np.radians(40.0)),
    Option("rise_time", "s", 1.0, 0.1, 60.0, "time of each change of angle"),
    Option("longest_hold", "s", 2.0, 0.0, 600.0, "longest time an angle is held"),
    Option("speed_variation", "m/s", 0.0, 0.0, 40.0, "largest deviation from the speed, to both sides"),
    Option("speed_rise_time", "s", 10.0, 0.5, 600.0, "time of each change of speed"),
    shapes.seed(1),
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return random angles in ``[-amplitude, amplitude]`` and speeds in ``speed -+ speed_variation``.

    Raises:
        ModelError: If the variation would bring the vehicle to a standstill.
    """
    time = shapes.time_of(options, context)
    if options["speed"] - options["speed_variation"] < 0.3:
        raise ModelError(
            f"speed_variation: {options['speed_variation']:g} m/s would stop a vehicle at "
            f"{options['speed']:g} m/s; leave at least 0.3 m/s"
        )
    random = shapes.generator(options)
    # Two streams, so that the steering stays the same whatever the speed does.
    for_steering, for_speed = random.spawn(2)
    t = time - options["lead_in"]
    steering = options["amplitude"] * _levels(t, options["rise_time"], options["longest_hold"], for_steering)
    wander = _levels(t, options["speed_rise_time"], options["speed_rise_time"], for_speed)
    return Profile(time, steering, options["speed"] + options["speed_variation"] * wander)


def _levels(t: Floats, rise_time: float, longest_hold: float, random: np.random.Generator) -> Floats:
    """Return levels in [-1, 1] joined by S-shaped steps, 0 before t = 0, shape as ``t``."""
    signal, level, begin = np.zeros_like(t), 0.0, 0.0
    while begin < t[-1]:
        goal, hold = random.uniform(-1.0, 1.0), random.uniform(0.0, longest_hold)
        signal += (goal - level) * shapes.smooth_step((t - begin) / rise_time)
        level, begin = goal, begin + rise_time + hold
    return signal
