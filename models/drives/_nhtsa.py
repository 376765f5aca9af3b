"""Options and steering ramps with rounded corners, shared by the three manoeuvres of the NHTSA.

The procedures prescribe a steering machine, so they are functions of time alone; the defaults ask for as little
lateral acceleration as any other drive. The amplitudes of the procedures go beyond what the tyres can do, and
beyond what ``lateral_acceleration_limit`` allows by default: a study that means them raises it.
"""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.models.contracts import DriveContext, Option
from harness.models.drives import _shapes as shapes

CALM = float(np.radians(20.0))
"""Default amplitude in rad; those of the procedures are up to ten times as large."""

LIMIT = replace(shapes.LIMIT, upper=200.0)
"""Kinematically these manoeuvres ask for several times what the road can give."""

ROUNDING = Option("rounding", "s", 0.2, 0.01, 2.0, "time in which the corners of the steering are rounded")


def options(speed: float) -> tuple[Option, ...]:
    """Return the options that all three have, with this default speed in m/s."""
    return (
        *(o for o in shapes.common(duration=15.0, speed=speed) if o.name != LIMIT.name),
        LIMIT,
        shapes.amplitude(CALM),
        ROUNDING,
    )


def time_and_speed(given: dict[str, Any], context: DriveContext) -> tuple[Floats, Floats]:
    """Return time in s and speed in m/s; the speed is that of the approach, to be kept or only to begin with."""
    time = shapes.time_of(given, context)
    return time, np.full_like(time, given["speed"])


def ramp(x: Floats, length: float, rounding: float) -> Floats:
    """Return a ramp from 0 (x <= 0) to 1 over ``length`` with rounded corners, any shape.

    It runs half the rounding late. Where the ramp is shorter than the rounding, it becomes an S as long as
    that, and slower.
    """
    length = max(length, 1e-6)  # an amplitude of zero
    risen: Floats = (shapes.smooth_ramp(x, rounding) - shapes.smooth_ramp(x - length, rounding)) / length
    return risen
