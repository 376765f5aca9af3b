"""Brush tyre, pure lateral slip, uniform stiffness and parabolic pressure (Pacejka 2012, 3.2.1; Lex 2015).

With the slip ``s = C_F tan(alpha) / (3 mu F_z)`` it adheres at the front of its contact and slides at the rear; at
``|s| = 1`` all of it slides. It shares the stiffness (4.6 of Ziaukas 2023) with the other tyres, and its limit and its
stiffness at no slip are those of ``magic_formula``, so a parameter set of that tyre serves it too.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import TyreContext
from harness.models.assembly.expressions import larger, smaller
from harness.models.contracts import Parameter
from harness.models.tyres._stiffness import STIFFNESS_PARAMETERS, stiffness

PARAMETERS: tuple[Parameter, ...] = STIFFNESS_PARAMETERS

STIFFNESS = "stiffness_peak"


def lateral_force(t: TyreContext) -> sp.Expr:
    """Return the steady lateral force ``3 mu F_z (s - s |s| + s^3 / 3)`` in N, constant beyond ``|s| = 1``."""
    capacity = t.port("lateral_force_capacity", t.friction * t.vertical_load)
    slip = stiffness(t) * sp.tan(t.slip_angle) / (3 * capacity)
    s = larger(-1, smaller(1, slip))
    return 3 * capacity * (s - s * sp.Abs(s) + s**3 / 3)
