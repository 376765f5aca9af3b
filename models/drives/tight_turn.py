"""Tight turns at walking pace, as in a yard, to alternating sides: the trailer folds to about 60 degrees.

How far it folds depends on the trailer: on the reference semitrailer the defaults reach about 60 degrees of
articulation. ``speed`` is that of the trailer, which at 60 degrees rolls half as fast as the tractor.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=100.0, speed=1.5),
    Option("radius", "m", 7.5, 4.0, 50.0, "radius of the turn (tractor's rear axle)"),
    Option("angle", "rad", np.radians(135.0), np.radians(20.0), 2 * np.pi, "heading laid out for each turn"),
    Option("transition", "m", 5.0, 0.5, 50.0, "distance over which the curvature rises and falls"),
    Option("straight", "m", 8.0, 0.0, 500.0, "straight distance before each turn"),
    shapes.DIRECTION,
    Option("acceleration", "m/s^2", 0.3, 0.05, 5.0, "largest longitudinal acceleration and deceleration"),
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return turns to alternating sides at constant speed, beginning with ``direction``."""
    return shapes.alternating_turns({**options, "turn_speed": options["speed"]}, context)
