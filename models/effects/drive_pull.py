r"""The drive pushes more on one side than on the other, or pulls at the steering: a yaw moment on the leading body.

The force, that of the whole vehicle's acceleration behind ``SETTLING`` less gravity on a grade, acts at a lateral
offset: unequal half-shafts, a differential that locks, one driven wheel. Resistances are left out.

Equation: $M = -y_D\max\big(0,\,\textstyle\sum m\,(a_x-g_x)\big),$ $a_x=(v_x-v_D)/0.15\,\mathrm{s},$ $\dot v_D=a_x$.

Confused with: ``brake_pull`` of opposite sign, in drives that seldom brake; ``combined_slip`` of the driven axle, which
changes sign with the bend.
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

PORT = "external_yaw_moment{leader}"
READS: tuple[str, ...] = ("longitudinal_gravity{leader}",)
STATES: tuple[str, ...] = ("pull_speed",)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("drive_pull", "y_D", "m", -1.0, 1.0, "driving force acts to the left of the middle", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Turn the body away from the side that drives."""
    driving = larger(_acceleration.behind(e, STATES[0], SETTLING), sp.Integer(0))
    return value - e.p("drive_pull") * e.total_mass * driving
