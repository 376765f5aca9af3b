"""Sinusoidal steering whose frequency rises (or falls) exponentially over the drive."""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.models.contracts import DriveContext, Option, Profile
from harness.models.drives import _shapes as shapes

OPTIONS: tuple[Option, ...] = (
    *shapes.common(duration=80.0, speed=15.0),
    shapes.amplitude(np.radians(30.0)),
    Option("first_frequency", "Hz", 0.05, 0.005, 5.0, "frequency when the steering begins"),
    Option("last_frequency", "Hz", 1.0, 0.005, 5.0, "frequency at the end of the drive"),
    shapes.FADE,
    shapes.SPEED_CHANGE,
)


def generate(options: dict[str, Any], context: DriveContext) -> Profile:
    """Return an exponential sweep: every octave takes the same time.

    The phase is the integral of ``f(t) = f_1 (f_2 / f_1)^(t / T)``, that is
    ``2 pi f_1 T / k (exp(k t / T) - 1)`` with ``k = log(f_2 / f_1)``.
    """
    time = shapes.time_of(options, context)
    t = np.maximum(time - options["lead_in"], 0.0)
    span = t[-1]
    first = options["first_frequency"]
    k = np.log(options["last_frequency"] / first)
    # expm1(k x) / k tends to x: equal frequencies are a plain sine.
    stretched = np.expm1(k * t / span) / k * span if abs(k) > 1e-9 else t
    grown = shapes.smooth_step(t / options["fade"])
    steering = options["amplitude"] * grown * np.sin(2 * np.pi * first * stretched)
    return Profile(time, steering, shapes.changing_speed(options, time))
