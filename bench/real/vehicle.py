"""The equations of the realistic plants: rigid units that roll and pitch, MF 6.1 tyres, and Runge-Kutta around them.

A vehicle is one unit (car) or two that a fifth wheel couples. Each unit moves in the plane, and its sprung mass is in
two ends, over the front and the rear suspension, that roll by themselves and twist the frame between them. In the felt
lateral acceleration ``A = v' + u r + g bank`` of the CoG, the yaw acceleration and the roll accelerations of the ends
at ``x_i`` with the mass ``m_i`` at the height ``h_i`` over the roll axis (Pacejka 2012, 7.5 with two ends):

    m A - sum m_i h_i phi_i''                                = Y
    I_z r' - sum m_i h_i x_i phi_i''                         = N
    (I_i + m_i h_i^2) phi_i'' - m_i h_i (A + x_i r')         = m_i g h_i phi_i - k_i phi_i - d_i phi_i' -+ torsion

The fifth wheel is a stiff spring and damper with play, so that no constraint remains. Axes are those of ISO 8855: x
forward, y to the left, angles positive to the left, a roll angle to the right. Everything that is compiled stands in
this file, because numba renews its disk cache only when the file of the compiled function itself changes.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit
from numpy.typing import NDArray

Floats = NDArray[np.float64]
Integers = NDArray[np.int64]

GRAVITY = 9.81
"""m/s^2."""

STEP = 1e-3
"""s; step of the integration, whose inputs are given at half steps as well."""

ROLLING = 0.012
"""Rolling resistance over load."""

SPEED_GAIN = 1.0
"""1/s; how hard the driver corrects the speed."""

GRIP = 0.95
"""Share of the friction that drive and brakes use at most."""

LOWEST_SPEED = 1.0
"""m/s; slip angles of a slower wheel are those at this speed."""

ROAD_WHEEL, SPEED, SPEED_RATE, BANK, ROUGH = range(5)
"""Columns of the inputs: road-wheel angle behind the column (rad), the driver's speed (m/s) and its rate (m/s^2), bank
(rad, left side higher), and from ``ROUGH`` on the unevenness of every wheel as a share of its static load."""

UNIT, HITCH = 9, 3
"""States of a unit and of the coupling; each wheel has one more."""

U, V, R, PHI, RATE, PHI_REAR, RATE_REAR, PITCH, PITCH_RATE = range(UNIT)
"""Of a unit: velocities of the CoG, yaw rate, roll angle and rate of both ends, and the pitch as the longitudinal
acceleration (m/s^2) that its springs have settled to, with its rate."""

FZ0, CY, DY, DY_LOAD, EY, EY_LOAD, KY, KY_LOAD, CONICITY, BYK, BYK_SLIP, CYK, KX, SIGMA, TYRES = range(15)
"""Coefficients of a tyre: nominal load (N); shape; friction and its change per relative load; curvature likewise;
cornering stiffness over load at most, and at which load over the nominal (p_Ky1, p_Ky2); slip angle of conicity (rad);
weights of combined slip (r_By1, r_By2, r_Cy1); longitudinal stiffness over load; relaxation length at the nominal load
(m); tyres on each side."""


class Plant(NamedTuple):
    """A vehicle in SI units; arrays over units ``(n, ...)``, their two ends ``(n, 2)`` and axles ``(m,)``."""

    mass: Floats
    transfer: Floats  # (m, n); load of an axle per settled acceleration of a unit
    pitch: Floats  # (n, 2); natural frequency in rad/s, damping of the critical
    inverse: Floats  # (n, 4, 4); of the mass matrix
    end_x: Floats
    end_mh: Floats
    end_springs: Floats  # (n, 2, 2); roll stiffness and damping of an end's suspension
    torsion: Floats  # (n, 2); stiffness and damping of the frame
    air: Floats  # (n, 2); drag over speed squared, side force over speed squared and sideslip
    unit: Integers  # (m,); to which an axle belongs
    end: Integers
    x: Floats  # ahead of the CoG of its unit
    track: Floats
    load: Floats  # static, of both wheels
    share: Floats  # of the suspension moment of its end
    roll_centre: Floats  # height; its own unsprung mass counts with it
    steered: Floats  # 1 where the column steers
    toe: Floats  # rad per N, against the axle's own force
    roll_steer: Floats  # rad per rad, to the left for a roll to the right
    askew: Floats  # rad
    drive: Floats  # share of the driving force
    brake: Floats  # share of the braking force
    pull: Floats  # share by which the left brake holds more than the mean
    tyre: Floats  # (m, 15)
    compliance: float  # of the column, rad per N of the steered axle
    hitch: Floats  # (12,); see _coupling


@njit(cache=True, error_model="numpy")
def lateral_force(slip, kappa, load, c):
    """Return the lateral force of a tyre in N (MF 6.1 without camber; combined slip by its weighting function)."""
    if load <= 0.0:
        return 0.0
    more = load / c[FZ0] - 1.0
    stiffness = c[KY] * c[FZ0] * math.sin(2.0 * math.atan(load / (c[KY_LOAD] * c[FZ0])))
    capacity = (c[DY] + c[DY_LOAD] * more) * load
    curvature = min(c[EY] + c[EY_LOAD] * more, 1.0)
    bx = stiffness / (c[CY] * capacity) * math.tan(slip)
    pure = capacity * math.sin(c[CY] * math.atan(bx - curvature * (bx - math.atan(bx))))
    b = c[BYK] * math.cos(math.atan(c[BYK_SLIP] * slip))
    return pure * math.cos(c[CYK] * math.atan(b * kappa))


@njit(cache=True, error_model="numpy")
def beyond(x, play):
    """Return how far a displacement is beyond a play to either side."""
    return x - min(max(x, -play), play)


@njit(cache=True, error_model="numpy")
def _coupling(y, p, force):
    """Write what the fifth wheel does to both units: X, Y, N, roll moment on the end behind or ahead, ``(2, 4)``.

    ``p.hitch``: fifth wheel behind the tractor's CoG, kingpin ahead of the trailer's (m); stiffness, damping and play
    of the pin; roll stiffness, damping and play of the plates; friction moment (N m) and speed (rad/s) at which it is
    full; height of the fifth wheel over the tractor's roll axis; pitch is free.
    """
    back, ahead, k, d, play, k_roll, d_roll, roll_play, friction, turning, height, _ = p.hitch
    base = 2 * UNIT
    theta = y[base + 2]
    ct, st = math.cos(theta), math.sin(theta)
    v_pin = y[UNIT + V] + ahead * y[UNIT + R]
    du = y[UNIT + U] * ct - v_pin * st - y[U]
    dv = y[UNIT + U] * st + v_pin * ct - (y[V] - back * y[R] - height * y[RATE_REAR])
    along = k * beyond(y[base], play) + d * du
    across = k * beyond(y[base + 1], play) + d * dv
    moment = friction * math.tanh((y[UNIT + R] - y[R]) / turning)
    roll = k_roll * beyond(y[UNIT + PHI] - y[PHI_REAR], roll_play) + d_roll * (y[UNIT + RATE] - y[RATE_REAR])
    force[0, 0], force[0, 1], force[0, 2] = along, across, -back * across + moment
    force[0, 3] = roll - height * across
    force[1, 0] = -along * ct - across * st
    force[1, 1] = along * st - across * ct
    force[1, 2] = ahead * force[1, 1] - moment
    force[1, 3] = -roll
    return du, dv


@njit(cache=True, error_model="numpy")
def _demand(y, u, p):
    """Return the force of drive and brakes that the driver wants (N)."""
    total, air = 0.0, 0.0
    for i in range(p.mass.size):
        total += p.mass[i]
        air += p.air[i, 0] * y[i * UNIT + U] ** 2
    wanted = u[SPEED_RATE] + SPEED_GAIN * (u[SPEED] - y[U])
    return total * (wanted + ROLLING * GRAVITY) + air


@njit(cache=True, error_model="numpy")
def _axles(y, u, p, force, dy, out):
    """Add the forces of the tyres to those on the units, and write the rates of their slip angles.

    ``out`` gets of every axle the lateral force, and the loads of its left and right wheel, ``(m, 3)``, and the mean
    longitudinal slip in its fourth column.
    """
    n = p.mass.size
    base = n * UNIT + (HITCH if n > 1 else 0)
    demand = _demand(y, u, p)
    steered = 0.0
    for j in range(p.x.size):
        s, e = p.unit[j] * UNIT, p.end[j]
        c, twins = p.tyre[j], p.tyre[j, TYRES]
        roll, rate = y[s + PHI + 2 * e], y[s + RATE + 2 * e]
        moment = p.share[j] * (p.end_springs[p.unit[j], e, 0] * roll + p.end_springs[p.unit[j], e, 1] * rate)
        half = 0.5 * p.load[j]
        for i in range(n):
            half += 0.5 * p.transfer[j, i] * y[i * UNIT + PITCH]
        kappa = np.zeros(2)
        lateral = 0.0
        for again in range(2):
            moved = (moment + p.roll_centre[j] * lateral) / p.track[j]
            lateral = 0.0
            for side in range(2):  # left, right
                load = half + (moved if side else -moved) + 0.5 * p.load[j] * u[ROUGH + 2 * j + side]
                out[j, 1 + side] = max(load, 0.0)
                wanted = (
                    demand * 0.5 * (p.drive[j] if demand > 0.0 else p.brake[j] * (1.0 + p.pull[j] * (1 - 2 * side)))
                )
                most = GRIP * c[DY] * out[j, 1 + side]
                wanted = min(max(wanted, -most), most)
                kappa[side] = wanted / (c[KX] * max(out[j, 1 + side], 1.0))
                slip = y[base + 2 * j + side] + c[CONICITY] * (1 - 2 * side)
                lateral += twins * lateral_force(slip, kappa[side], out[j, 1 + side] / twins, c)
                if again:
                    along = wanted - ROLLING * out[j, 1 + side]
                    force[p.unit[j], 0] += along
                    force[p.unit[j], 2] -= (0.5 - side) * p.track[j] * along
        out[j, 0], out[j, 3] = lateral, 0.5 * (kappa[0] + kappa[1])
        if p.steered[j] > 0.0:
            steered += lateral
    for j in range(p.x.size):
        s = p.unit[j] * UNIT
        delta = p.askew[j] - p.toe[j] * out[j, 0] + p.roll_steer[j] * y[s + PHI + 2 * p.end[j]]
        if p.steered[j] > 0.0:
            delta += u[ROAD_WHEEL] - p.compliance * steered
        along, across = -out[j, 0] * math.sin(delta), out[j, 0] * math.cos(delta)
        force[p.unit[j], 0] += along
        force[p.unit[j], 1] += across
        force[p.unit[j], 2] += p.x[j] * across
        for side in range(2):
            k = base + 2 * j + side
            u_w = max(y[s + U] - (0.5 - side) * p.track[j] * y[s + R], LOWEST_SPEED)
            geometric = delta - math.atan((y[s + V] + p.x[j] * y[s + R]) / u_w)
            length = p.tyre[j, SIGMA] * (0.4 + 0.6 * out[j, 1 + side] / (p.tyre[j, TYRES] * p.tyre[j, FZ0]))
            dy[k] = u_w / length * (geometric - y[k])


@njit(cache=True, error_model="numpy")
def _rates(y, u, p, dy, out, felt):
    """Write the rates of the states; ``out`` as of ``_axles``, ``felt`` ``(n, 3)``: A, r', force along over mass."""
    n = p.mass.size
    force = np.zeros((2, 4))
    if n > 1:
        base = n * UNIT
        du, dv = _coupling(y, p, force)
        dy[base] = du + y[R] * y[base + 1]
        dy[base + 1] = dv - y[R] * y[base]
        dy[base + 2] = y[UNIT + R] - y[R]
    _axles(y, u, p, force, dy, out)
    right = np.zeros(4)
    for i in range(n):
        s = i * UNIT
        speed = y[s + U]
        right[0] = force[i, 1] - p.air[i, 1] * speed * y[s + V]
        right[1] = force[i, 2]
        twist = p.torsion[i, 0] * (y[s + PHI] - y[s + PHI_REAR]) + p.torsion[i, 1] * (y[s + RATE] - y[s + RATE_REAR])
        for e in range(2):
            phi, rate = y[s + PHI + 2 * e], y[s + RATE + 2 * e]
            springs = p.end_springs[i, e, 0] * phi + p.end_springs[i, e, 1] * rate
            right[2 + e] = p.end_mh[i, e] * GRAVITY * phi - springs + (twist if e else -twist)
        if n > 1:
            right[3 if i == 0 else 2] += force[i, 3]
        for a in range(4):
            solved = 0.0
            for b in range(4):
                solved += p.inverse[i, a, b] * right[b]
            if a == 0:
                felt[i, 0] = solved
                dy[s + V] = solved - speed * y[s + R] - GRAVITY * u[BANK]
            elif a == 1:
                felt[i, 1] = solved
                dy[s + R] = solved
            else:
                dy[s + 2 * a] = solved
        dy[s + PHI], dy[s + PHI_REAR] = y[s + RATE], y[s + RATE_REAR]
        along = (force[i, 0] - p.air[i, 0] * speed * speed) / p.mass[i]
        felt[i, 2] = along
        dy[s + U] = along + y[s + V] * y[s + R]
        w, z = p.pitch[i]
        dy[s + PITCH] = y[s + PITCH_RATE]
        dy[s + PITCH_RATE] = w * w * (along - y[s + PITCH]) - 2.0 * z * w * y[s + PITCH_RATE]


@njit(cache=True, error_model="numpy")
def integrate(u, p, step):
    """Return a drive from straight ahead, by Runge-Kutta of fourth order.

    Args:
        u: Inputs at every half step, ``(2 k + 1, 4 + 2 m)``.
        p: The vehicle, of ``n`` units with ``m`` axles.
        step: In s.

    Returns:
        States ``(k + 1, nx)``; of the axles lateral force, loads and slip ``(k + 1, m, 4)``; of the units what is felt
        at the CoG, ``(k + 1, n, 4)``: lateral acceleration, yaw acceleration, longitudinal acceleration, and the mean
        roll acceleration.
    """
    n, m = p.mass.size, p.x.size
    nx = n * UNIT + (HITCH if n > 1 else 0) + 2 * m
    steps = u.shape[0] // 2
    y = np.zeros(nx)
    for i in range(n):
        y[i * UNIT + U] = u[0, SPEED]
    states, axles, felt = np.zeros((steps + 1, nx)), np.zeros((steps + 1, m, 4)), np.zeros((steps + 1, n, 4))
    k1, k2, k3, k4 = np.zeros(nx), np.zeros(nx), np.zeros(nx), np.zeros(nx)
    unused, of_units = np.zeros((m, 4)), np.zeros((n, 3))
    for k in range(steps + 1):
        i = 2 * k
        _rates(y, u[i], p, k1, axles[k], of_units)
        states[k] = y
        felt[k, :, :3] = of_units
        for a in range(n):
            felt[k, a, 3] = 0.5 * (k1[a * UNIT + RATE] + k1[a * UNIT + RATE_REAR])
        if k == steps:
            break
        _rates(y + step / 2 * k1, u[i + 1], p, k2, unused, of_units)
        _rates(y + step / 2 * k2, u[i + 1], p, k3, unused, of_units)
        _rates(y + step * k3, u[i + 2], p, k4, unused, of_units)
        y = y + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
    return states, axles, felt
