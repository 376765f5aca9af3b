"""An unscented filter of filterpy, as somebody writes it for a car: linear tyres, two states."""

import numpy as np
from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

STIFFNESS = 21.92
"""Cornering stiffness of an axle over its load in 1/rad."""


def make_ukf(values, step):
    """Return the filter of a run.

    Args:
        values: What the belief holds, by name, SI.
        step: Sample time in s.
    """
    mass, inertia, ratio = values["mass"], values["yaw_inertia"], values["steering_ratio"]
    front, rear = values["cog_to_front_axle"], values["cog_to_rear_axle"]
    c_front, c_rear = (STIFFNESS * mass * 9.81 * arm / (front + rear) for arm in (rear, front))

    def forces(x, u):
        slip_front = u[0] / ratio - np.arctan2(x[0] + front * x[1], u[1])
        slip_rear = -np.arctan2(x[0] - rear * x[1], u[1])
        return c_front * slip_front, c_rear * slip_rear

    def fx(x, dt, u):
        f, r = forces(x, u)
        return x + dt * np.array([(f + r) / mass - u[1] * x[1], (front * f - rear * r) / inertia])

    def hx(x, u):
        return np.array([x[1], sum(forces(x, u)) / mass])

    ukf = UnscentedKalmanFilter(2, 2, step, hx, fx, MerweScaledSigmaPoints(2, 1.0, 2.0, 0.0))
    ukf.Q = np.diag([values["process_noise.lateral_velocity"], values["process_noise.yaw_rate"]])
    ukf.R = np.diag([values["measurement_noise.yaw_rate"], values["measurement_noise.lateral_acceleration"]])
    ukf.P = ukf.Q.copy()
    return ukf
