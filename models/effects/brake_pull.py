r"""The brakes of one side pull more than those of the other: a yaw moment in proportion to the braking force of a body.

The force, mass times deceleration as every body brakes for itself, acts at a lateral offset: twice the offset over the
track is the share by which the sides differ. The deceleration is that of the speed behind ``SETTLING``, without what a
grade adds; resistances count as braking.

Equation: $M = y_B\,m\,\max(0,\,g_x-a_x),$ $a_x=(v_x-v_B)/0.15\,\mathrm{s},$ $\dot v_B=a_x$.

Confused with: ``crosswind`` in a single stop; ``steering_offset`` and ``longitudinal_load_transfer`` together. Braking
from several speeds in both directions tells them apart.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.assembly.expressions import larger
from harness.models.contracts import Parameter
from harness.models.effects import _acceleration

SETTLING = 0.15
"""s; time constant of the acceleration."""

CONSTANTS: dict[str, str] = {"SETTLING": "s"}

PORT = "external_yaw_moment{body}"
PLACE = "body"
READS: tuple[str, ...] = ("longitudinal_gravity{body}",)
STATES: tuple[str, ...] = ("brake_speed",)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("brake_pull", "y_B", "m", -1.0, 1.0, "braking force acts to the left of the middle", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Turn the body to the side that brakes."""
    braking = larger(-_acceleration.behind(e, STATES[0], SETTLING), sp.Integer(0))
    return value + e.p("brake_pull") * e.mass * braking
