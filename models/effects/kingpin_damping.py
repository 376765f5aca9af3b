r"""Viscous friction of the fifth wheel: a yaw moment in proportion to the articulation rate, against it.

Equation: $M_K = -d_K\dot\theta$.

Confused with: ``kingpin_friction``; lever arms of the trailer, if these are held fixed wrongly.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "coupling_moment"
READS: tuple[str, ...] = ("yaw_rate_tractor", "yaw_rate_trailer")
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("kingpin_damping", "d_K", "N*m*s/rad", 0.0, 5e5, "moment over articulation rate", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Subtract damping times articulation rate from the moment on the trailer."""
    return value - e.p("kingpin_damping") * (e.read("yaw_rate_trailer") - e.read("yaw_rate_tractor"))
