"""Steering-wheel angle that grows at a constant rate to an amplitude and is held there."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=60.0, speed=8.0),
    shapes.amplitude(np.radians(120.0)),
    Option("rate", "rad/s", np.radians(10.0), 1e-3, 20.0, "rate of the steering-wheel angle"),
    Option("rounding", "s", 1.0, 0.01, 30.0, "time in which the corners of the ramp are rounded"),
    shapes.SPEED_CHANGE,
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return a ramp of ``rate`` to ``amplitude`` with rounded corners after the lead-in."""
    time = shapes.time_of(options, context)
    top = abs(options["amplitude"]) / options["rate"]
    shape = shapes.limited(time - options["lead_in"], top, options["rounding"])
    steering = np.sign(options["amplitude"]) * options["rate"] * shape
    return Profile(time, steering, shapes.changing_speed(options, time))
