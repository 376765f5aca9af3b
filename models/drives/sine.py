"""Sinusoidal steering of fixed amplitude and frequency."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=80.0, speed=15.0),
    shapes.amplitude(np.radians(40.0)),
    Option("frequency", "Hz", 0.2, 0.005, 5.0, "frequency of the steering"),
    shapes.FADE,
    shapes.SPEED_CHANGE,
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return ``amplitude * sin(2 pi frequency t)``, its amplitude growing over ``fade`` after the lead-in."""
    time = shapes.time_of(options, context)
    t = np.maximum(time - options["lead_in"], 0.0)
    grown = shapes.smooth_step(t / options["fade"])
    steering = options["amplitude"] * grown * np.sin(2 * np.pi * options["frequency"] * t)
    return Profile(time, steering, shapes.changing_speed(options, time))
