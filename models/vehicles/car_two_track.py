"""Two-track car with roll: the plant against which single-track car estimators are tried.

Longitudinal, lateral, yaw and roll motion of a car with a front-steered axle, four wheels with their own load,
slip angle and lateral force. It takes the place of the commercial simulator in Li et al. 2017, and its layout
follows the textbook two-track model with a roll axis (Mitschke and Wallentowitz 2014; the multi-body model of
Althoff and Wuersching 2020 with its masses and springs condensed). What it includes and what it leaves out:

* *Roll.* The sprung mass turns about a roll axis through the roll centres; its height above that axis is ``h``.
  Products of roll angle and yaw rate are left out, pitch and heave are quasi-static.
* *Loads.* Lateral transfer by springs and dampers of the axle, by the roll centres and by the unsprung masses;
  longitudinal transfer by the acceleration that drive and steering ask for. At most ``FULL_TRANSFER`` of the load of
  an axle moves to one side, so that the loads always add up to the weight and none is negative.
* *Combined slip* by the friction ellipse: drive and brake force use the share ``u = F_x / (mu F_z)`` of an axle's
  grip and leave ``sqrt(1 - u^2)`` of each steady lateral force. ``F_x`` approaches its limit by a tangent
  hyperbolic, so the wheels never lock or spin (there are no wheel speeds).
* *Relaxation* of each lateral force over a length rolled (Pacejka 2012, 7.1, for the force itself).
* *Friction* is a state that stays where it starts, unless an effect gives it a rate.
* *Camber*: the wheels lean with the body; the thrust enters as a slip angle of the same effect.
* *Speed.* A proportional controller follows the speed of the drive; with ``speed_gain = 0`` the throttle is
  released and the car rolls out against rolling resistance and air, as the NHTSA procedures prescribe.

Wheels are named ``fl fr rl rr``. Positive roll leans to the right, as in a turn to the left.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import sympy as sp

from harness.models.assembly.expressions import larger, smaller
from harness.models.assembly.model import Body, symbol
from harness.models.contracts import Parameter

if TYPE_CHECKING:
    from harness.models.assembly.assemble import Builder

GRAVITY = 9.81

LOWEST_SPEED = 0.3
"""m/s; slip angles and relaxation use at least this speed, so that a standstill stays finite."""

LOWEST_FRICTION = 0.01
"""The tyres never have less grip."""

LOWEST_LOAD = 100.0
"""N; an axle carries at least this much."""

FULL_TRANSFER = 0.99
"""Largest share of an axle's load that one wheel may take from the other."""

SMALLEST_SLIP = 0.005
"""rad; below it the stiffness that is published goes over into the slope of the tyres at no slip."""

CONSTANTS: dict[str, str] = {"GRAVITY": "m/s^2", "LOWEST_SPEED": "m/s", "LOWEST_LOAD": "N"}

AXLES: dict[str, str] = {"fl": "front", "fr": "front", "rl": "rear", "rr": "rear"}
USUAL: dict[str, str] = {"parameters": "althoff_2020", "sensors": "car_series"}

STATES: tuple[str, ...] = (
    "longitudinal_velocity",
    "lateral_velocity",
    "yaw_rate",
    "roll_angle",
    "roll_rate",
    *(f"lateral_force_axle_{wheel}" for wheel in AXLES),
    "friction_coefficient",
)
INPUTS: tuple[str, ...] = ("steering_wheel_angle", "speed")
START: dict[str, float | str] = {"longitudinal_velocity": "speed", "friction_coefficient": "friction"}

# Beyond these magnitudes the car is spinning or has rolled over.
VALID: dict[str, float] = {
    "longitudinal_velocity": 100.0,
    "lateral_velocity": 40.0,
    "yaw_rate": 5.0,
    "roll_angle": 0.5,
    "roll_rate": 5.0,
    "friction_coefficient": 2.0,
}

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("sprung_mass", "m_s", "kg", 2e2, 5e3, "mass of the body on its springs"),
    Parameter("unsprung_mass_front", r"m_{u1}", "kg", 5.0, 5e2, "front axle with both wheels"),
    Parameter("unsprung_mass_rear", r"m_{u2}", "kg", 5.0, 5e2, "rear axle with both wheels"),
    Parameter("yaw_inertia", "J_z", "kg*m^2", 1e2, 2e4, "yaw inertia of the car"),
    Parameter("roll_inertia", "J_x", "kg*m^2", 10.0, 5e3, "roll inertia of the sprung mass about its own CoG"),
    Parameter("cog_to_front_axle", "a", "m", 0.3, 4.0, "CoG to the front axle"),
    Parameter("cog_to_rear_axle", "b", "m", 0.3, 4.0, "CoG to the rear axle"),
    Parameter("sprung_cog_height", "h_s", "m", 0.1, 2.0, "CoG of the sprung mass above the road"),
    Parameter("unsprung_cog_height", "h_u", "m", 0.1, 1.0, "CoG of the axles above the road (the wheel radius)"),
    Parameter("roll_centre_front", "h_1", "m", -0.2, 0.8, "height of the front roll centre"),
    Parameter("roll_centre_rear", "h_2", "m", -0.2, 0.8, "height of the rear roll centre"),
    Parameter("track_front", "T_1", "m", 0.8, 2.5, "front track width"),
    Parameter("track_rear", "T_2", "m", 0.8, 2.5, "rear track width"),
    Parameter("roll_stiffness_front", "K_1", "N*m/rad", 1e3, 1e8, "front roll stiffness, springs, bar and tyres"),
    Parameter("roll_stiffness_rear", "K_2", "N*m/rad", 1e3, 1e8, "rear roll stiffness, springs, bar and tyres"),
    Parameter("roll_damping_front", "D_1", "N*m*s/rad", 0.0, 1e6, "front roll damping"),
    Parameter("roll_damping_rear", "D_2", "N*m*s/rad", 0.0, 1e6, "rear roll damping"),
    Parameter("camber_per_roll_front", r"c_{\gamma1}", "dimensionless", -1.5, 1.5, "camber over roll angle, front"),
    Parameter("camber_per_roll_rear", r"c_{\gamma2}", "dimensionless", -1.5, 1.5, "camber over roll angle, rear"),
    Parameter("camber_thrust", r"\kappa_\gamma", "dimensionless", 0.0, 0.3, "slip angle that one camber angle equals"),
    Parameter("friction", r"\mu_0", "dimensionless", 0.05, 1.5, "largest force over load at the start"),
    Parameter("relaxation_length", r"\ell", "m", 0.01, 2.0, "distance over which a lateral force builds up"),
    Parameter("steering_ratio", r"i_\mathrm{L}", "dimensionless", 5.0, 40.0, "steering wheel over road wheel angle"),
    Parameter("speed_gain", "k_v", "1/s", 0.0, 20.0, "gain of the speed controller; 0 releases the throttle"),
    Parameter("driving_share_front", r"\lambda_D", "dimensionless", 0.0, 1.0, "share of the drive at the front axle"),
    Parameter("braking_share_front", r"\lambda_B", "dimensionless", 0.0, 1.0, "share of braking at the front axle"),
    Parameter("rolling_resistance", "c_R", "dimensionless", 0.0, 0.1, "rolling resistance over weight"),
    Parameter("air_drag", "c_A", "N*s^2/m^2", 0.0, 5.0, "air resistance over speed squared"),
)


def check(values: dict[str, float]) -> list[tuple[str, str]]:
    """Return ``(parameter, what is wrong)`` for values that are each in bounds but impossible together."""
    length = values["cog_to_front_axle"] + values["cog_to_rear_axle"]
    axis = (
        values["roll_centre_front"] * values["cog_to_rear_axle"]
        + values["roll_centre_rear"] * values["cog_to_front_axle"]
    ) / length
    arm = values["sprung_cog_height"] - axis
    wrong = []
    if arm <= 0:
        wrong.append(("sprung_cog_height", f"the CoG lies {-arm:g} m below the roll axis, so the car leans inwards"))
    need = values["sprung_mass"] * GRAVITY * arm
    stiffness = values["roll_stiffness_front"] + values["roll_stiffness_rear"]
    if stiffness <= need:
        wrong.append(
            (
                "roll_stiffness_front",
                f"both axles give {stiffness:g} N*m/rad, but the weight alone needs {need:g} N*m/rad not to fall over",
            )
        )
    return wrong


def wheelbase(values: dict[str, float]) -> float:
    """Return the wheelbase in m (for the limits of the drives)."""
    return values["cog_to_front_axle"] + values["cog_to_rear_axle"]


def equations(v: Builder) -> None:
    """State the differential equations (``docs/cars.md`` derives them)."""
    m_s, m_u1, m_u2 = v.p("sprung_mass"), v.p("unsprung_mass_front"), v.p("unsprung_mass_rear")
    m = m_s + m_u1 + m_u2
    a, b = v.p("cog_to_front_axle"), v.p("cog_to_rear_axle")
    T_1, T_2 = v.p("track_front"), v.p("track_rear")
    v_x, v_y, r = v.state("longitudinal_velocity"), v.state("lateral_velocity"), v.state("yaw_rate")
    F = {wheel: v.state(f"lateral_force_axle_{wheel}") for wheel in AXLES}
    mu = larger(v.state("friction_coefficient"), LOWEST_FRICTION)
    v.derivative("friction_coefficient", v.port("friction_rate", 0))
    delta = v.port("road_wheel_angle", v.input("steering_wheel_angle") / v.p("steering_ratio"))
    sin, cos = sp.sin(delta), sp.cos(delta)

    v.body("", Body(v_x, v_y, r, m, a + b))
    front, rear = v.port("lateral_force_steered_axle", F["fl"] + F["fr"]), F["rl"] + F["rr"]
    asked = v.port("driving_force", m * v.p("speed_gain") * (v.input("speed") - v_x))
    available = mu * m * GRAVITY
    X_asked = available * sp.tanh(asked / available)
    Y_asked = front * cos + rear  # the lateral force but for what drive and brakes add at steered wheels
    load = _loads(v, m, (X_asked - front * sin) / m, Y_asked / m)
    drive, left_over = _drive(v, mu, X_asked)

    v_left, v_right = v_x - r * T_1 / 2, v_x + r * T_1 / 2
    rolling = {"fl": v_left, "fr": v_right, "rl": v_x - r * T_2 / 2, "rr": v_x + r * T_2 / 2}
    rolling = {wheel: larger(speed, LOWEST_SPEED) for wheel, speed in rolling.items()}
    lean = v.p("camber_thrust") * v.state("roll_angle")
    for wheel, end in AXLES.items():
        sideways, steer = (v_y + a * r, delta) if end == "front" else (v_y - b * r, 0)
        slip = steer - sp.atan(sideways / rolling[wheel]) - lean * v.p(f"camber_per_roll_{end}")
        camber = v.p(f"camber_per_roll_{end}") * v.state("roll_angle")
        steady = v.tyre(wheel, slip, load[wheel], mu, camber) * left_over[end]
        v.derivative(f"lateral_force_axle_{wheel}", rolling[wheel] / v.p("relaxation_length") * (steady - F[wheel]))

    resistance = v.p("rolling_resistance") * m * GRAVITY * sp.tanh(v_x / LOWEST_SPEED) + v.p("air_drag") * v_x * sp.Abs(
        v_x
    )
    X_1, X_2 = drive["fl"] + drive["fr"], drive["rl"] + drive["rr"]
    push, shove = v.port("external_longitudinal_force", 0), v.port("external_lateral_force", 0)
    X = X_1 * cos - front * sin + X_2 - resistance + push
    Y = front * cos + X_1 * sin + rear + shove
    N = (
        a * (front * cos + X_1 * sin)
        - b * rear
        + T_1 / 2 * ((drive["fr"] - drive["fl"]) * cos + (F["fl"] - F["fr"]) * sin)
        + T_2 / 2 * (drive["rr"] - drive["rl"])
        + v.port("external_yaw_moment", 0)
    )
    a_x = v.port("longitudinal_acceleration", X / m)
    v.port("lateral_acceleration", Y / m)
    v.derivative("longitudinal_velocity", a_x + v.port("longitudinal_gravity", 0) + r * v_y)
    v.derivative("yaw_rate", v.port("yaw_acceleration", N / v.p("yaw_inertia")))
    _roll(v, m, Y, shove)
    forward = larger(v_x, LOWEST_SPEED)
    _publish(v, "front", delta - sp.atan((v_y + a * r) / forward), front)
    _publish(v, "rear", -sp.atan((v_y - b * r) / forward), rear)
    v.port("sideslip_angle", sp.atan(v_y / forward))


def _arm(v: Builder) -> sp.Expr:
    """Return the height of the sprung CoG above the roll axis in m."""
    a, b = v.p("cog_to_front_axle"), v.p("cog_to_rear_axle")
    return v.p("sprung_cog_height") - (b * v.p("roll_centre_front") + a * v.p("roll_centre_rear")) / (a + b)


def _loads(v: Builder, m: sp.Expr, a_x: sp.Expr, a_y: sp.Expr) -> dict[str, sp.Expr]:
    """Return the vertical load of each wheel in N; they add up to the weight."""
    a, b, h_u = v.p("cog_to_front_axle"), v.p("cog_to_rear_axle"), v.p("unsprung_cog_height")
    m_s, phi, phi_dot = v.p("sprung_mass"), v.state("roll_angle"), v.state("roll_rate")
    pitching = a_x * (m_s * v.p("sprung_cog_height") + (m - m_s) * h_u) / (a + b)
    loads: dict[str, sp.Expr] = {}
    for end, lever, sign in (("front", b, -1), ("rear", a, 1)):
        m_u, share = v.p(f"unsprung_mass_{end}"), m_s * lever / (a + b)
        axle = larger((share + m_u) * GRAVITY + sign * pitching, LOWEST_LOAD)
        moment = (
            v.p(f"roll_stiffness_{end}") * phi
            + v.p(f"roll_damping_{end}") * phi_dot
            + a_y * (share * v.p(f"roll_centre_{end}") + m_u * h_u)
        )
        most = axle / 2 * FULL_TRANSFER
        moved = larger(smaller(moment / v.p(f"track_{end}"), most), -most)
        loads[f"{end[0]}l"], loads[f"{end[0]}r"] = axle / 2 - moved, axle / 2 + moved
    return loads


def _drive(v: Builder, mu: sp.Expr, asked: sp.Expr) -> tuple[dict[str, sp.Expr], dict[str, sp.Expr]]:
    """Return the longitudinal force of each wheel in N, and what it leaves of an axle's lateral force."""
    driving, braking = v.p("driving_share_front"), v.p("braking_share_front")
    share = braking + (driving - braking) * sp.Heaviside(asked, 0)
    force: dict[str, sp.Expr] = {}
    left_over: dict[str, sp.Expr] = {}
    for end, part in (("front", share), ("rear", 1 - share)):
        load_left, load_right = (symbol(f"vertical_load_axle_{end[0]}{side}") for side in "lr")
        z = part * asked / (mu * (load_left + load_right))
        used = sp.tanh(z)
        force[f"{end[0]}l"], force[f"{end[0]}r"] = mu * load_left * used, mu * load_right * used
        left_over[end] = 2 / (sp.exp(z) + sp.exp(-z))  # sqrt(1 - tanh(z)^2), smooth where nothing is left
    return force, left_over


def _roll(v: Builder, m: sp.Expr, Y: sp.Expr, shove: sp.Expr) -> None:
    """State lateral and roll acceleration, which are coupled by the mass above the roll axis."""
    m_s, h = v.p("sprung_mass"), _arm(v)
    phi, phi_dot = v.state("roll_angle"), v.state("roll_rate")
    J = v.p("roll_inertia") + m_s * h**2
    restoring = (
        m_s * GRAVITY * h * sp.sin(phi)
        - (v.p("roll_stiffness_front") + v.p("roll_stiffness_rear")) * phi
        - (v.p("roll_damping_front") + v.p("roll_damping_rear")) * phi_dot
        - h * shove
    )
    # m A - m_s h phi'' = Y and J phi'' = m_s h A + restoring, with A the acceleration of the roll axis less gravity.
    A = (Y + m_s * h * restoring / J) / (m - (m_s * h) ** 2 / J)
    gained = A + v.port("lateral_gravity", 0)
    v.derivative("lateral_velocity", gained - v.state("yaw_rate") * v.state("longitudinal_velocity"))
    v.derivative("roll_angle", phi_dot)
    v.derivative("roll_rate", (m_s * h * A + restoring) / J)


def _publish(v: Builder, end: str, slip: sp.Expr, force: sp.Expr) -> None:
    """Publish the slip angle of an axle and the stiffness that a single-track model would need for its force.

    That stiffness is force over slip angle; near no slip, where the quotient is noise, it goes over into the slope
    of the tyres, ``(F alpha + C alpha_0^2) / (alpha^2 + alpha_0^2)``.
    """
    alpha = v.port(f"slip_angle_{end}", slip)
    slopes = [f"cornering_stiffness_axle_{end[0]}{side}" for side in "lr"]
    if set(slopes) <= set(v.ports):  # a tyre may publish none
        slope = symbol(slopes[0]) + symbol(slopes[1])
        stiffness = (force * alpha + slope * SMALLEST_SLIP**2) / (alpha**2 + SMALLEST_SLIP**2)
        v.port(f"cornering_stiffness_{end}", stiffness)
