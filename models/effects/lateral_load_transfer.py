r"""In a bend the outer wheel gains less grip than the inner one loses, so the axle loses capacity and stiffness.

Pacejka 2012, 1.2.2: with a tyre that is degressive in its load, transferring the share ``zeta`` of the load costs the
axle a part of about ``zeta^2``; ``zeta`` is in proportion to the lateral acceleration. That is taken as yaw rate times
speed, which needs no tyre force and so makes no algebraic loop; ``1 / (1 + k x^2)`` stays positive in any bend. Where
``body_roll`` acts on the body, the load follows its roll: what leans there stands in place of it.

Equation: $D,\ C_F \;\to\; \frac{D,\ C_F}{1+k_y\,(v_x\dot\psi/g)^2}$.

Confused with: the tyres' shape factor and friction: all bend the force at large slip. Drives at different speeds tell
them apart.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects import _gravity

PORT = ("lateral_force_capacity_axle_{axle}", "cornering_stiffness_axle_{axle}")
PLACE = "tyre"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "lateral_transfer_loss", "k_y", "dimensionless", 0.0, 10.0, "loss per square of acceleration over gravity", 0.0
    ),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Reduce capacity or stiffness."""
    transferring = e.of_effect("body_roll", "body_leaning", e.body.centripetal_acceleration)
    return value / (1 + e.p("lateral_transfer_loss") * (transferring / _gravity.GRAVITY) ** 2)
