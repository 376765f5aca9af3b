"""Free steering and speed along uniform cubic B-splines, the steering repeated until the drive ends.

A B-spline stays within the range of its control points, and its curvature is continuous (de Boor 1978, *A Practical
Guide to Splines*, ch. 9). Before the first one steering is zero and the speed that of the start.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import ModelError
from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=30.0, speed=12.0),
    shapes.amplitude(np.radians(60.0)),
    Option("steering", "text", "0 1 1 0 -1 -1 0 0.5 -0.5 0", 0.0, 0.0, "control points, as shares of the amplitude"),
    Option("spacing", "s", 1.0, 0.05, 600.0, "time between control points of the steering"),
    Option("speeds", "text", "1", 0.0, 0.0, "control points over all of the drive, over the speed at the start"),
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return steering and speed along their splines.

    Raises:
        ModelError: If a control point is no number, a share is beyond one, or a speed is not positive.
    """
    time = shapes.time_of(options, context)
    steering, speeds = (_numbers(options[name], name) for name in ("steering", "speeds"))
    if np.abs(steering).max() > 1.0:
        raise ModelError("steering: a control point is a share of the amplitude, from -1 to 1")
    if speeds.min() <= 0.0:
        raise ModelError("speeds: a control point is a speed over that at the start, above zero")
    t = time - options["lead_in"]
    changed = weights(t * (len(speeds) / t[-1]), len(speeds)) @ (speeds - 1.0)
    wheel = options["amplitude"] * weights(t / options["spacing"], len(steering)) @ steering
    return Profile(time, wheel, options["speed"] * (1.0 + changed))


def weights(along: Floats, count: int) -> Floats:
    """Return the weights of control points that are repeated ``(samples, count)``.

    Args:
        along: Time over that between control points, from 0 where the spline leaves zero ``(samples,)``.
        count: Number of control points.
    """
    passed = np.maximum(along, 0.0)
    piece = np.floor(passed + 1e-9).astype(int)
    u = np.clip(passed - piece, 0.0, 1.0)
    parts = ((1 - u) ** 3, 3 * u**3 - 6 * u**2 + 4, -3 * u**3 + 3 * u**2 + 3 * u + 1, u**3)
    table = np.zeros((len(along), count))
    for k, part in enumerate(parts):
        point = piece + k - 3  # three zeros stand before the first
        there = np.flatnonzero(point >= 0)
        np.add.at(table, (there, point[there] % count), part[there] / 6.0)
    return table


def _numbers(text: str, name: str) -> Floats:
    """Return the numbers of a text with spaces between them."""
    try:
        numbers = [float(word) for word in text.split()]
    except ValueError:
        numbers = []
    if not numbers or not all(map(math.isfinite, numbers)):
        raise ModelError(f"{name}: '{text}' is no list of numbers; write control points with spaces between: 0 0.5 -1")
    return np.array(numbers)
