"""A country road of random bends, whose driver slows for the tight ones and speeds up after them."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.common.errors import ModelError
from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=120.0, speed=15.0),
    Option("tightest_radius", "m", 40.0, 8.0, 2e3, "radius of the tightest bends"),
    Option("widest_radius", "m", 250.0, 8.0, 2e4, "radius of the widest bends"),
    Option("least_angle", "rad", np.radians(15.0), np.radians(1.0), np.pi, "heading gained in the least bend"),
    Option("most_angle", "rad", np.radians(90.0), np.radians(1.0), np.pi, "heading gained in the longest bend"),
    Option("straight", "m", 40.0, 0.0, 2e3, "longest straight between two bends"),
    Option("same_side", "", 0.2, 0.0, 1.0, "share of the bends that turn to the side of the bend before"),
    Option("comfort", "m/s^2", 2.0, 0.1, 20.0, "lateral acceleration for which the driver slows"),
    Option("acceleration", "m/s^2", 0.8, 0.05, 5.0, "largest longitudinal acceleration and deceleration"),
    shapes.seed(1),
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return the drive along a road of clothoid-like bends with the speed a driver would choose.

    Curvatures, not radii, are drawn uniformly, so that tight bends are as frequent as wide ones. The
    curvature rises, and again falls, along 0.6 of the way the turn would take without transitions.

    Raises:
        ModelError: If the tightest radius or least angle exceeds its counterpart.
    """
    for low, high in (("tightest_radius", "widest_radius"), ("least_angle", "most_angle")):
        if options[low] > options[high]:
            raise ModelError(f"{low}: {options[low]:g} exceeds {high} = {options[high]:g}; swap them")
    random = shapes.generator(options)
    arcs: list[shapes.Arc] = []
    side, way = 1.0, 0.0
    # The road is laid out for a driver who never slows, so it is always long enough.
    while way < options["speed"] * options["duration"]:
        curvature = random.uniform(1 / options["widest_radius"], 1 / options["tightest_radius"])
        angle = random.uniform(options["least_angle"], options["most_angle"])
        straight = random.uniform(0.0, options["straight"])
        side = side if random.uniform() < options["same_side"] else -side
        bend = shapes.Arc.turning(side * angle, 1 / curvature, 0.6 * angle / curvature, options["speed"])
        arcs += [shapes.Arc(straight, 0.0, 0.0, options["speed"]), bend]
        way += straight + bend.length
    return shapes.follow(arcs, options, context, options["acceleration"], lateral=options["comfort"])
