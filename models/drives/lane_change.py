"""Double lane change: into the next lane and back, along a path (ISO 3888-1 and -2 lay out its lanes by cones).

The driver steers what the path needs and corrects nothing: ``ratio (atan(L kappa) + EG v^2 kappa)`` for the curvature
``kappa``, wheelbase ``L`` and understeer gradient ``EG`` of the vehicle as stated, at constant speed. So the vehicle
follows the path as far as it is quasi-steady and its tyres are linear. Each change is an S of the seventh order, whose
curvature begins and ends smoothly.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

_GRID = 0.05
"""m; spacing of the path."""

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=15.0, speed=15.0),
    Option("offset", "m", 3.5, 0.1, 20.0, "distance between the lanes"),
    Option("change", "m", 70.0, 5.0, 1000.0, "way along the road of the first change"),
    Option("stay", "m", 25.0, 0.0, 1000.0, "way in the other lane"),
    Option("back", "m", 70.0, 5.0, 1000.0, "way along the road of the change back"),
    shapes.DIRECTION,
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return the steering that belongs to the curvature of the path, and the speed, which stays."""
    time = shapes.time_of(options, context)
    way, curvature = _path(options)
    kappa = shapes.sign(options) * np.interp(options["speed"] * (time - options["lead_in"]), way, curvature)
    added = context.steering_ratio * context.understeer_gradient() * options["speed"] ** 2 * kappa
    return Profile(time, shapes.steering_of_curvature(kappa, context) + added, np.full_like(time, options["speed"]))


def _path(options: dict[str, Any]) -> tuple[Floats, Floats]:
    """Return the way along the path in m and its curvature in 1/m, left positive."""
    change, stay, back = options["change"], options["stay"], options["back"]
    x = np.arange(0.0, change + stay + back + 2 * _GRID, _GRID)
    slope, bend = np.zeros_like(x), np.zeros_like(x)
    for begin, length, sign in ((0.0, change, 1.0), (change + stay, back, -1.0)):
        u = np.clip((x - begin) / length, 0.0, 1.0)
        slope += sign * options["offset"] / length * 140.0 * u**3 * (1 - u) ** 3
        bend += sign * options["offset"] / length**2 * 420.0 * u**2 * (1 - u) ** 2 * (1 - 2 * u)
    stretch = np.sqrt(1.0 + slope**2)
    way = np.concatenate([[0.0], np.cumsum(_GRID * (stretch[1:] + stretch[:-1]) / 2)])
    return way, bend / stretch**3
