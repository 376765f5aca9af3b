"""One smooth step of the steering-wheel angle, held to the end."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=30.0, speed=15.0),
    shapes.amplitude(np.radians(45.0)),
    Option("rise_time", "s", 0.5, 0.05, 60.0, "time the step takes"),
    shapes.SPEED_CHANGE,
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return an S-shaped step to ``amplitude`` within ``rise_time`` after the lead-in."""
    time = shapes.time_of(options, context)
    steering = options["amplitude"] * shapes.smooth_step((time - options["lead_in"]) / options["rise_time"])
    return Profile(time, steering, shapes.changing_speed(options, time))
