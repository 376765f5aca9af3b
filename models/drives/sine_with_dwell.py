"""One period of a sine that rests for a while at its second peak (NHTSA, FMVSS 126: 0.7 Hz, 0.5 s).

The procedure turns the steering wheel by up to 270 degrees at 80 km/h, with the throttle released.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _nhtsa as nhtsa
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *nhtsa.options(speed=80.0 / 3.6),
    Option("frequency", "Hz", 0.7, 0.05, 3.0, "frequency of the sine"),
    Option("dwell", "s", 0.5, 0.0, 10.0, "time at the second peak"),
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return the sine with dwell after the lead-in; its start and end are rounded, the peaks need no rounding."""
    time, speed = nhtsa.time_and_speed(options, context)
    peak, period = 0.75 / options["frequency"], 1.0 / options["frequency"]
    run = shapes.limited(time - options["lead_in"], period + options["dwell"], options["rounding"])
    moving = np.minimum(run, peak) + np.maximum(run - peak - options["dwell"], 0.0)
    return Profile(time, options["amplitude"] * np.sin(2 * np.pi * options["frequency"] * moving), speed)
