"""Steer fast to one side and hold (NHTSA J-turn: 1000 deg/s, held for 4 s, back in 2 s).

The procedure takes an amplitude of up to some 330 degrees found by slowly increasing steer (Li et al. 2017: 200
degrees at 80 km/h). The throttle is released.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _nhtsa as nhtsa

OPTIONS: tuple[Option, ...] = (
    *nhtsa.options(speed=80.0 / 3.6),
    Option("rate", "rad/s", np.radians(1000.0), 0.1, 30.0, "rate of the steering-wheel angle"),
    Option("hold", "s", 4.0, 0.0, 60.0, "time at the angle"),
    Option("return_time", "s", 2.0, 0.1, 60.0, "time of the return to straight ahead"),
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return the J-turn after the lead-in."""
    time, speed = nhtsa.time_and_speed(options, context)
    x, rounding = time - options["lead_in"], options["rounding"]
    rise = abs(options["amplitude"]) / options["rate"]
    back = nhtsa.ramp(x - rise - options["hold"], options["return_time"], rounding)
    return Profile(time, options["amplitude"] * (nhtsa.ramp(x, rise, rounding) - back), speed)
