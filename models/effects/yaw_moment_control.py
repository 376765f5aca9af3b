r"""Torque vectoring or stability control turns the steered body towards a yaw rate that suits speed and steering.

The reference is that of a steady single-track car, ``v delta / (L (1 + (v / v_ch)^2))`` (Rajamani 2012, ch. 8), the
moment ``K (reference - yaw rate)``, without dead band and without limit.

Equation: $M = K_r\Big(\frac{v_x\delta}{L\,(1+v_x^2/v_\mathrm{ch}^2)}-\dot\psi\Big)$.

Confused with: yaw damping by the tyres: stiffness of both axles and yaw inertia together. $v_\mathrm{ch}$ has no slope
while the gain is zero.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = "external_yaw_moment{leader}"
READS: tuple[str, ...] = ("road_wheel_angle",)
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("yaw_control_gain", "K_r", "N*m*s/rad", 0.0, 5e5, "moment over yaw rate error", neutral=0.0),
    Parameter(
        "yaw_control_speed",
        r"v_\mathrm{ch}",
        "m/s",
        5.0,
        200.0,
        "characteristic speed of the reference",
        grid=(12.0, 20.0, 30.0, 60.0),
    ),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Add the control's moment."""
    v = e.body.speed
    wanted = v * e.read("road_wheel_angle") / (e.body.wheelbase * (1 + (v / e.p("yaw_control_speed")) ** 2))
    return value + e.p("yaw_control_gain") * (wanted - e.body.yaw_rate)
