"""A car with linear tyres as somebody else would write it, in units of his own, and a study of it."""

PLANT = """
import math
class Plant:
    inputs = {"steering_wheel_angle": "deg", "speed": "km/h"}
    outputs = {"lateral_velocity": "m/s", "yaw_rate": "deg/s", "lateral_acceleration": "m/s^2"}
    parameters = {
        "mass": "1.2 t",
        "yaw_inertia": {"value": 1500.0, "unit": "kg*m^2", "lower": 100.0},
        "front_stiffness": "80 kN/rad",
        "rear_stiffness": "90 kN/rad",
    }
    disturbances = {"side_force": "kN"}
    wheelbase, steering_ratio = "2.6 m", 16
    a, b = 1.2, 1.4
    def reset(self, values):
        self.p, self.v, self.r, self.k = values, 0.0, 0.0, 0
    def step(self, u, dt):
        p, vx, d = self.p, max(u["speed"] / 3.6, 0.5), math.radians(u["steering_wheel_angle"]) / 16
        m, out = p["mass"] * 1000, None
        self.k += 1
        for _ in range(10):
            af = d - (self.v + self.a * self.r) / vx
            ar = -(self.v - self.b * self.r) / vx
            ff, fr = 1000 * p["front_stiffness"] * af, 1000 * p["rear_stiffness"] * ar
            ay = (ff + fr + 1000 * u["side_force"]) / m
            if out is None:
                out = {"lateral_velocity": self.v, "yaw_rate": math.degrees(self.r), "lateral_acceleration": ay}
            self.v += dt / 10 * (ay - vx * self.r)
            self.r += dt / 10 * (self.a * ff - self.b * fr) / p["yaw_inertia"]
        return out
"""

STUDY = {
    "name": "foreign",
    "targets": ["lateral_velocity", "yaw_rate"],
    "plant": {"python": "my_plant:Plant", "noise": {"process": {"side_force": "0.01 kN^2"}}},
    "belief": {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "linear", "sensors": "car_series"},
    "drive": [
        {"name": "sine", "kind": "sine", "duration": "3 s", "lead_in": "0 s", "speed": "15 m/s", "amplitude": "20 deg"}
    ],
    "estimator": ["ekf"],
    "design": [{"name": "mass", "repeats": 3, "factor": [{"parameter": "mass", "levels": ["1.0 t", "1.6 t"]}]}],
}
