r"""Still air pushes against a body that moves sideways (Mitschke and Wallentowitz 2014).

The side force is ``c_y rho A v^2 beta / 2`` and ``v beta`` the lateral velocity, so it is proportional to speed times
lateral velocity; the moment likewise, with the wheelbase in its coefficient.

Equation: $F = -k_y v_x v_y,$ $M = -k_n v_x v_y$.

Confused with: cornering stiffness of all axles, unless the speed varies widely.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = ("external_lateral_force{body}", "external_yaw_moment{body}")
PLACE = "body"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "aerodynamic_side_force", "k_y", "N*s^2/m^2", 0.0, 100.0, "side force over speed and lateral velocity", 0.0
    ),
    Parameter("aerodynamic_yaw_moment", "k_n", "N*s^2/m", -300.0, 300.0, "yaw moment over the same, to windward", 0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Push against the lateral velocity, or turn the body."""
    pressure = e.body.speed * e.body.lateral_velocity
    part = "aerodynamic_side_force" if e.site.port.startswith("external_lateral_force") else "aerodynamic_yaw_moment"
    return value - e.p(part) * pressure
