r"""An axle that the articulation steers: a linkage at the kingpin turns the wheels in proportion to the angle.

Jujnovich and Cebon 2002, command steer: the rear axles of a trailer are turned against the bend, so that the trailer
cuts in less and its tyres scrub less.

Equation: $\alpha \to \alpha + k_\theta\,\theta$.

Confused with: the same on another trailer axle; the stiffness of the trailer's tyres and the position of its axles when
turning steadily, where articulation and slip angles keep their ratio.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "slip_angle_axle_{axle}"
PLACE = "axle"
READS: tuple[str, ...] = ("articulation_angle",)
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("forced_steering", r"k_\theta", "dimensionless", -1.0, 1.0, "steer angle over articulation angle", 0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Turn the axle's wheels by a share of the articulation angle, to the same side as the trailer stands."""
    return value + e.p("forced_steering") * e.read("articulation_angle")
