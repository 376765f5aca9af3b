"""Turns by 90 degrees, as many as time allows, to alternating sides: slow down, turn, accelerate."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=80.0, speed=10.0),
    Option("radius", "m", 12.0, 5.0, 200.0, "radius of the turn (tractor's rear axle)"),
    Option("angle", "rad", np.radians(90.0), np.radians(10.0), np.pi, "heading gained in each turn"),
    Option("transition", "m", 9.0, 0.5, 50.0, "distance over which the curvature rises and falls"),
    Option("turn_speed", "m/s", 4.0, 0.3, 40.0, "speed in the turn"),
    Option("straight", "m", 50.0, 0.0, 2e3, "straight distance before each turn"),
    shapes.DIRECTION,
    Option("acceleration", "m/s^2", 0.8, 0.05, 5.0, "largest longitudinal acceleration and deceleration"),
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return turns to alternating sides, beginning with ``direction``."""
    return shapes.alternating_turns(options, context)
