"""Equations of the blind plant: a tractor-semitrailer and a car as single tracks, and Runge-Kutta around them.

Everything that is compiled stands in this one file, because numba renews its disk cache only when the file of the
compiled function itself changes.

The semitrailer has the velocities ``w_1, w_2`` (yaw rates) and ``q`` (lateral velocity of the kingpin in trailer
axes), which are free: both bodies' velocities follow from them and from the prescribed trailer speed, so there is
no tie to keep and no coupling force among the unknowns (Jourdain's principle; README.md has the derivation).

Axes are those of ISO 8855. Every effect is a parameter whose default is the value at which it is absent.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit
from numba.extending import overload

GRAVITY = 9.81
LOWEST_SPEED = 0.3

# Columns of the inputs, which environment and driver prescribe over time.
INPUTS = (
    "steering_wheel_angle",  # rad, behind play, lag and delay of the steering column
    "speed",  # m/s
    "speed_rate",  # m/s^2
    "gust",  # share of the gust that blows, 0 to 1
    "bank",  # rad, positive where the right side of the road is lower
    "grip",  # factor on the friction
    "shift",  # m, payload displaced to the front
    "stiffness",  # factor on every cornering stiffness
    "moment",  # N m, yaw moment on the steered body from the drivetrain
    "distance",  # m
)
WHEEL, SPEED, SPEED_RATE, GUST, BANK, GRIP, SHIFT, STIFFNESS, MOMENT, DISTANCE = range(len(INPUTS))

OUTPUTS = {
    "semitrailer": (
        "yaw_rate_tractor",
        "yaw_rate_trailer",
        "articulation_angle",
        "lateral_force_axle_21",
        "lateral_acceleration_tractor",  # what an accelerometer in the CoG feels: gravity on a bank included
        "yaw_acceleration_tractor",
        "lateral_velocity_tractor",
        "lateral_velocity_trailer",
        "lateral_force_axle_11",
        "lateral_force_axle_12",
        "lateral_force_axle_22",
        "lateral_force_axle_23",
        "coupling_force",
    ),
    "car": (
        "yaw_rate",
        "lateral_acceleration",  # likewise
        "lateral_velocity",
        "yaw_acceleration",
        "lateral_force_axle_front",
        "lateral_force_axle_rear",
    ),
}
STATES = {"semitrailer": 16, "car": 4}


class Semitrailer(NamedTuple):
    """Parameters in SI units; the first block carries the names and values of the published vehicle."""

    tractor_mass: float = 8420.0
    tractor_yaw_inertia: float = 35000.0
    tractor_cog_to_front_axle: float = 1.175
    tractor_cog_to_rear_axle: float = 2.535
    tractor_cog_to_kingpin: float = 1.935
    trailer_mass: float = 24000.0
    trailer_track: float = 2.165
    trailer_length: float = 13.0
    trailer_inertia_scale: float = 1.0
    kingpin_from_rear: float = 12.0
    axle_21_from_rear: float = 5.67
    axle_22_from_rear: float = 4.32
    axle_23_from_rear: float = 2.97
    trailer_cog_from_rear: float = 7.8
    friction: float = 0.9
    relaxation_length_11: float = 0.4
    relaxation_length_12: float = 0.4
    relaxation_length_2: float = 0.5
    steering_ratio: float = 23.0
    shape_factor_11: float = 1.35
    shape_factor_12: float = 1.30
    shape_factor_2: float = 1.25
    stiffness_peak_11: float = 4.6e5
    stiffness_peak_12: float = 8.5e5
    stiffness_peak_2: float = 2.8e5
    stiffness_load_11: float = 8.0e4
    stiffness_load_12: float = 1.4e5
    stiffness_load_2: float = 6.5e4
    # Effects.
    gust_force_tractor: float = 0.0  # N at the CoG, to the left
    gust_force_trailer: float = 0.0
    gust_moment_tractor: float = 0.0  # N m
    gust_moment_trailer: float = 0.0
    side_force_slope: float = 0.0  # N s^2/m^2 per rad of sideslip, air on the trailer
    steering_compliance: float = 0.0  # rad of the road wheels per N of the front axle
    kingpin_dry_moment: float = 0.0  # N m
    kingpin_damping: float = 0.0  # N m s/rad
    transfer_loss: float = 0.0  # share of an axle's force lost per (a_y/g)^2 to lateral load transfer
    tractor_cog_height: float = 0.0  # m; 0: no longitudinal load transfer
    trailer_cog_height: float = 0.0
    roll_steer_trailer: float = 0.0  # rad per m/s^2, trailer axles steered out of the turn
    self_steering: float = 0.0  # rad/N, last trailer axle yields to its own force
    lift: float = 0.0  # share of the first trailer axle's load taken off by its lift
    force_offset_11: float = 0.0  # N, conicity and ply steer of an axle
    force_offset_12: float = 0.0
    force_offset_2: float = 0.0
    combined_slip: float = 0.0  # weight of the longitudinal force in the friction ellipse
    yaw_control: float = 0.0  # N m s/rad, stability control of the tractor
    slosh_mass: float = 0.0  # kg of the trailer's mass that swings
    slosh_frequency: float = 3.0  # rad/s
    slosh_damping: float = 0.05  # of the critical
    # Effects that the library does not know.
    wheel_moment: float = 0.0  # N m, once per wheel turn
    wheel_radius: float = 0.5  # m
    tyre_memory: float = 0.0  # share of stiffness that a slip angle has at first and then loses
    tyre_memory_time: float = 0.3  # s
    kingpin_cubic: float = 0.0  # N m/rad^3
    scrub_moment: float = 0.0  # N m, twin tyres of the trailer against turning
    scrub_curvature: float = 0.01  # 1/m at which it is nearly full
    baffle_stiffness: float = 0.0  # N/m
    baffle_gap: float = 0.1  # m
    lift_off: float = 0.0  # share of the trailer axles' force that is lost when inner wheels lift
    lift_off_acceleration: float = 1.5  # m/s^2


class Car(NamedTuple):
    """Parameters of the car in SI units; a mid-sized saloon on linear tyres, laid out for this plant."""

    mass: float = 1500.0
    yaw_inertia: float = 2600.0
    cog_to_front_axle: float = 1.25
    cog_to_rear_axle: float = 1.45
    steering_ratio: float = 16.0
    stiffness_peak_front: float = 1.03e5
    stiffness_peak_rear: float = 1.46e5
    stiffness_load_front: float = 1.2e4
    stiffness_load_rear: float = 1.2e4
    # Effects.
    gust_force: float = 0.0
    gust_moment: float = 0.0
    side_force_slope: float = 0.0
    steering_compliance: float = 0.0
    cog_height: float = 0.0
    roll_steer: float = 0.0  # rad per m/s^2, rear axle steered out of the turn
    relaxation_length: float = 0.0  # m; 0: forces follow the slip at once
    force_offset_front: float = 0.0
    force_offset_rear: float = 0.0
    inverse_friction: float = 0.0  # 1 / mu; 0: linear tyres
    yaw_control: float = 0.0
    # Effects that the library does not know.
    wheel_moment: float = 0.0
    wheel_radius: float = 0.3
    tyre_memory: float = 0.0
    tyre_memory_time: float = 0.3


@njit(cache=True, error_model="numpy")
def cornering_stiffness(load: float, peak: float, load_at_peak: float) -> float:
    """Return the slope of force over slip in N/rad at a vertical load (Pacejka and Bakker 1992)."""
    return peak * np.sin(2.0 * np.arctan(load / load_at_peak))


@njit(cache=True, error_model="numpy")
def magic_formula(slip: float, stiffness: float, capacity: float, shape: float) -> float:
    """Return the steady lateral force in N over tan(slip), without curvature factor."""
    return capacity * np.sin(shape * np.arctan(stiffness / (shape * capacity) * np.tan(slip)))


@njit(cache=True, error_model="numpy")
def kinematics(x: np.ndarray, u: np.ndarray, p: Semitrailer) -> tuple[float, float, float, float]:
    """Return v_x1, v_y1 of the tractor's CoG, v_y2 of the trailer's, and kingpin to trailer CoG, a_2."""
    w_1, w_2, q, theta = x[0], x[1], x[2], x[3]
    a_2 = p.kingpin_from_rear - p.trailer_cog_from_rear - u[SHIFT]
    v_x1 = np.cos(theta) * u[SPEED] - np.sin(theta) * q
    v_y1 = np.sin(theta) * u[SPEED] + np.cos(theta) * q + p.tractor_cog_to_kingpin * w_1
    return v_x1, v_y1, q - a_2 * w_2, a_2


@njit(cache=True, error_model="numpy")
def accelerations(
    x: np.ndarray, u: np.ndarray, p: Semitrailer, loads: tuple[float, float, float, float]
) -> tuple[float, float, float, float, float]:
    """Return w_1', w_2', q', and the lateral accelerations of both CoG.

    Args:
        x: States.
        u: Inputs.
        p: Parameters.
        loads: Y_1, N_1, Y_2, N_2: lateral force and yaw moment on each body, all but the coupling force.
    """
    Y_1, N_1, Y_2, N_2 = loads
    v_x1, _, _, a_2 = kinematics(x, u, p)
    h_1, m_1, m_2, J_1 = p.tractor_cog_to_kingpin, p.tractor_mass, p.trailer_mass - p.slosh_mass, p.tractor_yaw_inertia
    J_2 = p.trailer_inertia_scale * p.trailer_mass * (p.trailer_track**2 + p.trailer_length**2) / 12.0
    sin, cos = np.sin(x[3]), np.cos(x[3])
    K_1, K_2 = J_1 + m_1 * h_1**2, J_2 + m_2 * a_2**2
    A_1, A_2 = x[1] * v_x1 + sin * u[SPEED_RATE], x[1] * u[SPEED]
    # Balance of lateral forces at the kingpin, each body seen through its reduced mass m J / K there.
    push = (J_1 * (Y_1 - m_1 * A_1) - m_1 * h_1 * N_1) / (K_1 * cos) + (J_2 * (Y_2 - m_2 * A_2) + m_2 * a_2 * N_2) / K_2
    q_dot = push / (m_1 * J_1 / K_1 + m_2 * J_2 / K_2)
    w_1_dot = (N_1 + h_1 * (Y_1 - m_1 * (A_1 + cos * q_dot))) / K_1
    w_2_dot = (N_2 - a_2 * (Y_2 - m_2 * (A_2 + q_dot))) / K_2
    return w_1_dot, w_2_dot, q_dot, A_1 + cos * q_dot + h_1 * w_1_dot, A_2 + q_dot - a_2 * w_2_dot


@njit(cache=True, error_model="numpy")
def external_loads(
    x: np.ndarray, u: np.ndarray, p: Semitrailer, delta: float, b_2: tuple[float, float, float]
) -> tuple[float, float, float, float]:
    """Return Y_1, N_1, Y_2, N_2 of tyres, air, gravity, stability control, kingpin and swinging load."""
    v_x1, _, v_y2, _ = kinematics(x, u, p)
    a_1, b_1 = p.tractor_cog_to_front_axle, p.tractor_cog_to_rear_axle
    steered, theta, turning = x[4] * np.cos(delta), x[3], x[1] - x[0]
    kingpin = (
        -p.kingpin_dry_moment * np.tanh(turning / 0.002) - p.kingpin_damping * turning - p.kingpin_cubic * theta**3
    )
    reference = v_x1 * delta / (a_1 + b_1) / (1.0 + (v_x1 / 25.0) ** 2)
    stop = max(abs(x[9]) - p.baffle_gap, 0.0) * np.sign(x[9])
    slosh = p.slosh_mass * spring(x[9], x[10], p) + p.baffle_stiffness * stop
    weight = GRAVITY * np.sin(u[BANK])
    Y_1 = steered + x[5] + p.gust_force_tractor * u[GUST] - p.tractor_mass * weight
    N_1 = a_1 * steered - b_1 * x[5] - kingpin + p.gust_moment_tractor * u[GUST] + p.yaw_control * (reference - x[0])
    N_1 += u[MOMENT] + p.wheel_moment * np.sin(u[DISTANCE] / p.wheel_radius)
    Y_2 = x[6] + x[7] + x[8] + p.gust_force_trailer * u[GUST] - (p.trailer_mass - p.slosh_mass) * weight + slosh
    Y_2 -= p.side_force_slope * u[SPEED] * v_y2
    N_2 = kingpin - b_2[0] * x[6] - b_2[1] * x[7] - b_2[2] * x[8] + p.gust_moment_trailer * u[GUST]
    N_2 -= p.scrub_moment * np.tanh(x[1] / max(u[SPEED], LOWEST_SPEED) / p.scrub_curvature)
    return Y_1, N_1, Y_2, N_2


@njit(cache=True, error_model="numpy")
def spring(displacement: float, rate: float, p: Semitrailer) -> float:
    """Return the force on the vessel per kg of swinging liquid."""
    return p.slosh_frequency**2 * displacement + 2.0 * p.slosh_damping * p.slosh_frequency * rate


@njit(cache=True, error_model="numpy")
def vertical_loads(u: np.ndarray, p: Semitrailer, a_2: float, b_22: float) -> tuple[float, float, float, float]:
    """Return the loads of tractor front, tractor rear, first, and each other trailer axle in N."""
    l_1 = p.tractor_cog_to_front_axle + p.tractor_cog_to_rear_axle
    behind = p.tractor_cog_to_rear_axle
    kingpin = p.trailer_mass * (GRAVITY * b_22 - u[SPEED_RATE] * p.trailer_cog_height) / (a_2 + b_22)
    third = (p.trailer_mass * GRAVITY - kingpin) / 3.0
    pitching = p.tractor_mass * (GRAVITY * behind - u[SPEED_RATE] * p.tractor_cog_height)
    front = (pitching + kingpin * (behind - p.tractor_cog_to_kingpin)) / l_1
    rear = p.tractor_mass * GRAVITY + kingpin - front
    return front, rear, max(third * (1.0 - p.lift), 1.0), third * (1.0 + p.lift / 2.0)


@njit(cache=True, error_model="numpy")
def semitrailer_rates(x: np.ndarray, u: np.ndarray, p: Semitrailer, rate: np.ndarray, out: np.ndarray) -> None:
    """Write the time derivative of the states and the outputs.

    States: w_1, w_2, q, articulation angle, five axle forces, displacement and rate of the swinging load, five slip
    angles as the tyres' rubber remembers them.
    """
    v_x1, v_y1, v_y2, a_2 = kinematics(x, u, p)
    cog = p.trailer_cog_from_rear + u[SHIFT]
    b_2 = (cog - p.axle_21_from_rear, cog - p.axle_22_from_rear, cog - p.axle_23_from_rear)
    delta = u[WHEEL] / p.steering_ratio - p.steering_compliance * x[4]
    loads = external_loads(x, u, p, delta, b_2)
    w_1_dot, w_2_dot, q_dot, a_y1, a_y2 = accelerations(x, u, p, loads)
    rate[0], rate[1], rate[2], rate[3] = w_1_dot, w_2_dot, q_dot, x[1] - x[0]
    rate[9] = x[10]
    stop = max(abs(x[9]) - p.baffle_gap, 0.0) * np.sign(x[9])
    rate[10] = -spring(x[9], x[10], p) - a_y2 - GRAVITY * np.sin(u[BANK])
    if p.slosh_mass > 0.0:
        rate[10] -= p.baffle_stiffness * stop / p.slosh_mass

    F_z11, F_z12, F_z21, F_z2 = vertical_loads(u, p, a_2, b_2[1])
    roll_1, roll_2 = max(v_x1, LOWEST_SPEED), max(u[SPEED], LOWEST_SPEED)
    push = (p.tractor_mass + p.trailer_mass) * u[SPEED_RATE] * p.combined_slip
    weight = (p.tractor_mass + p.trailer_mass) * GRAVITY
    lean = p.roll_steer_trailer * a_y2
    lifted = 1.0 - p.lift_off * min(max(abs(a_y2) - p.lift_off_acceleration, 0.0), 1.0)
    for i in range(5):
        if i < 2:
            v_x, a_y, yield_, factor = roll_1, a_y1, 0.0, 1.0
        else:
            v_x, a_y, factor = roll_2, a_y2, lifted
            yield_ = p.self_steering * x[8] if i == 4 else 0.0
        if i == 0:
            slip = delta - np.arctan((v_y1 + p.tractor_cog_to_front_axle * x[0]) / v_x)
            load, peak, at, shape = F_z11, p.stiffness_peak_11, p.stiffness_load_11, p.shape_factor_11
            length, offset = p.relaxation_length_11, p.force_offset_11
        elif i == 1:
            slip = -np.arctan((v_y1 - p.tractor_cog_to_rear_axle * x[0]) / v_x)
            load, peak, at, shape = F_z12, p.stiffness_peak_12, p.stiffness_load_12, p.shape_factor_12
            length, offset = p.relaxation_length_12, p.force_offset_12
        else:
            slip = -np.arctan((v_y2 - b_2[i - 2] * x[1]) / v_x) - lean - yield_
            load = F_z21 if i == 2 else F_z2
            peak, at, shape = p.stiffness_peak_2, p.stiffness_load_2, p.shape_factor_2
            length, offset = p.relaxation_length_2, p.force_offset_2
        fresh = slip - x[11 + i]
        rate[11 + i] = fresh / p.tyre_memory_time
        # Driving pushes at the tractor's rear axle, braking holds at all axles in proportion to their loads.
        X = push * load / weight if push < 0.0 else (push if i == 1 else 0.0)
        grip = p.friction * u[GRIP] * load
        # What is left over of slope and capacity: both fall with the load that moves to the outer wheel, because
        # both grow less than the load does, and by the friction ellipse.
        left_over = np.sqrt(max(1.0 - (X / grip) ** 2, 0.05))
        left_over *= 1.0 - p.transfer_loss * min((a_y / GRAVITY) ** 2, 0.2)
        capacity, slope = grip * left_over, cornering_stiffness(load, peak, at) * u[STIFFNESS] * left_over
        steady = factor * magic_formula(slip + p.tyre_memory * fresh, slope, capacity, shape) + offset
        rate[4 + i] = v_x / length * (steady - x[4 + i])

    out[0], out[1], out[2], out[3] = x[0], x[1], x[3], x[6]
    out[4], out[5], out[6], out[7] = a_y1 + GRAVITY * np.sin(u[BANK]), w_1_dot, v_y1, v_y2
    out[8], out[9], out[10], out[11] = x[4], x[5], x[7], x[8]
    out[12] = loads[2] - (p.trailer_mass - p.slosh_mass) * a_y2


@njit(cache=True, error_model="numpy")
def car_force(slip: float, stiffness: float, load: float, inverse_friction: float) -> float:
    """Return the lateral force of an axle in N: linear in tan(slip), or saturating where friction is finite."""
    if inverse_friction > 0.0:
        return magic_formula(slip, stiffness, load / inverse_friction, 1.3)
    return stiffness * np.tan(slip)


@njit(cache=True, error_model="numpy")
def car_rates(x: np.ndarray, u: np.ndarray, p: Car, rate: np.ndarray, out: np.ndarray) -> None:
    """Write the time derivative of the states and the outputs.

    States: lateral velocity, yaw rate, and the slip angle of each axle as its tyres feel it, which is the slip angle
    itself where neither relaxation nor memory is at work.
    """
    v_y, r, v = x[0], x[1], max(u[SPEED], LOWEST_SPEED)
    a, b, m = p.cog_to_front_axle, p.cog_to_rear_axle, p.mass
    static_front, static_rear = m * GRAVITY * b / (a + b), m * GRAVITY * a / (a + b)
    moved = m * u[SPEED_RATE] * p.cog_height / (a + b)
    C_1 = u[STIFFNESS] * cornering_stiffness(static_front - moved, p.stiffness_peak_front, p.stiffness_load_front)
    C_2 = u[STIFFNESS] * cornering_stiffness(static_rear + moved, p.stiffness_peak_rear, p.stiffness_load_rear)
    delta = u[WHEEL] / p.steering_ratio
    slip_1 = delta - np.arctan((v_y + a * r) / v)
    slip_2 = -np.arctan((v_y - b * r) / v)
    F_1 = F_2 = 0.0
    a_y = 0.0
    # Compliance and roll steer feed forces back to slip angles at once: a contraction, so it is iterated.
    for _ in range(8):
        alpha_1 = slip_1 - p.steering_compliance * F_1
        alpha_2 = slip_2 - p.roll_steer * a_y
        felt_1, felt_2 = alpha_1, alpha_2
        if p.relaxation_length > 0.0:
            felt_1, felt_2 = x[2], x[3]
        elif p.tyre_memory > 0.0:
            felt_1 += p.tyre_memory * (alpha_1 - x[2])
            felt_2 += p.tyre_memory * (alpha_2 - x[3])
        F_1 = car_force(felt_1, C_1, static_front - moved, p.inverse_friction) + p.force_offset_front
        F_2 = car_force(felt_2, C_2, static_rear + moved, p.inverse_friction) + p.force_offset_rear
        a_y = (F_1 * np.cos(delta) + F_2) / m
    keep = v / p.relaxation_length if p.relaxation_length > 0.0 else 1.0 / p.tyre_memory_time
    rate[2], rate[3] = keep * (alpha_1 - x[2]), keep * (alpha_2 - x[3])

    Y = F_1 * np.cos(delta) + F_2 + p.gust_force * u[GUST] - p.side_force_slope * v * v_y
    reference = v * delta / (a + b) / (1.0 + (v / 25.0) ** 2)
    N = a * F_1 * np.cos(delta) - b * F_2 + p.gust_moment * u[GUST] + p.yaw_control * (reference - r)
    N += u[MOMENT] + p.wheel_moment * np.sin(u[DISTANCE] / p.wheel_radius)
    rate[0] = Y / m - GRAVITY * np.sin(u[BANK]) - r * u[SPEED]
    rate[1] = N / p.yaw_inertia
    out[0], out[1], out[2], out[3], out[4], out[5] = r, Y / m, v_y, rate[1], F_1, F_2


def rates(x, u, p, rate, out):  # type: ignore[no-untyped-def]
    """Write derivatives and outputs of whichever vehicle ``p`` describes (resolved when compiling)."""


@overload(rates, inline="never")
def _rates(x, u, p, rate, out):  # type: ignore[no-untyped-def]
    # One integrator for both vehicles: numba can cache neither a function argument nor a closure on disk.
    if p.instance_class is Semitrailer:
        return lambda x, u, p, rate, out: semitrailer_rates(x, u, p, rate, out)
    return lambda x, u, p, rate, out: car_rates(x, u, p, rate, out)


@njit(cache=True, error_model="numpy")
def integrate(x: np.ndarray, u: np.ndarray, p, step: float, out: np.ndarray) -> None:  # type: ignore[no-untyped-def]
    """Integrate by the classical Runge-Kutta method of fourth order.

    Args:
        x: First state ``(nx,)``; overwritten by the last.
        u: Inputs at every half step ``(2 * steps + 1, nu)``.
        p: ``Semitrailer`` or ``Car``.
        step: s.
        out: Outputs before every step and after the last, ``(steps + 1, ny)``; written.
    """
    k_1, k_2, k_3, k_4 = np.empty_like(x), np.empty_like(x), np.empty_like(x), np.empty_like(x)
    aside = np.empty(out.shape[1])
    for k in range(len(out) - 1):
        rates(x, u[2 * k], p, k_1, out[k])
        rates(x + 0.5 * step * k_1, u[2 * k + 1], p, k_2, aside)
        rates(x + 0.5 * step * k_2, u[2 * k + 1], p, k_3, aside)
        rates(x + step * k_3, u[2 * k + 2], p, k_4, aside)
        x += step / 6.0 * (k_1 + 2.0 * k_2 + 2.0 * k_3 + k_4)
    rates(x, u[2 * (len(out) - 1)], p, k_1, out[len(out) - 1])
