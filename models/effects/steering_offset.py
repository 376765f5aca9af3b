r"""The steering wheel is not straight when the road wheels are: an offset of the road-wheel angle.

Equation: $\delta = \delta_L/i_L + \delta_0$.

Confused with: ``road_bank``, ``tyre_force_offset`` of the steered axle, a bias of the yaw-rate sensor.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "road_wheel_angle"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("steering_offset", r"\delta_0", "rad", -0.1, 0.1, "road-wheel angle at no steering, left", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add the offset."""
    return value + e.p("steering_offset")
