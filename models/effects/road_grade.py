r"""A road that climbs alike everywhere: gravity pulls each body backwards.

A vehicle that computes its own speed slows down. Where the speed is given, the grade shows only in what drive and
brakes must do about it, so it needs ``combined_slip`` or ``longitudinal_load_transfer`` with it.

Equation: $\dot v_x = \dots - g\sin\gamma$.

Confused with: air and rolling resistance, mass, and a bias of the longitudinal accelerometer.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects import _gravity

PORT = "longitudinal_gravity{body}"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("road_grade", r"\gamma", "rad", -0.3, 0.3, "grade of the road, uphill positive", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add ``-g sin(grade)``."""
    return value - _gravity.GRAVITY * sp.sin(e.p("road_grade"))
