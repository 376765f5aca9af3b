r"""A sensor of acceleration or lateral velocity sits ahead of the point its signal is stated for.

Rigid-body kinematics: at ``x`` ahead the lateral velocity is larger by ``w x``, the lateral acceleration by ``dw/dt
x``, the longitudinal one smaller by ``w^2 x``.

Equation: $v_y \to v_y + x_y\dot\psi,$ $a_y \to a_y + x_y\ddot\psi,$ $a_x \to a_x - x_y\dot\psi^2$.

Confused with: the car's parameter ``reference_from_cog`` (the same thing for lateral velocity); position of the CoG.
"""

from __future__ import annotations

import sympy as sp

from harness.models.assembly.assemble import EffectContext
from harness.models.contracts import Parameter

PORT = (
    "sensor_lateral_acceleration{body}",
    "sensor_longitudinal_acceleration{body}",
    "sensor_lateral_velocity{body}",
    "sensor_lateral_velocity_rear",
)
PLACE = "output"
READS: tuple[str, ...] = ("yaw_acceleration{body}",)
STATES: tuple[str, ...] = ()

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("sensor_lever_arm", "x_y", "m", -5.0, 5.0, "sensor ahead of its stated point", neutral=0.0),
)


def apply(e: EffectContext, value: sp.Expr) -> sp.Expr:
    """Move the reading to where the sensor is."""
    arm, w = e.p("sensor_lever_arm"), e.body.yaw_rate
    if e.site.output.startswith("lateral_acceleration"):
        return value + e.at_body("yaw_acceleration") * arm
    if e.site.output.startswith("longitudinal_acceleration"):
        return value - w**2 * arm
    return value + w * arm
