r"""An axle that is not steered turns under its lateral force: compliance of toe and camber as one coefficient.

Positive where the wheels yield to the force, which makes an axle softer; an axle built to turn against it is negative.
What yields at the steered axle is ``steering_compliance``, which acts alike.

Equation: $\alpha = \alpha_0 - c_A F_y(\alpha)$.

Confused with: stiffness and shape of the axle's tyre: on one axle a compliance *is* a smaller stiffness, but where the
tyre saturates.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "slip_angle_axle_{axle}"
PLACE = "tyre"
READS: tuple[str, ...] = ("lateral_force_axle_{axle}", "steady_lateral_force_axle_{axle}")
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("axle_compliance_steer", "c_A", "rad/N", -2e-6, 1e-5, "slip angle given up per lateral force", 0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Turn the axle's wheels back by compliance times force."""
    if e.depends(value, "road_wheel_angle"):
        return value
    relaxed = e.provides(f"lateral_force_axle_{e.site.axle}")
    force = e.at_axle("lateral_force" if relaxed else "steady_lateral_force")
    return value - e.solved(f"compliance_steer_axle_{e.site.axle}", e.p("axle_compliance_steer") * force)
