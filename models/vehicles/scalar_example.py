"""The scalar system on which the lecture computes a Kalman filter by hand: ``x(n+1) = 0.5 x(n) + u(n) + v(n)``.

KIT 2015, exercise 1. It is no vehicle, but small enough to check every number of a filter. What a drive steers, in
rad, is its input; estimators begin with the exercise's variance.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from harness.common.arrays import Floats
from harness.models.contracts import Parameter

if TYPE_CHECKING:
    from harness.models.assembly.assemble import Builder
    from harness.models.contracts import DriveContext, Profile

STATES: tuple[str, ...] = ("example_state",)
INPUTS: tuple[str, ...] = ("example_input",)
AXLES: dict[str, str] = {}
VALID: dict[str, float] = {"example_state": 1e6}
START_VARIANCE: dict[str, float] = {"example_state": 10.0}

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("transition", "A", "dimensionless", -2.0, 2.0, "share of the state that is left one sample later"),
)


def equations(v: Builder) -> None:
    """State the difference equation."""
    v.next_value("example_state", v.p("transition") * v.state("example_state") + v.input("example_input"))


def drive_inputs(profile: Profile, context: DriveContext) -> dict[str, Floats]:
    """Return the input over a drive."""
    return {"example_input": profile.steering_wheel_angle}
