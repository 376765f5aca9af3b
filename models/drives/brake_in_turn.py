"""Brake on a circle with the steering wheel held (ISO 7975, braking in a turn, open loop), down to a final speed."""

from __future__ import annotations

from typing import Any

from harness.common.errors import ModelError
from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=20.0, speed=15.0),
    Option("radius", "m", 100.0, 4.0, 1e4, "radius of the circle (rear axle of the steered body)"),
    shapes.DIRECTION,
    Option("transition", "s", 3.0, 0.2, 120.0, "time from the straight onto the circle"),
    Option("hold", "s", 3.0, 0.0, 600.0, "time on the circle at constant speed before braking"),
    Option("deceleration", "m/s^2", 1.4, 0.1, 12.0, "deceleration while the vehicle brakes"),
    Option("brake_rise_time", "s", 0.4, 0.05, 10.0, "time in which the deceleration rises, and falls again"),
    Option("final_speed", "m/s", 8.0, 0.3, 40.0, "speed at which braking ends"),
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return the steering of the circle, held while the speed falls.

    Raises:
        ModelError: If there is no speed to brake from.
    """
    lost = options["speed"] - options["final_speed"]
    if lost <= 0.0:
        raise ModelError(
            f"final_speed: {options['final_speed']:g} m/s is not below the speed of {options['speed']:g} m/s; lower it"
        )
    time = shapes.time_of(options, context)
    t = time - options["lead_in"]
    curvature = shapes.sign(options) / options["radius"] * shapes.smooth_step(t / options["transition"])
    braking = t - options["transition"] - options["hold"]
    fallen = shapes.limited(braking, lost / options["deceleration"], options["brake_rise_time"])
    speed = options["speed"] - options["deceleration"] * fallen
    return Profile(time, shapes.steering_of_curvature(curvature, context), speed)
