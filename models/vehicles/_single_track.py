"""The single-track car that ``car`` and ``car_friction`` share: lateral velocity and yaw rate at a given speed.

Pacejka 2012, 1.3.1, with the slip angles' arc tangents and any tyre of ``models/tyres``.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import sympy as sp

from harness.models.assembly.expressions import larger
from harness.models.assembly.model import Body
from harness.models.contracts import Parameter

if TYPE_CHECKING:
    from harness.models.assembly.assemble import Builder

GRAVITY = 9.81

CONSTANTS: dict[str, str] = {"GRAVITY": "m/s^2"}

LOWEST_SPEED: Parameter = Parameter(
    "lowest_speed", r"v_\mathrm{min}", "m/s", 0.1, 5.0, "slip angles use at least this speed", numerical=True
)
"""The slower, the faster tyres damp: ``C/(m v)`` per second. Below some speed a step is too long for that."""


def single_track(v: Builder, friction: sp.Expr) -> None:
    """State the derivatives of ``lateral_velocity`` and ``yaw_rate`` and publish what they are made of.

    Args:
        v: Builder of a vehicle with inputs ``steering_wheel_angle`` and ``speed``, axles ``front`` and ``rear``,
            ``LOWEST_SPEED`` among its parameters and the others read here.
        friction: Largest friction of both tyres.
    """
    m, shift = v.p("mass"), v.port("cog_shift", 0)
    l_f, l_r = v.p("cog_to_front_axle") - shift, v.p("cog_to_rear_axle") + shift
    v_y, w = v.state("lateral_velocity"), v.state("yaw_rate")
    v_x = v.port("speed_over_ground", v.input("speed"))
    v.body("", Body(v_x, v_y, w, m, l_f + l_r))
    rolling = larger(v_x, v.p("lowest_speed"))
    delta = v.port("road_wheel_angle", v.input("steering_wheel_angle") / v.p("steering_ratio"))
    weight = m * GRAVITY / (l_f + l_r)
    pitch = v.port("pitch_moment", 0) / (l_f + l_r)
    F_f = v.tyre("front", delta - sp.atan((v_y + l_f * w) / rolling), weight * l_r + pitch, friction)
    F_r = v.tyre("rear", -sp.atan((v_y - l_r * w) / rolling), weight * l_f - pitch, friction)
    steered = v.port("lateral_force_steered_axle", F_f) * sp.cos(delta)
    v.port("longitudinal_gravity", 0)
    force, moment = v.port("external_lateral_force", 0), v.port("external_yaw_moment", 0)
    a_y = v.port("lateral_acceleration", (steered + F_r + force) / v.port("inertial_mass", m))
    turning = v.port("yaw_acceleration", (l_f * steered - l_r * F_r + moment) / v.p("yaw_inertia"))
    v.derivative("lateral_velocity", a_y + v.port("lateral_gravity", 0) - w * v_x)
    v.derivative("yaw_rate", turning)
