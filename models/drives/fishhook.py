"""Steer fast to one side, and after a dwell faster still to the other (NHTSA fishhook of fixed timing).

The procedure turns the steering wheel at 720 deg/s, to an amplitude of up to some 300 degrees found by slowly
increasing steer (Li et al. 2017: 240 degrees at 90 km/h), dwells for 0.25 s, holds the counter steer for 3 s and
returns in 2 s. The throttle is released.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _nhtsa as nhtsa

OPTIONS: tuple[Option, ...] = (
    *nhtsa.options(speed=90.0 / 3.6),
    Option("rate", "rad/s", np.radians(720.0), 0.1, 30.0, "rate of the steering-wheel angle"),
    Option("dwell", "s", 0.25, 0.0, 10.0, "time at the first angle"),
    Option("hold", "s", 3.0, 0.0, 60.0, "time at the counter steer"),
    Option("return_time", "s", 2.0, 0.1, 60.0, "time of the return to straight ahead"),
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return the fishhook after the lead-in."""
    time, speed = nhtsa.time_and_speed(options, context)
    x, rounding = time - options["lead_in"], options["rounding"]
    rise = abs(options["amplitude"]) / options["rate"]
    counter = rise + options["dwell"]
    back = counter + 2 * rise + options["hold"]
    shape = (
        nhtsa.ramp(x, rise, rounding)
        - 2 * nhtsa.ramp(x - counter, 2 * rise, rounding)
        + nhtsa.ramp(x - back, options["return_time"], rounding)
    )
    return Profile(time, options["amplitude"] * shape, speed)
