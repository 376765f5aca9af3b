"""Tractor-semitrailer, single-track lateral dynamics with prescribed trailer speed (Ziaukas 2023, ch. 4).

States 4.20, inputs 4.21. Signs and factors that the print has wrong are put right from the free-body diagram
(slip angles 4.12 and 4.13, axle loads 4.14 to 4.16, yaw inertia of table 4.3); ``tests/models`` checks them
against an independent derivation.

Two things go beyond the print, both switched by a parameter or vanishing at constant speed:

* The lateral velocities of both bodies are tied by the kingpin (4.17 and 4.18 together say
  ``v_y1 - h_1 w_1 = cos(theta) (v_y2 + a_2 w_2) + sin(theta) v_x2``), so one of the ten states is redundant. The
  coupling force is found from the time derivative of that tie, which lets process noise and integration errors
  make it drift. ``constraint_rate`` pulls the violation back at that rate (Baumgarte 1972); 0 gives the
  equations as printed.
* The tie's derivative contains the derivative of the speed; the harness takes it from the speed's samples.
"""

from __future__ import annotations

from math import pi
from typing import TYPE_CHECKING, Any

import sympy as sp

from harness.common.errors import ModelError
from harness.models.assembly.expressions import larger
from harness.models.assembly.model import Body, symbol
from harness.models.contracts import Parameter

if TYPE_CHECKING:
    from harness.models.assembly.assemble import Builder

GRAVITY = 9.81

STATES: tuple[str, ...] = (
    "lateral_velocity_tractor",
    "yaw_rate_tractor",
    "lateral_velocity_trailer",
    "yaw_rate_trailer",
    "articulation_angle",
    "lateral_force_axle_11",
    "lateral_force_axle_12",
    "lateral_force_axle_21",
    "lateral_force_axle_22",
    "lateral_force_axle_23",
)
INPUTS: tuple[str, ...] = ("steering_wheel_angle", "speed")

# Axle -> group of tyre parameters: the three trailer axles share one (Ziaukas 2023, 4.2.2).
AXLES: dict[str, str] = {"11": "11", "12": "12", "21": "2", "22": "2", "23": "2"}
USUAL: dict[str, str] = {"parameters": "ziaukas_2023", "sensors": "series"}

BODIES: dict[str, tuple[str, ...]] = {"tractor": ("11", "12"), "trailer": ("21", "22", "23")}

# Beyond these magnitudes the single-track equations say nothing about a truck: a run that goes there diverged.
VALID: dict[str, float] = {
    "articulation_angle": 0.48 * pi,
    "lateral_velocity_tractor": 30.0,
    "lateral_velocity_trailer": 30.0,
    "yaw_rate_tractor": 5.0,
    "yaw_rate_trailer": 5.0,
}

LOWEST_SPEED = 0.3
"""m/s; slip angles and relaxation use at least this speed, so that a standstill in a recording stays finite."""

CONSTANTS: dict[str, str] = {"GRAVITY": "m/s^2", "LOWEST_SPEED": "m/s"}
"""Units of this file's constants that have one, for the check of dimensions in ``tests/contracts``."""

PARAMETERS: tuple[Parameter, ...] = (
    Parameter("tractor_mass", "m_1", "kg", 2e3, 3e4, "mass of the tractor"),
    Parameter("tractor_yaw_inertia", "J_1", "kg*m^2", 2e3, 3e5, "yaw inertia of the tractor"),
    Parameter("tractor_cog_to_front_axle", "a_1", "m", 0.1, 6.0, "CoG of the tractor to its front axle"),
    Parameter("tractor_cog_to_rear_axle", "b_1", "m", 0.1, 6.0, "CoG of the tractor to its rear axle"),
    Parameter("tractor_cog_to_kingpin", "h_1", "m", 0.0, 6.0, "CoG of the tractor back to the kingpin"),
    Parameter("trailer_mass", "m_2", "kg", 1e3, 6e4, "mass of the trailer with its load"),
    Parameter("trailer_track", r"\ell_\mathrm{track}", "m", 1.0, 3.0, "track width of the trailer"),
    Parameter("trailer_length", r"\ell_2", "m", 4.0, 25.0, "length of the trailer"),
    Parameter("trailer_inertia_scale", r"\kappa_{J2}", "dimensionless", 0.2, 10.0, "yaw inertia over that of a box"),
    Parameter("kingpin_from_rear", r"a_{2,\mathrm{RW}}", "m", 2.0, 25.0, "rear wall to the kingpin"),
    Parameter("axle_21_from_rear", r"b_{21,\mathrm{RW}}", "m", 0.0, 20.0, "rear wall to the first trailer axle"),
    Parameter("axle_22_from_rear", r"b_{22,\mathrm{RW}}", "m", 0.0, 20.0, "rear wall to the second trailer axle"),
    Parameter("axle_23_from_rear", r"b_{23,\mathrm{RW}}", "m", 0.0, 20.0, "rear wall to the third trailer axle"),
    Parameter("trailer_cog_from_rear", r"x_\mathrm{CoG}", "m", 0.5, 24.0, "rear wall to the CoG of the trailer"),
    Parameter(
        "friction", r"\mu_\mathrm{max}", "dimensionless", 0.05, 1.5, "largest friction, all axles", natural=(0.3, 0.6)
    ),
    Parameter("relaxation_length_11", r"\ell_{R11}", "m", 0.01, 2.0, "relaxation length, tractor front"),
    Parameter("relaxation_length_12", r"\ell_{R12}", "m", 0.01, 2.0, "relaxation length, tractor rear"),
    Parameter("relaxation_length_2", r"\ell_{R2}", "m", 0.01, 2.0, "relaxation length, trailer axles"),
    Parameter("steering_ratio", r"i_\mathrm{L}", "dimensionless", 5.0, 40.0, "steering wheel over road wheel angle"),
    Parameter(
        "constraint_rate",
        r"\kappa",
        "1/s",
        0.0,
        50.0,
        "rate that restores the kingpin tie; 0 as printed",
        numerical=True,
    ),
)

LOADING: tuple[Parameter, ...] = (
    Parameter("payload_mass", "m_L", "kg", 0.0, 5e4, "mass of the load on the trailer"),
    Parameter("payload_from_rear", r"x_L", "m", 0.0, 24.0, "rear wall to the CoG of the load"),
)
"""What a study may vary in place of mass, CoG and inertia of the trailer, which follow from it together."""

EMPTY_MASS = 7500.0
"""kg; the trailer without load, the lightest of the mass study (Ziaukas 2023, 5.4.2)."""

EMPTY_COG_FROM_REAR = 6.2
"""m; chosen by this project: a quarter of the empty trailer's weight rests on the kingpin."""


def _is_number(value: Any) -> bool:
    return not isinstance(value, sp.Basic)


def loading(values: dict[str, Any]) -> dict[str, Any]:
    """Return the load, by ``LOADING``, with which the empty trailer has the stated mass and CoG."""
    payload = values["trailer_mass"] - EMPTY_MASS
    if _is_number(payload) and payload <= 0.0:
        raise ModelError(
            f"trailer_mass is {values['trailer_mass']:g} kg, no more than the empty trailer's {EMPTY_MASS:g} kg: there "
            "is no load to vary; state a heavier trailer, or vary trailer_mass itself"
        )
    moment = values["trailer_mass"] * values["trailer_cog_from_rear"] - EMPTY_MASS * EMPTY_COG_FROM_REAR
    return {"payload_mass": payload, "payload_from_rear": moment / payload}


def loaded(values: dict[str, Any], load: dict[str, Any]) -> dict[str, Any]:
    """Return mass, CoG and inertia scale of the trailer under another load: numbers, arrays of one shape, expressions.

    Two bodies, the empty trailer and the load, are put together by the parallel-axis theorem. The empty trailer has
    the inertia of a box of its length and track; the load keeps the radius of gyration about its own CoG that the
    stated trailer leaves for it, so the stated load gives back the stated trailer.
    """
    of_box = (values["trailer_track"] ** 2 + values["trailer_length"] ** 2) / 12
    stated = loading(values)

    def about_cog(load: dict[str, Any]) -> Any:
        distance = load["payload_from_rear"] - EMPTY_COG_FROM_REAR
        return (
            EMPTY_MASS * of_box + EMPTY_MASS * load["payload_mass"] / (EMPTY_MASS + load["payload_mass"]) * distance**2
        )

    inertia = values["trailer_inertia_scale"] * values["trailer_mass"] * of_box
    gyration_squared = (inertia - about_cog(stated)) / stated["payload_mass"]
    if _is_number(gyration_squared) and gyration_squared <= 0.0:
        raise ModelError(
            f"trailer_inertia_scale {values['trailer_inertia_scale']:g} leaves no inertia for the load of "
            f"{stated['payload_mass']:g} kg; state a larger one"
        )
    mass = EMPTY_MASS + load["payload_mass"]
    moment = EMPTY_MASS * EMPTY_COG_FROM_REAR + load["payload_mass"] * load["payload_from_rear"]
    return {
        "trailer_mass": mass,
        "trailer_cog_from_rear": moment / mass,
        "trailer_inertia_scale": (about_cog(load) + load["payload_mass"] * gyration_squared) / (mass * of_box),
    }


def check(values: dict[str, float]) -> list[tuple[str, str]]:
    """Return ``(parameter, what is wrong)`` for values that are each in bounds but impossible together."""
    wrong = []
    cog, kingpin = values["trailer_cog_from_rear"], values["kingpin_from_rear"]
    if kingpin > values["trailer_length"]:
        wrong.append(("kingpin_from_rear", f"{kingpin:g} m lies outside the trailer of {values['trailer_length']:g} m"))
    if not values["axle_22_from_rear"] < cog < kingpin:
        wrong.append(
            (
                "trailer_cog_from_rear",
                f"{cog:g} m must lie between the middle axle ({values['axle_22_from_rear']:g} m) and the kingpin "
                f"({kingpin:g} m), or an axle or the kingpin would lift",
            )
        )
    if values["tractor_cog_to_kingpin"] > values["tractor_cog_to_rear_axle"] + values["tractor_cog_to_front_axle"]:
        wrong.append(("tractor_cog_to_kingpin", "the kingpin lies more than a wheelbase behind the CoG"))
    return wrong


def wheelbase(values: dict[str, float]) -> float:
    """Return the wheelbase of the steered body in m (for the limits of the drives)."""
    return values["tractor_cog_to_front_axle"] + values["tractor_cog_to_rear_axle"]


def outline(values: dict[str, float]) -> dict[str, tuple[float, float, float]]:
    """Return where a body ends behind and ahead of its CoG and its width, in m; the source has those of the trailer."""
    cog = values["trailer_cog_from_rear"]
    return {"trailer": (-cog, values["trailer_length"] - cog, values["trailer_track"])}


def equations(v: Builder) -> None:
    """State the differential equations (Ziaukas 2023, 4.7 to 4.19 with the corrections named above)."""
    m_1, J_1 = v.p("tractor_mass"), v.p("tractor_yaw_inertia")
    a_1, b_1, h_1 = (
        v.p("tractor_cog_to_front_axle"),
        v.p("tractor_cog_to_rear_axle"),
        v.p("tractor_cog_to_kingpin"),
    )
    m_2 = v.p("trailer_mass")
    x_cog = v.p("trailer_cog_from_rear") + v.port("cog_shift_trailer", 0)
    a_2 = v.p("kingpin_from_rear") - x_cog
    b_2 = {axle: x_cog - v.p(f"axle_{axle}_from_rear") for axle in ("21", "22", "23")}
    J_2 = v.p("trailer_inertia_scale") * m_2 * (v.p("trailer_track") ** 2 + v.p("trailer_length") ** 2) / 12

    v_y1, w_1 = v.state("lateral_velocity_tractor"), v.state("yaw_rate_tractor")
    v_y2, w_2 = v.state("lateral_velocity_trailer"), v.state("yaw_rate_trailer")
    theta = v.state("articulation_angle")
    v_x2 = v.port("speed_over_ground", v.input("speed"))
    sin, cos = sp.sin(theta), sp.cos(theta)
    v.body("tractor", Body(symbol("speed_tractor"), v_y1, w_1, m_1, a_1 + b_1))
    v.body("trailer", Body(v_x2, v_y2, w_2, m_2, a_2 + b_2["22"]))
    # Lateral velocity of the kingpin in trailer axes; the CoG of a trailer that rolls sways over it.
    v_k2 = v_y2 + a_2 * w_2 + v.port("coupling_sway_trailer", 0)
    v_x1 = v.port("speed_tractor", cos * v_x2 - sin * v_k2)  # (4.18)
    delta = v.port("road_wheel_angle", v.input("steering_wheel_angle") / v.p("steering_ratio"))

    roll_1, roll_2 = larger(v_x1, LOWEST_SPEED), larger(v_x2, LOWEST_SPEED)
    slip = {
        "11": delta - sp.atan((v_y1 + a_1 * w_1) / roll_1),  # (4.12), sign of the yaw rate corrected
        "12": -sp.atan((v_y1 - b_1 * w_1) / roll_1),
        **{axle: -sp.atan((v_y2 - b * w_2) / roll_2) for axle, b in b_2.items()},  # (4.13), likewise
    }
    load = _vertical_loads(v, m_1, m_2, a_1, b_1, h_1, a_2, b_2)
    mu = v.port("friction_coefficient", v.p("friction"))
    F = {axle: v.state(f"lateral_force_axle_{axle}") for axle in AXLES}
    for axle in AXLES:
        length = v.p(f"relaxation_length_{AXLES[axle]}")
        steady = v.tyre(axle, slip[axle], load[axle], mu)
        v.derivative(f"lateral_force_axle_{axle}", (roll_1 if axle[0] == "1" else roll_2) / length * (steady - F[axle]))

    # Lateral force and yaw moment on each body, everything but the coupling force (4.8 to 4.11).
    moment = v.port("coupling_moment", 0)
    m_1, m_2 = v.port("inertial_mass_tractor", m_1), v.port("inertial_mass_trailer", m_2)
    g_1, g_2 = v.port("lateral_gravity_tractor", 0), v.port("lateral_gravity_trailer", 0)
    for body in BODIES:
        v.port(f"longitudinal_gravity_{body}", 0)
    steered = v.port("lateral_force_steered_axle", F["11"]) * sp.cos(delta)
    Y_1 = steered + F["12"] + v.port("external_lateral_force_tractor", 0)
    N_1 = a_1 * steered - b_1 * F["12"] - moment + v.port("external_yaw_moment_tractor", 0)
    Y_2 = F["21"] + F["22"] + F["23"] + v.port("external_lateral_force_trailer", 0)
    N_2 = moment + v.port("external_yaw_moment_trailer", 0) - sum(b * F[axle] for axle, b in b_2.items())

    # The kingpin tie and its derivative, solved for the coupling force H along the trailer's y axis.
    violation = v.port("constraint_violation", cos * v_k2 + sin * v_x2 - (v_y1 - h_1 * w_1))
    compliance = 1 / m_1 + h_1**2 / J_1 + 1 / m_2 + a_2**2 / J_2
    free = (
        cos * (Y_2 / m_2 + g_2 + a_2 * N_2 / J_2)
        - (Y_1 / m_1 + g_1 - h_1 * N_1 / J_1)
        + cos * v.port("coupling_sway_rate_trailer", 0)
        - sin * w_2 * v_k2
        + sin * v.port("speed_over_ground_rate", v.rate("speed"))
        + v.p("constraint_rate") * violation
    )
    H = v.port("coupling_force", free / (cos * compliance))

    a_y1 = v.port("lateral_acceleration_tractor", (Y_1 + H * cos) / m_1)
    a_y2 = v.port("lateral_acceleration_trailer", (Y_2 - H) / m_2)
    v.derivative("lateral_velocity_tractor", a_y1 + g_1 - w_1 * v_x1)  # (4.8)
    v.derivative("yaw_rate_tractor", v.port("yaw_acceleration_tractor", (N_1 - h_1 * H * cos) / J_1))  # (4.9)
    v.derivative("lateral_velocity_trailer", a_y2 + g_2 - w_2 * v_x2)  # (4.10)
    v.derivative("yaw_rate_trailer", v.port("yaw_acceleration_trailer", (N_2 - a_2 * H) / J_2))  # (4.11)
    v.derivative("articulation_angle", w_2 - w_1)  # (4.19)


def _vertical_loads(
    v: Builder,
    m_1: sp.Expr,
    m_2: sp.Expr,
    a_1: sp.Expr,
    b_1: sp.Expr,
    h_1: sp.Expr,
    a_2: sp.Expr,
    b_2: dict[str, sp.Expr],
) -> dict[str, sp.Expr]:
    """Return the axle loads in N (4.14 to 4.16, corrected so that they add up to the weight).

    The trailer's axles stand on one bogie that loads them alike, as if in its middle. An effect may take an axle's
    share of the load away, which moves that point, or add a pitch moment, which moves load to the front of a body.
    """
    l_1, e_1 = a_1 + b_1, b_1 - h_1
    share = {axle: v.port(f"load_share_axle_{axle}", 1) for axle in b_2}
    pitch_1, pitch_2 = v.port("pitch_moment_tractor", 0), v.port("pitch_moment_trailer", 0)
    total = sum(share.values())
    b_22 = b_2["22"] + sum((share[axle] - 1) * (b - b_2["22"]) for axle, b in b_2.items()) / total
    l_2 = a_2 + b_22
    kingpin = (m_2 * GRAVITY * b_22 + pitch_2) / l_2
    trailer = (m_2 * GRAVITY * a_2 - pitch_2) / l_2
    return {
        "11": m_1 * GRAVITY * b_1 / l_1 + kingpin * e_1 / l_1 + pitch_1 / l_1,
        "12": m_1 * GRAVITY * a_1 / l_1 + kingpin * (l_1 - e_1) / l_1 - pitch_1 / l_1,
        **{axle: trailer * share[axle] / total for axle in b_2},
    }
