r"""An axle has a lateral force at zero slip: conicity and ply steer, or wheels out of track (Pacejka 2012, ch. 4).

Equation: $F_{0y} \to F_{0y} + \Delta F_y$.

Confused with: ``steering_offset`` (steered axle), ``road_bank``, ``crosswind`` that lasts the whole drive.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "steady_lateral_force_axle_{axle}"
PLACE = "tyre"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("tyre_force_offset", r"\Delta F_y", "N", -1e4, 1e4, "lateral force of an axle at zero slip, left", 0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add the offset."""
    return value + e.p("tyre_force_offset")
