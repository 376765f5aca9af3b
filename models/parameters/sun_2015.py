"""Test car of Sun 2015, section 3.2 (eqs 3.14 to 3.18).

From the thesis: stiffnesses, mass over inertia, lengths, height of the CoG, and the measurement noise of the
simulation (0.005 m/s, 0.02 deg/s, 0.005 deg). It sets the process noise per step of 10 ms equal to it (Xi = Theta).

Chosen by this project: the steering ratio, because the thesis steers the road wheels; the noise of the accelerations,
which it does not measure.
"""

from math import radians

VEHICLE = "car_reference_point"

VALUES: dict[str, float] = {
    "stiffness_over_load_front": 8.36,
    "stiffness_over_load_rear": 7.78,
    "mass_over_inertia": 0.62,
    "cog_to_front_axle": 1.014,
    "axle_distance": 2.69,
    "cog_height": 0.5,
    "steering_ratio": 16.0,
}

NOISE_STEP = 0.01
"""s; the step to which the process-noise variances below belong."""

PROCESS_NOISE: dict[str, float] = {
    "lateral_velocity_rear": 0.005**2,
    "yaw_rate": radians(0.02) ** 2,
    "heading": radians(0.005) ** 2,
}
"""Variances per step in the square of the state's SI unit."""

MEASUREMENT_NOISE: dict[str, float] = {
    "lateral_velocity_rear": 0.005**2,
    "yaw_rate": radians(0.02) ** 2,
    "heading": radians(0.005) ** 2,
    "lateral_acceleration": 0.1**2,
    "longitudinal_acceleration": 0.1**2,
}
"""Variances per sample in SI units."""
