"""A car with linear tyres in NumPy, as a user would write it for a filter of another library; complex numbers pass."""

import numpy as np

STATES, OUTPUTS = ("lateral_velocity", "yaw_rate"), ("yaw_rate", "lateral_acceleration")


class Car:
    """Equations of the car that a belief holds, inputs steering wheel angle and speed."""

    def __init__(self, values, step):
        self.m, self.J, self.lf, self.lr, self.ratio, slowest, *tyre = (
            values[n] for n in (
                "mass", "yaw_inertia", "cog_to_front_axle", "cog_to_rear_axle", "steering_ratio", "lowest_speed",
                "stiffness_peak_front", "stiffness_load_front", "stiffness_peak_rear", "stiffness_load_rear",
            )
        )  # fmt: skip
        self.slowest, self.step, wheelbase = slowest, step, self.lf + self.lr
        peak_f, load_f, peak_r, load_r = tyre
        self.cf = peak_f * np.sin(2 * np.arctan(9.81 * self.lr * self.m / (load_f * wheelbase)))
        self.cr = peak_r * np.sin(2 * np.arctan(9.81 * self.lf * self.m / (load_r * wheelbase)))
        self.Q, self.first_P = (
            np.diag([values[f"{n}.{s}"] for s in STATES]) for n in ("process_noise", "first_variance")
        )
        self.R = np.diag([values[f"measurement_noise.{o}"] for o in OUTPUTS])
        self.first = np.array([values[f"first.{s}"] for s in STATES])

    def forces(self, x, u):
        delta, speed = u[0] / self.ratio, max(u[1], self.slowest)
        front = -self.cf * np.cos(delta) * np.tan(np.arctan((self.lf * x[1] + x[0]) / speed) - delta)
        return front, -self.cr * (x[0] - self.lr * x[1]) / speed

    def ahead(self, x, u):
        front, rear = self.forces(x, u)
        rates = (front + rear) / self.m - u[1] * x[1], (self.lf * front - self.lr * rear) / self.J
        return np.array([x[0] + self.step * rates[0], x[1] + self.step * rates[1]])

    def output(self, x, u):
        front, rear = self.forces(x, u)
        return np.array([x[1], (front + rear) / self.m])


def slopes(function, x, u):
    """Return the Jacobian by complex steps."""
    return np.column_stack([function(x + 1e-30j * unit, u).imag / 1e-30 for unit in np.eye(len(x))])
