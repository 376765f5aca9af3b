"""Heading of a vehicle by dead reckoning: the wheels' encoders tell its change, a gyro measures it (KIT 2015).

Exercise 2: ``theta(n+1) = theta(n) + d_theta(n) + v(n)``. The change of heading per sample that the encoders of the
left and right wheels give is the input; its noise is the process noise. The measured output is the heading that the
integrated gyro gives. On a drive the increment is that of a car that rolls without slip and steers its road wheels
directly.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from harness.common.arrays import Floats
from harness.models.contracts import Parameter

if TYPE_CHECKING:
    from harness.models.assembly.assemble import Builder
    from harness.models.contracts import DriveContext, Profile

WHEELBASE = 2.7
"""m; of a mid-size car, this project's choice."""

STATES: tuple[str, ...] = ("heading",)
INPUTS: tuple[str, ...] = ("heading_increment",)
AXLES: dict[str, str] = {}
VALID: dict[str, float] = {"heading": 1e4}
PARAMETERS: tuple[Parameter, ...] = ()


def equations(v: Builder) -> None:
    """State the difference equation."""
    v.next_value("heading", v.state("heading") + v.input("heading_increment"))


def wheelbase(values: dict[str, float]) -> float:
    """Return the wheelbase in m (for the limits of the drives and the increments)."""
    return WHEELBASE


def drive_inputs(profile: Profile, context: DriveContext) -> dict[str, Floats]:
    """Return the change of heading from each sample to the next, ``v tan(delta) / wheelbase`` times the step."""
    curvature = np.tan(profile.steering_wheel_angle / context.steering_ratio) / context.wheelbase
    return {"heading_increment": profile.speed * curvature * context.step}
