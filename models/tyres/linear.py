"""Linear tyre (Ziaukas 2023, eq. 4.1) with the load-dependent stiffness of the Magic Formula (4.6).

It is the tangent of ``magic_formula`` at zero slip, so both share a parameter set.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import TyreContext
from harness.models.contracts import Parameter
from harness.models.tyres._stiffness import STIFFNESS_PARAMETERS, stiffness

PARAMETERS: tuple[Parameter, ...] = STIFFNESS_PARAMETERS

STIFFNESS = "stiffness_peak"


def lateral_force(t: TyreContext) -> sp.Expr:
    """Return the steady lateral force ``C_F tan(alpha)`` in N; the slip angle makes a force to its own side."""
    return stiffness(t) * sp.tan(t.slip_angle)
