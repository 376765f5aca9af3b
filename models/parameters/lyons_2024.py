"""Car at the scale 1:10 of Lorenzo-Lyons/DART (Lyons 2024), on rubber tyres.

From the publication: wheelbase 0.1735 m, mass 1.580 kg of which 0.847 kg rest on the front axle, so lengths follow. Its
recordings are taken with road-wheel angles, so the steering ratio is 1.

Chosen by this project: yaw inertia ``m l_f l_r``; friction and shape factors of the tyres; ``stiffness_load``, so that
the stiffness grows with the load, with peaks for 30 and 35 N/rad at the static loads of 8.31 and 7.19 N; velocities at
the CoG; and all noise.
"""

from math import radians

VEHICLE = "car"

VALUES: dict[str, float] = {
    "mass": 1.580,
    "yaw_inertia": 0.0118,
    "cog_to_front_axle": 0.08049,
    "cog_to_rear_axle": 0.09301,
    "friction": 0.7,
    "steering_ratio": 1.0,
    "reference_from_cog": 0.0,
    "shape_factor_front": 1.3,
    "shape_factor_rear": 1.3,
    "stiffness_peak_front": 58.3,
    "stiffness_peak_rear": 77.2,
    "stiffness_load_front": 30.0,
    "stiffness_load_rear": 30.0,
}

NOISE_STEP = 0.01
"""s; the step to which the process-noise variances below belong."""

PROCESS_NOISE: dict[str, float] = {"lateral_velocity": 0.001**2, "yaw_rate": radians(0.5) ** 2}
"""Variances per step in the square of the state's SI unit."""

MEASUREMENT_NOISE: dict[str, float] = {
    "yaw_rate": radians(3.0) ** 2,
    "lateral_acceleration": 0.5**2,
    "lateral_velocity": 0.02**2,
}
"""Variances per sample in SI units."""
