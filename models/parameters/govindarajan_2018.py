"""Genesis G80 of MPC-Berkeley/genesis_path_follower (Govindarajan 2018).

From the publication: mass, yaw inertia, lengths, stiffness of both axles (152838 and 269702 N/rad), and the
steering ratio by which its recordings state road-wheel angles.

Chosen by this project, because the publication has none: friction and shape factors of the tyres;
``stiffness_load``, so that the stiffness grows with the load, with peaks such that it is the published one at the
static loads of 11212 and 11381 N; ``reference_from_cog``, since the point of its satellite navigation is not
published; and all noise.
"""

from math import radians

VEHICLE = "car"

VALUES: dict[str, float] = {
    "mass": 2303.1,
    "yaw_inertia": 5520.1,
    "cog_to_front_axle": 1.5213,
    "cog_to_rear_axle": 1.4987,
    "friction": 0.9,
    "steering_ratio": 15.87,
    "reference_from_cog": 0.0,
    "lowest_speed": 1.5,
    "shape_factor_front": 1.3,
    "shape_factor_rear": 1.3,
    "stiffness_peak_front": 2.33032e5,
    "stiffness_peak_rear": 4.06615e5,
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
