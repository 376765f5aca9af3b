"""Braking loads the front of a body and driving its rear: the inertial force acts at the height of the CoG.

The acceleration is that of the speed behind ``PITCHING``, in which the body settles to its pitch; it also keeps the
noise of a measured speed out of the loads. On a grade the weight adds to it.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PITCHING = 0.15
"""s; time constant of the pitch."""

CONSTANTS: dict[str, str] = {"PITCHING": "s"}

PORT = "pitch_moment{body}"
PLACE = "body"
READS: tuple[str, ...] = ("longitudinal_gravity{body}",)
STATES: tuple[str, ...] = ("pitch_speed",)

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("longitudinal_transfer_height", "h", "m", 0.0, 2.5, "height of the CoG above the road", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add ``-m h (a_x - g_x)``, which loads the front when the body slows down."""
    settled = e.state("pitch_speed", start="speed")
    acceleration = (e.body.speed - settled) / PITCHING
    e.derivative("pitch_speed", acceleration)
    height = e.p("longitudinal_transfer_height")
    return value - e.mass * height * (acceleration - e.at_body("longitudinal_gravity"))
