"""Steering that grows so slowly that the vehicle stays in steady state, to a wanted lateral acceleration.

As the constant-speed test of steady-state cornering (ISO 4138, SAE J266), with the lateral acceleration of
the kinematics in place of the measured one.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=90.0, speed=15.0),
    Option("rate", "rad/s", np.radians(2.0), 1e-4, 1.0, "rate of the steering-wheel angle"),
    Option("lateral_acceleration", "m/s^2", 2.0, 0.05, 20.0, "kinematic lateral acceleration at which it is held"),
    shapes.DIRECTION,
    Option("rounding", "s", 2.0, 0.01, 30.0, "time in which the corners of the ramp are rounded"),
    shapes.SPEED_CHANGE,
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return a ramp of ``rate`` up to the angle that gives ``lateral_acceleration`` at the highest speed."""
    time = shapes.time_of(options, context)
    speed = shapes.changing_speed(options, time)
    wanted = shapes.steering_of_curvature(options["lateral_acceleration"] / speed.max() ** 2, context)
    shape = shapes.limited(time - options["lead_in"], float(wanted) / options["rate"], options["rounding"])
    return Profile(time, shapes.sign(options) * options["rate"] * shape, speed)
