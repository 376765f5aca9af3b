"""An axle whose wheels trail behind their kingpins and turn where the axle goes: part of its slip angle is lost.

Jujnovich and Cebon 2002: a self-steering axle of a trailer generates little lateral force; its steering damper and
return spring leave it the rest.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "slip_angle_axle_{axle}"
PLACE = "axle"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("self_steering", r"\sigma_S", "dimensionless", 0.0, 1.0, "share of the slip angle that is lost", 0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Take the share off the slip angle."""
    return value * (1 - e.p("self_steering"))
