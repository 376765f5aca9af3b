r"""A sensor reads less, or more, the faster the vehicle goes: ``1 - c v``.

Ziaukas 2023, 4.2.1: the yaw rate from the trailer's wheel speeds needs the factor ``1 - v_x2 / 200`` to agree with
a gyro (``c`` = 0.005 s/m with ``v`` in m/s; the thesis prints no unit). A reading that needs this factor is itself
larger, so it has a negative ``c``.

Equation: $y \to (1-c_v v_x)\,y$.

Confused with: ``sensor_gain``, unless the speed varies.
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
    Parameter("sensor_speed_loss", "c_v", "s/m", -0.02, 0.02, "share of the reading lost per speed", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Scale the reading by the speed of the body it belongs to."""
    return value * (1 - e.p("sensor_speed_loss") * e.body.speed)
