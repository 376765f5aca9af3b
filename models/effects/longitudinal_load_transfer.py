r"""Braking loads the front of a body and driving its rear: the inertial force acts at the height of the CoG.

The acceleration is that of the speed behind ``PITCHING``, in which the body settles to its pitch; it also keeps the
noise of a measured speed out of the loads. On a grade the weight adds to it.

Equation: $M_y = -m\,h\,(a_x-g_x),$ $a_x=(v_x-v_p)/0.15\,\mathrm{s},$ $\dot v_p=a_x$.

Confused with: ``combined_slip``, which braking brings along.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects import _acceleration

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
    height = e.p("longitudinal_transfer_height")
    return value - e.mass * height * _acceleration.behind(e, "pitch_speed", PITCHING)
