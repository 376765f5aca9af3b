r"""A body rolls on its springs: its CoG sways over the wheels, and its accelerometer measures part of gravity.

The equations of motion stay those of the CoG. The axles' lateral velocity is that of the roll axis, which differs by
the height of the CoG above it times the roll rate, and that makes slip. In terms of the mass ``m_s`` at ``h`` above the
roll axis, the inertia ``J`` about it and stiffness ``K`` less that of the weight (``_body_roll``): ``k_R = m_s h / K``,
``k_S = k_R h m_s / m``. The accelerometer is at the height of the CoG and leans with it. A trailer rests on its
coupling, which is at its roll axis as the axles are and has the lateral velocity ``v_K``; on the towing vehicle the
coupling is about as high as the CoG.
Products of roll angle and yaw rate, inclined roll axes and roll moments of the coupling are left out.
``lateral_load_transfer`` and ``roll_steer`` of the body's axles follow its roll.

Equation: $\alpha \to \alpha - k_S\dot a_R/v_x,$ $v_K \to v_K + k_S\dot a_R,$
$y \to a_y\cos\varphi+g\sin\varphi,$ $\varphi=k_R a_R,$
$\ddot a_R=\omega_R^2(a_y-a_R)-2\zeta_R\omega_R\dot a_R$.

Confused with: ``accelerometer_roll``, its limit at $k_S=0$; ``liquid_slosh``, which acts on the body alike but tilts no
accelerometer; ``tyre_relaxation`` and yaw inertia in drives slower than the roll. $\omega_R$ and $\zeta_R$ have no
slope while $k_R$ and $k_S$ are zero.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.assembly.expressions import larger
from harness.models.contracts import Parameter
from harness.models.effects import _body_roll, _gravity

SLOWEST = 1.0
"""m/s; the slip angles change as at this speed at least."""

CONSTANTS: dict[str, str] = {"SLOWEST": "m/s"}

PORT = (
    "slip_angle_axle_{axle}",
    "sensor_lateral_acceleration{body}",
    "coupling_sway{body}",
    "coupling_sway_rate{body}",
)
PLACE = "body"
READS: tuple[str, ...] = ("lateral_acceleration{body}",)
STATES: tuple[str, ...] = ("body_leaning", "body_leaning_rate")

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("body_roll_gain", "k_R", "rad*s^2/m", 0.0, 0.05, "roll angle per lateral acceleration, outwards", 0.0),
    Parameter("body_roll_sway", "k_S", "s^2", 0.0, 0.1, "how far the CoG sways per lateral acceleration", neutral=0.0),
    _body_roll.roll_frequency("body_roll_frequency"),
    Parameter("body_roll_damping", r"\zeta_R", "dimensionless", 0.02, 2.0, "damping ratio of the roll", grid=(0.3,)),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Move the axles sideways under the CoG, or add the part of gravity that the sensor measures."""
    if e.provides("roll_angle"):
        raise e.refuse("its body rolls already")
    frequency, damping = e.p("body_roll_frequency"), e.p("body_roll_damping")
    leant = _body_roll.leaning(e, STATES, frequency, damping)
    sway, rate = e.p("body_roll_sway"), e.state(STATES[1])
    if e.site.axle:
        return value - sway * rate / larger(e.body.speed, SLOWEST)
    if e.site.port.startswith("coupling_sway_rate"):
        change = _body_roll.second_derivative(e, STATES, frequency, damping)
        return value + sway * e.solved("body_leaning_acceleration" + e.site.suffix, change)
    if e.site.port.startswith("coupling_sway"):
        return value + sway * rate
    lean = e.p("body_roll_gain") * leant
    return value * sp.cos(lean) + _gravity.GRAVITY * sp.sin(lean)
