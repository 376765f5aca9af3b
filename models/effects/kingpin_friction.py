"""Dry friction of the fifth wheel: a yaw moment against the articulation rate, of one size at any rate.

The sign of the rate is smoothed over ``SMOOTHING``, which leaves a stick-slip of the coupling out.
"""

from __future__ import annotations

import sympy as sp

from models.assemble import EffectContext
from models.contracts import Parameter

SMOOTHING = 0.01
"""rad/s; articulation rate at which three quarters of the friction act."""

CONSTANTS: dict[str, str] = {"SMOOTHING": "rad/s"}

PORT = "coupling_moment"
READS: tuple[str, ...] = ("yaw_rate_tractor", "yaw_rate_trailer")
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("kingpin_friction", "M_R", "N*m", 0.0, 5e4, "largest moment of dry friction", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Take the moment off the trailer's turning against the tractor."""
    rate = e.read("yaw_rate_trailer") - e.read("yaw_rate_tractor")
    return value - e.p("kingpin_friction") * sp.tanh(rate / SMOOTHING)
