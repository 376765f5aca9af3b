"""A lateral accelerometer rolls out of the bend with its body and measures part of gravity.

The body rolls by ``k`` times its lateral acceleration, behind the second-order motion of its springs and dampers;
positive ``k`` rolls to the outside. The reading is ``a cos(phi) + g sin(phi)``. What the roll's own acceleration
adds above the roll axis is left out.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects import _gravity

ROLL_DAMPING = 0.4
"""Damping ratio of the roll."""

PORT = "sensor_lateral_acceleration{body}"
PLACE = "body"
READS: tuple[str, ...] = ("lateral_acceleration{body}",)
STATES: tuple[str, ...] = ("leaning_lateral_acceleration", "leaning_rate_lateral_acceleration")

PARAMETERS: tuple[Parameter, ...] = (
    Parameter(
        "roll_gain", "k_R", "rad*s^2/m", -0.05, 0.05, "roll angle per lateral acceleration, outwards", neutral=0.0
    ),
    Parameter("roll_frequency", r"\omega_R", "rad/s", 2.0, 40.0, "frequency of the roll", grid=(5.0, 9.0, 15.0)),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add the part of gravity that the sensor measures."""
    leant, rate = (e.state(name) for name in STATES)
    omega = e.p("roll_frequency")
    e.derivative(STATES[0], rate)
    e.derivative(STATES[1], omega**2 * (e.at_body("lateral_acceleration") - leant) - 2 * ROLL_DAMPING * omega * rate)
    lean = e.p("roll_gain") * leant
    return value * sp.cos(lean) + _gravity.GRAVITY * sp.sin(lean)
