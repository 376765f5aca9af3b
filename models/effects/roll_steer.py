r"""Body roll steers an axle through its suspension: a steer angle in proportion to how far the body leans.

Pacejka 2012, 1.2.2, there quasi-steady; here the body leans behind its lateral acceleration as its springs and dampers
let it. Positive steers into the bend. Where ``body_roll`` acts on the body, its frequency and damping hold, so that the
axle follows the angle of the body.

Equation: $\alpha \to \alpha + \varepsilon_R\,a_R,$ $\ddot a_R=\omega_R^2(a_y-a_R)-0.8\,\omega_R\dot a_R$.

Confused with: position of the CoG and stiffness of the axles: all of them change the understeer gradient.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter
from harness.models.effects import _body_roll

PORT = "slip_angle_axle_{axle}"
PLACE = "tyre"
READS: tuple[str, ...] = ("lateral_acceleration{body}",)
STATES: tuple[str, ...] = ("roll_steer_leaning", "roll_steer_leaning_rate")

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("roll_steer", r"\varepsilon_R", "rad*s^2/m", -0.02, 0.02, "steer angle per lateral acceleration", 0.0),
    _body_roll.roll_frequency("roll_steer_frequency"),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Turn the axle's wheels into the bend."""
    frequency = e.of_effect("body_roll", "body_roll_frequency", e.p("roll_steer_frequency"))
    damping = e.of_effect("body_roll", "body_roll_damping", _body_roll.ROLL_DAMPING)
    return value + e.p("roll_steer") * _body_roll.leaning(e, STATES, frequency, damping)
