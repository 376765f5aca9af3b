r"""The cornering stiffness of an axle drifts over the drive, as tyres warm up or lose pressure.

Exponential in time, so that it stays positive; over a drive short against ``1 / rate`` it is a straight line.

Equation: $C_F \to C_F\,e^{\eta_C t}$.

Confused with: a stiffness that is wrong, if the drive is short; friction and load that change with time.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "cornering_stiffness_axle_{axle}"
PLACE = "tyre"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("stiffness_drift", r"\eta_C", "1/s", -0.01, 0.01, "relative change of the stiffness over time", 0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Let the stiffness grow or shrink from the start of the drive."""
    return value * sp.exp(e.p("stiffness_drift") * e.time)
