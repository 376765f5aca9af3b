"""The multi-body car of the CommonRoad vehicle models (29 states, BMW 320i) as the plant of a study.

Equations, tyres and parameters are those of the package ``commonroad-vehicle-models`` (Althoff and Wuersching 2020,
multi-body model); only the driver is written here: the front wheels follow the steering wheel at their largest rate,
and a proportional controller holds the speed. The package's axes have z down, so that its roll angle is positive to the
right; all in the plane of the road has the signs of ISO 8855, since the car is symmetric.
"""

import math
from dataclasses import replace

from vehiclemodels.init_mb import init_mb
from vehiclemodels.parameters_vehicle2 import parameters_vehicle2
from vehiclemodels.vehicle_dynamics_mb import vehicle_dynamics_mb

SUBSTEPS = 4
SPEED_GAIN = 2.0
GRAVITY = 9.81


class MultiBody:
    """BMW 320i with its body on springs, three bodies in roll, four wheels that slip."""

    inputs = {"steering_wheel_angle": "rad", "speed": "m/s"}
    outputs = {
        "lateral_velocity": "m/s",
        "yaw_rate": "rad/s",
        "lateral_acceleration": "m/s^2",
        "roll_angle": "rad",
    }
    parameters = {
        "mass": {"value": 1093.295, "unit": "kg", "lower": 700.0, "meaning": "whole car, the body differs"},
        "friction": {"value": 1.0489, "unit": "", "lower": 0.05, "meaning": "largest lateral friction of the tyres"},
        "cog_height": {"value": 0.61373, "unit": "m", "lower": 0.35, "meaning": "centre of gravity of the body"},
    }
    disturbances = {"yaw_moment": "N*m"}
    wheelbase, steering_ratio = "2.5789 m", 16

    def __init__(self):
        self._nominal = parameters_vehicle2()

    def reset(self, values):
        """Start straight ahead at the first sample's speed."""
        own, added = self._nominal, values["mass"] - self._nominal.m
        tyre = replace(own.tire, p_dy1=values["friction"], p_dx1=own.tire.p_dx1 * values["friction"] / own.tire.p_dy1)
        self.car = replace(own, m=values["mass"], m_s=own.m_s + added, h_s=values["cog_height"], tire=tyre)
        self.x = None

    def step(self, inputs, dt):
        """Return what is published now, and move on by ``dt`` with Runge and Kutta's fourth-order steps."""
        if self.x is None:
            self.x = init_mb([0.0, 0.0, 0.0, inputs["speed"], 0.0, 0.0, 0.0], self.car)
        published = self._published(inputs)
        h = dt / SUBSTEPS
        for _ in range(SUBSTEPS):
            k1 = self._rates(self.x, inputs, h)
            k2 = self._rates(self._ahead(k1, h / 2), inputs, h)
            k3 = self._rates(self._ahead(k2, h / 2), inputs, h)
            k4 = self._rates(self._ahead(k3, h), inputs, h)
            self.x = [x + h / 6 * (a + 2 * b + 2 * c + d) for x, a, b, c, d in zip(self.x, k1, k2, k3, k4, strict=True)]
        return published

    def _ahead(self, rates, h):
        return [x + h * rate for x, rate in zip(self.x, rates, strict=True)]

    def _rates(self, x, inputs, h):
        wheels = inputs["steering_wheel_angle"] / 16.0
        driver = [(wheels - x[2]) / h, SPEED_GAIN * (inputs["speed"] - x[3])]
        rates = vehicle_dynamics_mb(list(x), driver, self.car)
        rates[5] += inputs["yaw_moment"] / self.car.I_z
        return rates

    def _published(self, inputs):
        x, rates = self.x, self._rates(self.x, inputs, 1.0)
        lateral = rates[10] + x[5] * x[3]
        return {
            "lateral_velocity": x[10],
            "yaw_rate": x[5],
            "lateral_acceleration": lateral * math.cos(x[6]) - GRAVITY * math.sin(x[6]),  # as a sensor in the body
            "roll_angle": -x[6],
        }
