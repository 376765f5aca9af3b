"""Ferrari 250 LM of 1965 as in MBDS/sideslip-angle-vehicle-estimation (Blanco-Claraco 2021).

From the publication: mass, yaw inertia, lengths, stiffness of both axles (70000 and 120000 N/rad). Its recordings
state road-wheel angles, so the steering ratio is 1, and velocities at the CoG.

Chosen by this project, because the publication has none: friction and shape factors of the tyres;
``stiffness_load``, so that the stiffness grows with the load, with peaks such that it is the published one at the
static loads of 4295 and 5339 N; and all noise.
"""

from math import radians

VEHICLE = "car"

VALUES: dict[str, float] = {
    "mass": 982.0,
    "yaw_inertia": 1605.0,
    "cog_to_front_axle": 1.33,
    "cog_to_rear_axle": 1.07,
    "friction": 0.9,
    "steering_ratio": 1.0,
    "reference_from_cog": 0.0,
    "lowest_speed": 1.5,
    "shape_factor_front": 1.3,
    "shape_factor_rear": 1.3,
    "stiffness_peak_front": 2.49487e5,
    "stiffness_peak_rear": 3.47849e5,
    "stiffness_load_front": 3e4,
    "stiffness_load_rear": 3e4,
}

NOISE_STEP = 0.01
"""s; the step to which the process-noise variances below belong."""

PROCESS_NOISE: dict[str, float] = {"lateral_velocity": 0.002**2, "yaw_rate": radians(0.02) ** 2}
"""Variances per step in the square of the state's SI unit."""

MEASUREMENT_NOISE: dict[str, float] = {
    "yaw_rate": radians(0.1) ** 2,
    "lateral_acceleration": 0.1**2,
    "lateral_velocity": 0.02**2,
}
"""Variances per sample in SI units."""
