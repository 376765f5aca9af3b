"""Truck-semitrailer of Ziaukas 2023, partly laden (24 t trailer).

From the thesis: masses, inertia of the tractor, lengths (table 4.3), CoG of the trailer 7.8 m from the rear wall
(5.4.3), friction 0.9 (5.4.4), steering ratio 23 (4.2.2), noise (5.3), (5.4).

Chosen by this project, because the thesis shows them only as histograms (Bild 4.6): all tyre parameters and
relaxation lengths. They lie inside the search range of table 4.4 and give a stable, understeering combination;
they do not claim to be the thesis's optimum. ``constraint_rate`` and ``trailer_inertia_scale`` are this
project's as well. The last variance of (5.3), 1e-5, has no unit there; here it is that of the steering-wheel angle in
rad^2, the estimated input of its figures (docs/semitrailer.md); ``ziaukas_2023_road_wheels`` has the other reading.
"""

VEHICLE = "semitrailer"

VALUES: dict[str, float] = {
    "tractor_mass": 8420.0,
    "tractor_yaw_inertia": 35000.0,
    "tractor_cog_to_front_axle": 1.175,
    "tractor_cog_to_rear_axle": 2.535,
    "tractor_cog_to_kingpin": 1.935,
    "trailer_mass": 24000.0,
    "trailer_track": 2.165,
    "trailer_length": 13.0,
    "trailer_inertia_scale": 1.0,
    "kingpin_from_rear": 12.0,
    "axle_21_from_rear": 5.67,
    "axle_22_from_rear": 4.32,
    "axle_23_from_rear": 2.97,
    "trailer_cog_from_rear": 7.8,
    "friction": 0.9,
    "relaxation_length_11": 0.4,
    "relaxation_length_12": 0.4,
    "relaxation_length_2": 0.5,
    "steering_ratio": 23.0,
    "constraint_rate": 10.0,
    "shape_factor_11": 1.35,
    "shape_factor_12": 1.30,
    "shape_factor_2": 1.25,
    "stiffness_peak_11": 4.6e5,
    "stiffness_peak_12": 8.5e5,
    "stiffness_peak_2": 2.8e5,
    "stiffness_load_11": 8.0e4,
    "stiffness_load_12": 1.4e5,
    "stiffness_load_2": 6.5e4,
}

NOISE_STEP = 0.01
"""s; the step to which the process-noise variances below belong (they grow in proportion to the step)."""

PROCESS_NOISE: dict[str, float] = {
    "lateral_velocity_tractor": 1e-10,
    "yaw_rate_tractor": 1e-10,
    "lateral_velocity_trailer": 5e-8,
    "yaw_rate_trailer": 1e-9,
    "articulation_angle": 1e-10,
    "lateral_force_axle_11": 1e3,
    "lateral_force_axle_12": 1e3,
    "lateral_force_axle_21": 1e3,
    "lateral_force_axle_22": 1e3,
    "lateral_force_axle_23": 1e3,
    "steering_wheel_angle": 1e-5,
}
"""Variances per step in the square of the state's SI unit (5.3)."""

MEASUREMENT_NOISE: dict[str, float] = {
    "yaw_rate_trailer": 1e-4,
    "yaw_rate_tractor": 1e-4,
    "articulation_angle": 1e-6,
    "lateral_force_axle_21": 1e5,
    "lateral_acceleration_tractor": 2.5e-3,
}
"""Variances per sample in SI units: the trailer's yaw rate from (5.4), the others chosen by this project."""
