r"""The Magic Formula's curvature factor, which bends the force around its peak (Pacejka 2012, 4.E19 and 4.E24).

``magic_formula`` has ``E = 0``. Here ``E = E_0 + E_a sign(alpha)``, that of one load without camber; 1 at most. With
the source's coefficients ``E_0 = p_Ey1`` and ``E_a = -p_Ey1 p_Ey3``. It changes neither the stiffness nor the largest
force. A curvature that depends on load and camber is the tyre ``magic_formula_61``.

Equation: $F_{0y} = D\sin\big(C\arctan(x-E(x-\arctan x))\big),$ $x=\frac{C_F}{CD}\tan\alpha,$ $E=E_0+E_a\,
\mathrm{sign}\,\alpha$.

Confused with: the shape factor and ``lateral_load_transfer``, unless the drive goes beyond the peak.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.assembly.expressions import smaller
from harness.models.contracts import Parameter

PORT = "steady_lateral_force_axle_{axle}"
PLACE = "tyre"
READS: tuple[str, ...] = (
    "slip_angle_axle_{axle}",
    "lateral_force_capacity_axle_{axle}",
    "cornering_stiffness_axle_{axle}",
    "shape_factor_{tyre}",
)
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("tyre_curvature", "E_0", "dimensionless", -10.0, 1.0, "curvature factor", neutral=0.0),
    Parameter("tyre_curvature_side", "E_a", "dimensionless", -1.0, 1.0, "more of it when slipping left", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add what the curvature changes."""
    shape_factor = f"shape_factor_{e.site.place}"
    if not e.provides(shape_factor):
        raise e.refuse("its tyre is not magic_formula, which has no curvature")
    shape, limit, slip = e.read(shape_factor), e.at_axle("lateral_force_capacity"), e.at_axle("slip_angle")
    x = e.at_axle("cornering_stiffness") / (shape * limit) * sp.tan(slip)
    curvature = smaller(e.p("tyre_curvature") + e.p("tyre_curvature_side") * sp.sign(slip), sp.Integer(1))
    bent = x - curvature * (x - sp.atan(x))
    return value + limit * (sp.sin(shape * sp.atan(bent)) - sp.sin(shape * sp.atan(x)))
