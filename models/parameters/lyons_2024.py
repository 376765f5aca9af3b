"""Car at the scale 1:10 of Lorenzo-Lyons/DART (Lyons 2024), on rubber tyres.

From the publication: wheelbase 0.1735 m and mass 1.580 kg, of which 0.847 kg rest on the front axle, so lengths follow;
yaw inertia, that of a box of 0.1735 by 0.08 m; and the tyres that its authors fitted: shape factors, friction (0.841
front and 0.855 rear, one value here), and stiffness at the static loads of 8.31 and 7.19 N (50.5 and 68.1 N/rad). Its
recordings are taken with road-wheel angles, so the steering ratio is 1.

Chosen by this project: ``stiffness_load``, so that the stiffness grows with the load; velocities at the CoG; the lowest
speed, at which tyres this light damp within 3 ms, so that steps of Runge-Kutta's method may last 7 ms; and all noise,
that of the yaw rate from the scatter of the gyro against the motion capture.
"""

from math import radians

VEHICLE = "car"

VALUES: dict[str, float] = {
    "mass": 1.580,
    "yaw_inertia": 0.00481,
    "cog_to_front_axle": 0.08049,
    "cog_to_rear_axle": 0.09301,
    "friction": 0.85,
    "steering_ratio": 1.0,
    "reference_from_cog": 0.0,
    "lowest_speed": 0.5,
    "shape_factor_front": 0.841,
    "shape_factor_rear": 0.959,
    "stiffness_peak_front": 98.1,
    "stiffness_peak_rear": 150.0,
    "stiffness_load_front": 30.0,
    "stiffness_load_rear": 30.0,
}

NOISE_STEP = 0.01
"""s; the step to which the process-noise variances below belong."""

PROCESS_NOISE: dict[str, float] = {"lateral_velocity": 0.001**2, "yaw_rate": radians(0.5) ** 2}
"""Variances per step in the square of the state's SI unit."""

MEASUREMENT_NOISE: dict[str, float] = {
    "yaw_rate": radians(5.0) ** 2,
    "lateral_acceleration": 0.5**2,
    "lateral_velocity": 0.02**2,
}
"""Variances per sample in SI units."""
