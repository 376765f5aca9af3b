"""The equations of a tractor-semitrailer in the plane: two rigid bodies on brush tyres, and Runge-Kutta around them.

Unknown are the accelerations of the tractor's CoG along and across it, both yaw accelerations and the tractor's thrust.
The trailer's CoG follows from the kingpin, so virtual work leaves no coupling force among the unknowns. Each body is
propelled and braked by itself: the thrust is such that the kingpin carries no force along the trailer, whose speed
follows the driver's.

Axes are those of ISO 8855: x forward, y to the left, angles positive to the left; the articulation angle is the
trailer's yaw angle less the tractor's. Everything that is compiled stands in this one file, because numba renews its
disk cache only when the file of the compiled function itself changes.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]

GRAVITY = 9.81
"""m/s^2."""

STEP = 1e-3
"""s; step of the integration, whose inputs are given at half steps as well."""

SPEED_GAIN = 1.5
"""1/s; how hard the driver corrects the speed."""

LOWEST_SPEED = 1.0
"""m/s; slip angles of a slower wheel are those at this speed."""

SLIDING = 1.0
"""N; an axle that can carry less than this carries nothing."""

SWIVEL_TIME = 0.08
"""s; in which trailing wheels swivel to where their axle goes."""

FRICTION_CHANGES_IN = 0.6
"""s; in which the road's friction changes."""

AXLES = ("11", "12", "21", "22", "23")
"""Front and drive axle of the tractor, axles of the trailer from the front."""

PUBLISHED = {
    "tractor_mass": 8420.0,
    "tractor_yaw_inertia": 35000.0,
    "tractor_cog_to_front_axle": 1.175,
    "tractor_cog_to_rear_axle": 2.535,
    "tractor_cog_to_kingpin": 1.935,
    "trailer_mass": 24000.0,
    "trailer_track": 2.165,
    "trailer_length": 13.0,
    "kingpin_from_rear": 12.0,
    "axle_21_from_rear": 5.67,
    "axle_22_from_rear": 4.32,
    "axle_23_from_rear": 2.97,
    "trailer_cog_from_rear": 7.8,
    "friction": 0.9,
    "relaxation_length_11": 0.4,
    "relaxation_length_12": 0.4,
    "relaxation_length_2": 0.5,
    "steering_ratio": 23.0,
    "stiffness_peak_11": 4.6e5,
    "stiffness_load_11": 8.0e4,
    "stiffness_peak_12": 8.5e5,
    "stiffness_load_12": 1.4e5,
    "stiffness_peak_2": 2.8e5,
    "stiffness_load_2": 6.5e4,
}
"""What is published about the vehicle, in SI units (Ziaukas 2023)."""

WHEEL, SPEED, SPEED_RATE, SIDE_FORCE, YAW_MOMENT, BANK = range(6)
"""Columns of the inputs: steering wheel (rad), the trailer's speed (m/s) and its rate (m/s^2), wind on the trailer (N
and N m)."""

OUTPUTS = (
    "speed",
    "yaw_rate_tractor",
    "yaw_rate_trailer",
    "articulation_angle",
    "lateral_acceleration_tractor",
    "lateral_acceleration_trailer",
)
"""Columns of the outputs, in SI units: the trailer's speed, and what accelerometers in both CoGs feel."""

# States: velocities of the tractor's CoG, both yaw rates, articulation angle, lateral forces of the axles (N), angle of
# the front wheels behind their lag, and how far trailing wheels of the last axle have swivelled.
_ALONG, _ACROSS, _R1, _R2, _THETA, _F11, _F12, _F21, _F22, _F23, _FRONT_WHEELS, _SWIVELLED = range(12)


class Truck(NamedTuple):
    """Parameters of the equations in SI units; an effect is absent where it has its default."""

    tractor_mass: float
    tractor_yaw_inertia: float
    front_axle: float  # m ahead of the tractor's CoG
    drive_axle: float  # m behind the tractor's CoG
    kingpin: float  # m behind the tractor's CoG
    trailer_mass: float
    trailer_yaw_inertia: float
    trailer_kingpin: float  # m ahead of the trailer's CoG
    axle_21: float  # m behind the trailer's CoG
    axle_22: float
    axle_23: float
    stiffness_11: float  # N/rad
    stiffness_12: float
    stiffness_21: float
    stiffness_22: float
    stiffness_23: float
    load_11: float  # N
    load_12: float
    load_21: float
    load_22: float
    load_23: float
    relaxation_11: float  # m
    relaxation_12: float
    relaxation_2: float
    friction: float
    steering_ratio: float
    steering_lag: float = 0.0  # s
    bank: float = 0.0  # rad, left side of the road higher
    self_steering: float = 0.0  # share of the slip angle that trailing wheels of the last axle lose
    forced_steering: float = 0.0  # steer angle of the last axle over the articulation angle
    locked_differential: float = 0.0  # N m^2; yaw moment against the tractor's curvature
    later_friction: float = 0.0
    friction_change: float = math.inf  # s; when the friction begins to change to the later one


def truck(
    values: Mapping[str, float] | None = None,
    stiffness: Sequence[float] | Floats = (1.0,) * 5,
    shares: Sequence[float] = (1.0, 1.0, 1.0),
) -> Truck:
    """Return a truck without an effect.

    Args:
        values: Parameters that are not as published.
        stiffness: Factor on the published cornering stiffness of each axle, ``(5,)``.
        shares: In which the trailer's axles carry its rear load, ``(3,)``.
    """
    p = {**PUBLISHED, **(values or {})}
    ahead = p["kingpin_from_rear"] - p["trailer_cog_from_rear"]
    behind = [p["trailer_cog_from_rear"] - p[f"axle_{axle}_from_rear"] for axle in AXLES[2:]]
    loads = _axle_loads(p, ahead, behind, shares)
    nominal = [
        p[f"stiffness_peak_{g}"] * math.sin(2 * math.atan(load / p[f"stiffness_load_{g}"]))
        for g, load in zip(("11", "12", "2", "2", "2"), loads, strict=True)
    ]
    return Truck(
        tractor_mass=p["tractor_mass"],
        tractor_yaw_inertia=p["tractor_yaw_inertia"],
        front_axle=p["tractor_cog_to_front_axle"],
        drive_axle=p["tractor_cog_to_rear_axle"],
        kingpin=p["tractor_cog_to_kingpin"],
        trailer_mass=p["trailer_mass"],
        trailer_yaw_inertia=p["trailer_mass"] * (p["trailer_track"] ** 2 + p["trailer_length"] ** 2) / 12,
        trailer_kingpin=ahead,
        relaxation_11=p["relaxation_length_11"],
        relaxation_12=p["relaxation_length_12"],
        relaxation_2=p["relaxation_length_2"],
        friction=p["friction"],
        steering_ratio=p["steering_ratio"],
        **{f"axle_{axle}": b for axle, b in zip(AXLES[2:], behind, strict=True)},
        **{f"stiffness_{axle}": float(c * k) for axle, c, k in zip(AXLES, nominal, stiffness, strict=True)},
        **{f"load_{axle}": load for axle, load in zip(AXLES, loads, strict=True)},
    )


def _axle_loads(p: Mapping[str, float], ahead: float, behind: Sequence[float], shares: Sequence[float]) -> list[float]:
    """Return the static load of every axle in N; distances are in m from the trailer's CoG."""
    share = np.array(shares) / sum(shares)
    middle = float(np.dot(share, behind))
    on_kingpin = p["trailer_mass"] * GRAVITY * middle / (ahead + middle)
    front, rear = p["tractor_cog_to_front_axle"], p["tractor_cog_to_rear_axle"]
    base, to_kingpin = front + rear, rear - p["tractor_cog_to_kingpin"]
    weight = p["tractor_mass"] * GRAVITY
    tractor = [
        (weight * rear + on_kingpin * to_kingpin) / base,
        (weight * front + on_kingpin * (base - to_kingpin)) / base,
    ]
    return [*tractor, *(float(p["trailer_mass"] * GRAVITY * ahead / (ahead + middle) * s) for s in share)]


@njit(cache=True)
def brush(slip_angle, stiffness, load, friction):
    """Return the lateral force of a brush tyre with parabolic pressure (N): it adheres up to a point, then slides."""
    limit = friction * load
    if limit < SLIDING:
        return 0.0
    q = stiffness * math.tan(slip_angle) / (3.0 * limit)
    if q >= 1.0:
        return limit
    if q <= -1.0:
        return -limit
    r = 1.0 - abs(q)
    return math.copysign(limit * (1.0 - r * r * r), q)


@njit(cache=True)
def _friction(t, p):
    """Return the road's friction at a time (s)."""
    if t <= p.friction_change:
        return p.friction
    x = min(1.0, (t - p.friction_change) / FRICTION_CHANGES_IN)
    return p.friction + (p.later_friction - p.friction) * x * x * (3 - 2 * x)


@njit(cache=True)
def _trailer_velocity(y, p):
    """Return the velocity of the trailer's CoG along and across it (m/s), from that of the kingpin."""
    ct, st = math.cos(y[_THETA]), math.sin(y[_THETA])
    across = y[_ACROSS] - p.kingpin * y[_R1]
    return y[_ALONG] * ct + across * st, -y[_ALONG] * st + across * ct - p.trailer_kingpin * y[_R2]


@njit(cache=True)
def _tyre_rates(t, y, delta, p, dy):
    """Write the rates of the axle forces, which follow those of the brush tyres over the length that a wheel rolls."""
    u2, v2 = _trailer_velocity(y, p)
    u1, u2 = max(y[_ALONG], LOWEST_SPEED), max(u2, LOWEST_SPEED)
    mu = _friction(t, p)
    slip_11 = delta - math.atan((y[_ACROSS] + p.front_axle * y[_R1]) / u1)
    slip_12 = -math.atan((y[_ACROSS] - p.drive_axle * y[_R1]) / u1)
    slip_21 = -math.atan((v2 - p.axle_21 * y[_R2]) / u2)
    slip_22 = -math.atan((v2 - p.axle_22 * y[_R2]) / u2)
    slip_23 = -math.atan((v2 - p.axle_23 * y[_R2]) / u2)
    dy[_SWIVELLED] = (-p.self_steering * slip_23 - y[_SWIVELLED]) / SWIVEL_TIME
    slip_23 += y[_SWIVELLED] + p.forced_steering * y[_THETA]
    dy[_F11] = u1 / p.relaxation_11 * (brush(slip_11, p.stiffness_11, p.load_11, mu) - y[_F11])
    dy[_F12] = u1 / p.relaxation_12 * (brush(slip_12, p.stiffness_12, p.load_12, mu) - y[_F12])
    dy[_F21] = u2 / p.relaxation_2 * (brush(slip_21, p.stiffness_21, p.load_21, mu) - y[_F21])
    dy[_F22] = u2 / p.relaxation_2 * (brush(slip_22, p.stiffness_22, p.load_22, mu) - y[_F22])
    dy[_F23] = u2 / p.relaxation_2 * (brush(slip_23, p.stiffness_23, p.load_23, mu) - y[_F23])


@njit(cache=True)
def _bodies(y, u, delta, p, dy, out):
    """Write the rates of the bodies' velocities, and the outputs.

    The trailer's CoG has the acceleration ``jx a + kx`` along it and ``jy a + ky`` across it, where ``a`` are the
    tractor's two and both yaw accelerations; the fifth unknown is the thrust.
    """
    u1, v1, r1, r2 = y[_ALONG], y[_ACROSS], y[_R1], y[_R2]
    ct, st = math.cos(y[_THETA]), math.sin(y[_THETA])
    u2, v2 = _trailer_velocity(y, p)
    h, a2, m1, m2 = p.kingpin, p.trailer_kingpin, p.tractor_mass, p.trailer_mass
    gravity = -GRAVITY * math.sin(p.bank + u[BANK])
    along = u[SPEED_RATE] + SPEED_GAIN * (u[SPEED] - u2) - v2 * r2
    across = y[_F21] + y[_F22] + y[_F23] + u[SIDE_FORCE] + m2 * gravity
    kx = ct * h * r1 * r1 + a2 * r2 * r2
    ky = -st * h * r1 * r1
    jx = np.array([ct, st, -st * h, 0.0])
    jy = np.array([-st, ct, -ct * h, -a2])
    a, b = np.zeros((5, 5)), np.zeros(5)
    for i in range(4):
        for j in range(4):
            a[i, j] = m2 * (jx[i] * jx[j] + jy[i] * jy[j])
        b[i] = jx[i] * (m2 * along - m2 * kx) + jy[i] * (across - m2 * ky)
        a[4, i] = jx[i]
    a[0, 0] += m1
    a[1, 1] += m1
    a[2, 2] += p.tractor_yaw_inertia
    a[3, 3] += p.trailer_yaw_inertia
    a[0, 4] = -1.0
    b[1] += y[_F11] * math.cos(delta) + y[_F12] + m1 * gravity
    lock = p.locked_differential * r1 / max(u1, LOWEST_SPEED)
    b[2] += p.front_axle * y[_F11] * math.cos(delta) - p.drive_axle * y[_F12] - lock
    b[3] += -p.axle_21 * y[_F21] - p.axle_22 * y[_F22] - p.axle_23 * y[_F23] + u[YAW_MOMENT]
    b[4] = along - kx
    x = np.linalg.solve(a, b)
    dy[_ALONG] = x[0] + v1 * r1
    dy[_ACROSS] = x[1] - u1 * r1
    dy[_R1] = x[2]
    dy[_R2] = x[3]
    dy[_THETA] = r2 - r1
    out[0] = u2
    out[1:4] = y[_R1 : _THETA + 1]
    out[4] = x[1] - gravity
    out[5] = -st * x[0] + ct * x[1] - ct * h * x[2] + ky - a2 * x[3] - gravity


@njit(cache=True)
def _rates(t, y, u, p, dy, out):
    """Write the rates of the states and the outputs at a time (s)."""
    delta = u[WHEEL] / p.steering_ratio
    dy[_FRONT_WHEELS] = 0.0
    if p.steering_lag > 0:
        dy[_FRONT_WHEELS] = (delta - y[_FRONT_WHEELS]) / p.steering_lag
        delta = y[_FRONT_WHEELS]
    _tyre_rates(t, y, delta, p, dy)
    _bodies(y, u, delta, p, dy, out)


@njit(cache=True)
def integrate(u, p, step):
    """Return the outputs of a drive from straight ahead, by Runge-Kutta of fourth order.

    Args:
        u: Inputs at every half step, ``(2 n + 1, 6)``.
        p: The truck.
        step: In s.

    Returns:
        Outputs at every step, ``(n + 1, 6)``.
    """
    n = u.shape[0] // 2
    y = np.zeros(12)
    y[_ALONG] = u[0, SPEED]
    outputs, unused = np.zeros((n + 1, 6)), np.zeros(6)
    k1, k2, k3, k4 = np.zeros(12), np.zeros(12), np.zeros(12), np.zeros(12)
    for k in range(n + 1):
        t, i = k * step, 2 * k
        _rates(t, y, u[i], p, k1, outputs[k])
        if k == n:
            break
        _rates(t + step / 2, y + step / 2 * k1, u[i + 1], p, k2, unused)
        _rates(t + step / 2, y + step / 2 * k2, u[i + 1], p, k3, unused)
        _rates(t + step, y + step * k3, u[i + 2], p, k4, unused)
        y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return outputs
