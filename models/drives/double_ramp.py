"""Two steering ramps, one to each side, with a return to straight ahead between them (as Ziaukas 2023, Bild 5.7)."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=80.0, speed=5.0),
    shapes.amplitude(np.radians(-250.0)),
    Option("rate", "rad/s", np.radians(30.0), 1e-3, 20.0, "rate of the steering-wheel angle"),
    Option("hold", "s", 8.0, 0.0, 600.0, "time at each amplitude"),
    Option("pause", "s", 6.0, 0.0, 600.0, "time straight ahead between the two ramps"),
    Option("rounding", "s", 1.0, 0.01, 30.0, "time in which the corners of the ramps are rounded"),
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return a ramp of ``rate`` to ``amplitude``, held and taken back, and after a pause the same to the other side."""
    time = shapes.time_of(options, context)
    rise, hold = abs(options["amplitude"]) / options["rate"], options["hold"]

    def bump(begin: float) -> np.ndarray:
        up, down = (shapes.limited(time - at, rise, options["rounding"]) for at in (begin, begin + rise + hold))
        return np.asarray(up - down)

    second = options["lead_in"] + 2.0 * rise + hold + options["pause"]
    steering = np.sign(options["amplitude"]) * options["rate"] * (bump(options["lead_in"]) - bump(second))
    return Profile(time, steering, np.full_like(time, options["speed"]))
