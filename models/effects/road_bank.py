r"""A road that is banked alike everywhere: gravity pulls each body towards the lower side.

ISO 8855: the bank is positive when the left side is higher. An accelerometer does not feel gravity in the plane of the
road, so the measured lateral acceleration changes only by what the tyres do about it.

Equation: $\dot v_y = \dots - g\sin\varphi_B$.

Confused with: ``steering_offset`` and a constant ``tyre_force_offset`` when driving straight; the accelerometer tells
them apart, as does a drive back along the same road.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects import _gravity

PORT = "lateral_gravity{body}"
READS: tuple[str, ...] = ()
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("road_bank", r"\varphi_B", "rad", -0.3, 0.3, "bank of the road, left side higher", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add ``-g sin(bank)``."""
    return value - _gravity.GRAVITY * sp.sin(e.p("road_bank"))
