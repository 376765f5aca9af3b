"""Car with three degrees of freedom and unknown axle stiffnesses (Li et al. 2017, eqs 1 to 10).

Longitudinal velocity, sideslip angle and yaw rate of a single-track car on linear tyres, with the cornering stiffness
of each axle as a random walk. The longitudinal acceleration is an input that the vehicle's own sensor supplies; no
drive states it.

The paper counts stiffness negative (4: ``a_y = ... - k_1 delta / m`` must be positive in a turn to the left); here
``k_1, k_2 > 0`` is force over slip angle, so every term that has a ``k`` carries the opposite sign. The states are in
N/rad; ``li_2017`` says how the paper's process noise is to be read for them.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

from harness.models.assembly.expressions import larger
from harness.models.assembly.model import Body
from harness.models.contracts import Parameter

if TYPE_CHECKING:
    from harness.models.assembly.assemble import Builder

LOWEST_SPEED = 0.3
"""m/s; slip angles use at least this speed, so that a standstill stays finite."""

CONSTANTS: dict[str, str] = {"LOWEST_SPEED": "m/s"}

STATES: tuple[str, ...] = (
    "longitudinal_velocity",
    "sideslip_angle",
    "yaw_rate",
    "cornering_stiffness_front",
    "cornering_stiffness_rear",
)
INPUTS: tuple[str, ...] = ("steering_wheel_angle", "longitudinal_acceleration")
AXLES: dict[str, str] = {}
USUAL: dict[str, str] = {"parameters": "li_2017", "sensors": "car_inertial"}
START: dict[str, float | str] = {
    "longitudinal_velocity": "speed",
    "cornering_stiffness_front": "first_stiffness_front",
    "cornering_stiffness_rear": "first_stiffness_rear",
}

# Beyond these magnitudes an estimate says nothing about a car.
VALID: dict[str, float] = {
    "longitudinal_velocity": 100.0,
    "sideslip_angle": 3.0,
    "yaw_rate": 10.0,
    "cornering_stiffness_front": 2e6,
    "cornering_stiffness_rear": 2e6,
}

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("mass", "m", "kg", 3e2, 5e3, "mass of the car"),
    Parameter("yaw_inertia", "I_z", "kg*m^2", 1e2, 2e4, "yaw inertia"),
    Parameter("cog_to_front_axle", "a", "m", 0.3, 4.0, "CoG to the front axle"),
    Parameter("cog_to_rear_axle", "b", "m", 0.3, 4.0, "CoG to the rear axle"),
    Parameter("steering_ratio", r"i_\mathrm{L}", "dimensionless", 5.0, 40.0, "steering wheel over road wheel angle"),
    Parameter("first_stiffness_front", "k_{1,0}", "N/rad", 1e3, 1e6, "front stiffness at the start"),
    Parameter("first_stiffness_rear", "k_{2,0}", "N/rad", 1e3, 1e6, "rear stiffness at the start"),
)


def wheelbase(values: dict[str, float]) -> float:
    """Return the wheelbase in m (for the limits of the drives)."""
    return values["cog_to_front_axle"] + values["cog_to_rear_axle"]


def equations(v: Builder) -> None:
    """State the differential equations (Li et al. 2017, 1 to 4)."""
    m, I_z, a, b = v.p("mass"), v.p("yaw_inertia"), v.p("cog_to_front_axle"), v.p("cog_to_rear_axle")
    v_x, beta, r = v.state("longitudinal_velocity"), v.state("sideslip_angle"), v.state("yaw_rate")
    v.body("", Body(v_x, v_x * beta, r, m, a + b))
    k_1, k_2 = v.state("cornering_stiffness_front"), v.state("cornering_stiffness_rear")
    delta = v.port("road_wheel_angle", v.input("steering_wheel_angle") / v.p("steering_ratio"))
    rolling = larger(v_x, LOWEST_SPEED)
    alpha_1 = v.port("slip_angle_front", delta - beta - a * r / rolling)
    alpha_2 = v.port("slip_angle_rear", b * r / rolling - beta)
    F_1, F_2 = v.port("lateral_force_steered_axle", k_1 * alpha_1), k_2 * alpha_2
    force, moment = v.port("external_lateral_force", 0), v.port("external_yaw_moment", 0)
    g_x, g_y = v.port("longitudinal_gravity", 0), v.port("lateral_gravity", 0)
    a_y = v.port("lateral_acceleration", (F_1 + F_2 + force) / v.port("inertial_mass", m))  # (4)
    v.derivative("yaw_rate", v.port("yaw_acceleration", (a * F_1 - b * F_2 + moment) / I_z))  # (1)
    v.derivative("sideslip_angle", (a_y + g_y) / rolling - r)  # (2)
    v.derivative("longitudinal_velocity", v.input("longitudinal_acceleration") + g_x + beta * v_x * r)  # (3)
    v.derivative("cornering_stiffness_front", 0)  # (10)
    v.derivative("cornering_stiffness_rear", 0)
