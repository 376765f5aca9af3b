r"""A sensor is off by a constant.

Equation: $y \to y + b_y$.

Confused with: ``steering_offset`` and ``tyre_force_offset`` in drives that turn one way only.
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
    Parameter("sensor_bias", "b_y", "{signal}", -3.0, 3.0, "reading where the true value is zero", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add the bias."""
    return value + e.p("sensor_bias")
