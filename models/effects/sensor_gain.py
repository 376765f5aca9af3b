r"""A sensor reads too much or too little in proportion.

Equation: $y \to (1+g_y)\,y$.

Confused with: ``sensor_gain_speed``; for the force of an axle the masses.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "sensor_{output}"
PLACE = "output"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "sensor_gain_error",
        "g_y",
        "dimensionless",
        -1.0,
        2.0,
        "reading over true value, less 1",
        neutral=0.0,
        natural=(-1.0,),
    ),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Scale the reading."""
    return value * (1 + e.p("sensor_gain_error"))
