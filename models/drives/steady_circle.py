"""Drive onto a circle along a smooth transition and stay on it; it may tighten, and the speed may change."""

from __future__ import annotations

from typing import Any

from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=80.0, speed=8.0),
    Option("radius", "m", 40.0, 4.0, 1e4, "radius of the circle (tractor's rear axle)"),
    shapes.DIRECTION,
    Option("transition", "s", 5.0, 0.2, 120.0, "time from the straight onto the circle"),
    Option(
        "tightening",
        "",
        0.0,
        -0.95,
        5.0,
        "share by which the curvature has grown at the end; 0.5 ends on two thirds of the radius",
    ),
    shapes.SPEED_CHANGE,
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return the steering that follows the circle's curvature by the kinematics of the steered body."""
    time = shapes.time_of(options, context)
    t = time - options["lead_in"]
    on_circle = t - options["transition"]
    growth = options["tightening"] * shapes.smooth_step(on_circle / max(on_circle[-1], 1e-9))
    curvature = (
        shapes.sign(options) / options["radius"] * shapes.smooth_step(t / options["transition"]) * (1.0 + growth)
    )
    return Profile(time, shapes.steering_of_curvature(curvature, context), shapes.changing_speed(options, time))
