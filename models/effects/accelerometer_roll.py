r"""A lateral accelerometer rolls out of the bend with its body and measures part of gravity.

The body rolls by ``k`` times its lateral acceleration, behind the second-order motion of its springs and dampers,
to the outside as every body on springs does. The reading is ``a cos(phi) + g sin(phi)``. What the roll's own
acceleration adds above the roll axis is left out.

Equation: $y \to a_y\cos\varphi+g\sin\varphi,$ $\varphi=k_R a_R,$ $\ddot a_R=\omega_R^2(a_y-a_R)-0.8\,\omega_R\dot a_R$.

Confused with: ``sensor_gain`` of the accelerometer, in drives slower than the roll. $\omega_R$ has no slope while $k_R$
is zero.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects import _body_roll, _gravity

PORT = "sensor_lateral_acceleration{body}"
PLACE = "body"
READS: tuple[str, ...] = ("lateral_acceleration{body}",)
STATES: tuple[str, ...] = ("leaning_lateral_acceleration", "leaning_rate_lateral_acceleration")

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("roll_gain", "k_R", "rad*s^2/m", 0.0, 0.05, "roll angle per lateral acceleration, outwards", neutral=0.0),
    _body_roll.roll_frequency("roll_frequency"),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add the part of gravity that the sensor measures."""
    lean = e.p("roll_gain") * _body_roll.leaning(e, STATES, e.p("roll_frequency"))
    return value * sp.cos(lean) + _gravity.GRAVITY * sp.sin(lean)
