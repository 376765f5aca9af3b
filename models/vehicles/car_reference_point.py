"""Car with the centre of its rear axle as reference point (Sun 2015, eqs 2.18 to 2.21).

The reference does not move with the load, so the centre of gravity may be unknown: ``l_f`` is a parameter like the
others. States are the lateral velocity of the rear axle, the yaw rate and the heading; the speed of the rear axle and
its derivative are inputs. Each axle is a linear tyre whose stiffness goes with its load, and the loads go with the
longitudinal acceleration; the mass cancels but for its ratio to the yaw inertia.

The printed signs are right: with ``l_r = L - l_f``, the CoG lies ``l_r`` ahead of the reference, so its acceleration
is that of the reference plus ``(-w^2 l_r, dw/dt l_r)``; accelerating takes load off the front axle; and the moment of
the rear axle, ``-l_r F_yr`` with ``alpha_r = -v_y / v_x``, is the second term of (2.19).

Sun steers the road wheels; drives turn a steering wheel, so there is a steering ratio between the two.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from harness.models.assembly.expressions import larger
from harness.models.assembly.model import Body
from harness.models.contracts import Parameter

if TYPE_CHECKING:
    from harness.models.assembly.assemble import Builder

GRAVITY = 9.81
LOWEST_SPEED = 1.5
"""m/s; slip angles use at least this speed: below it Euler's step of 10 ms is too long for the tyres' damping."""

CONSTANTS: dict[str, str] = {"GRAVITY": "m/s^2", "LOWEST_SPEED": "m/s"}

STATES: tuple[str, ...] = ("lateral_velocity_rear", "yaw_rate", "heading")
INPUTS: tuple[str, ...] = ("steering_wheel_angle", "speed")
AXLES: dict[str, str] = {}
USUAL: dict[str, str] = {"parameters": "sun_2015", "sensors": "car_reference"}
VALID: dict[str, float] = {"lateral_velocity_rear": 30.0, "yaw_rate": 5.0}

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("stiffness_over_load_front", "C_{sf}", "1/rad", 1.0, 50.0, "lateral force over slip and load, front"),
    Parameter("stiffness_over_load_rear", "C_{sr}", "1/rad", 1.0, 50.0, "lateral force over slip and load, rear"),
    Parameter("mass_over_inertia", "m/J", "1/m^2", 0.05, 5.0, "mass over yaw inertia"),
    Parameter("cog_to_front_axle", "l_f", "m", 0.3, 4.0, "CoG to the front axle"),
    Parameter("axle_distance", "L", "m", 1.0, 6.0, "front axle to rear axle"),
    Parameter("cog_height", "h", "m", 0.0, 2.0, "height of the CoG"),
    Parameter("steering_ratio", r"i_\mathrm{L}", "dimensionless", 1.0, 40.0, "steering wheel over road wheel angle"),
)


def check(values: dict[str, float]) -> list[tuple[str, str]]:
    """Return ``(parameter, what is wrong)`` for values that are each in bounds but impossible together."""
    front, between = values["cog_to_front_axle"], values["axle_distance"]
    if front < between:
        return []
    return [("cog_to_front_axle", f"{front:g} m must be less than the axles' distance of {between:g} m")]


def wheelbase(values: dict[str, float]) -> float:
    """Return the wheelbase in m (for the limits of the drives)."""
    return values["axle_distance"]


def equations(v: Builder) -> None:
    """State the differential equations (Sun 2015, 2.8, 2.9 and 2.18 to 2.21)."""
    C_sf, C_sr = v.p("stiffness_over_load_front"), v.p("stiffness_over_load_rear")
    l_f, L, h = v.p("cog_to_front_axle"), v.p("axle_distance"), v.p("cog_height")
    l_r = L - l_f
    v_y, w = v.state("lateral_velocity_rear"), v.state("yaw_rate")
    v_x = v.port("speed_over_ground", v.input("speed"))
    v.body("", Body(v_x, v_y + w * l_r, w, None, L))
    rolling = larger(v_x, LOWEST_SPEED)
    delta = v.port("road_wheel_angle", v.input("steering_wheel_angle") / v.p("steering_ratio"))
    alpha_f = v.port("slip_angle_front", delta - (v_y + L * w) / rolling)  # (2.8)
    alpha_r = v.port("slip_angle_rear", -v_y / rolling)  # (2.9)
    g_x, g_y = v.port("longitudinal_gravity", 0), v.port("lateral_gravity", 0)
    dv_x = v.port("speed_over_ground_rate", v.rate("speed"))
    a_x = v.port("longitudinal_acceleration", dv_x - w * v_y - w**2 * l_r - g_x)  # (2.18)
    f_f = C_sf * (l_r * GRAVITY - h * a_x) / L * alpha_f  # lateral force of the axle over the mass of the car
    f_r = C_sr * (l_f * GRAVITY + h * a_x) / L * alpha_r
    a_y = v.port("lateral_acceleration", f_f + f_r)
    dw = v.port("yaw_acceleration", v.p("mass_over_inertia") * (l_f * f_f - l_r * f_r))
    v.derivative("yaw_rate", dw)  # (2.19)
    v.derivative("lateral_velocity_rear", a_y + g_y - w * v_x - dw * l_r)  # (2.20)
    v.derivative("heading", w)  # (2.21)
