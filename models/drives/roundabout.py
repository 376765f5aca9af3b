"""Roundabouts, as many as time allows: slow down, bend to the right, go round to the left, bend to the right.

For left-hand traffic set ``direction = "right"``, which mirrors the path.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=90.0, speed=12.0),
    Option("radius", "m", 16.0, 5.0, 200.0, "radius driven in the roundabout (tractor's rear axle)"),
    Option("angle", "rad", np.pi, np.radians(20.0), 3 * np.pi, "heading gained in the roundabout"),
    Option("entry_angle", "rad", np.radians(35.0), 0.0, np.radians(80.0), "heading of each outward bend"),
    Option("transition", "m", 12.0, 0.5, 50.0, "distance over which the curvature of each bend rises and falls"),
    Option("turn_speed", "m/s", 6.0, 0.3, 40.0, "speed in the roundabout"),
    Option("straight", "m", 60.0, 0.0, 2e3, "straight distance before each roundabout"),
    shapes.DIRECTION,
    Option("acceleration", "m/s^2", 0.8, 0.05, 5.0, "largest longitudinal acceleration and deceleration"),
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return as many roundabouts as fit into the duration, each followed by a straight."""
    side = shapes.sign(options)
    speed = min(options["turn_speed"], options["speed"])

    def turn(angle: float) -> shapes.Arc:
        return shapes.Arc.turning(side * angle, options["radius"], options["transition"], speed)

    outward = [turn(-options["entry_angle"])] if options["entry_angle"] > 0 else []
    straight = shapes.Arc(options["straight"], 0.0, 0.0, options["speed"])
    lap = [straight, *outward, turn(options["angle"]), *outward]
    arcs = shapes.fill(lambda _: lap, options, options["acceleration"])
    return shapes.follow(arcs, options, context, options["acceleration"])
