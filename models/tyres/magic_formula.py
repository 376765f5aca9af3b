"""Magic Formula tyre, pure lateral slip (Pacejka and Bakker 1992; Ziaukas 2023, eqs 4.3 to 4.6, with E = 0).

The slip variable is ``tan(alpha)``. The four coefficients are those of a whole axle.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import TyreContext
from harness.models.contracts import Parameter
from harness.models.tyres._stiffness import STIFFNESS_PARAMETERS, stiffness

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("shape_factor", "C", "dimensionless", 0.5, 4.0, "Magic Formula shape factor C (table 4.4)"),
    *STIFFNESS_PARAMETERS,
)

STIFFNESS = "stiffness_peak"


def lateral_force(t: TyreContext) -> sp.Expr:
    """Return the steady lateral force ``D sin(C atan(B tan(alpha)))`` in N (4.3 with E = 0)."""
    capacity = t.port("lateral_force_capacity", t.friction * t.vertical_load)  # D (4.4)
    slope = stiffness(t)
    shape = t.p("shape_factor")
    return capacity * sp.sin(shape * sp.atan(slope / (shape * capacity) * sp.tan(t.slip_angle)))
