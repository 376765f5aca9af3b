"""Truck-semitrailer of Ziaukas 2023 at the nearest point: tyres and noise with which its chapter 5 comes out best.

The thesis does not publish its tyre parameters and the units of its noise. This set is the point of a box of all that
it leaves open at which the published numbers of chapter 5 together are met most closely (``docs/unpublished.md``,
``reproductions/box``). It is found by a search, not measured: neither the thesis's optimum nor a default.
Masses, lengths and friction are those of ``ziaukas_2023``. Values follow from the factors of the point, which have
three digits. Its drives are ``studies/drives/nearest.toml``; its model is integrated by Euler with 10 ms, filters and
plant alike.
"""

from harness.models.parameters import ziaukas_2023

VEHICLE = "semitrailer"

VALUES: dict[str, float] = {
    **ziaukas_2023.VALUES,
    "trailer_inertia_scale": 2.41,
    "relaxation_length_11": 1.04,
    "relaxation_length_12": 1.04,
    "relaxation_length_2": 0.255,
    "constraint_rate": 0.0,  # the tie as printed, without a stabilisation
    "shape_factor_11": 1.09,
    "shape_factor_12": 1.38,
    "shape_factor_2": 1.77,
    "stiffness_peak_11": 3.2982e5,
    "stiffness_peak_12": 5.8565e5,
    "stiffness_peak_2": 2.618e5,
    "stiffness_load_2": 3.367e4,
}

NOISE_STEP = 0.01
"""s; the step to which the process-noise variances below belong (they grow in proportion to the step)."""

PROCESS_NOISE: dict[str, float] = {
    "lateral_velocity_tractor": 2.53087e-8,
    "yaw_rate_tractor": 2.53087e-8,
    "lateral_velocity_trailer": 1.265435e-5,
    "yaw_rate_trailer": 2.53087e-7,
    "articulation_angle": 2.53087e-8,
    "lateral_force_axle_11": 2.53087e5,
    "lateral_force_axle_12": 2.53087e5,
    "lateral_force_axle_21": 2.53087e5,
    "lateral_force_axle_22": 2.53087e5,
    "lateral_force_axle_23": 2.53087e5,
    "steering_wheel_angle": 4.04038e-3,
}
"""Variances per step in the square of the state's SI unit: those of (5.3) times 253.087, the wheel's apart."""

MEASUREMENT_NOISE: dict[str, float] = {**ziaukas_2023.MEASUREMENT_NOISE, "yaw_rate_trailer": 7.51e-3}
"""Variances per sample in SI units: the trailer's yaw rate 75.1 times that of (5.4), the others of ``ziaukas_2023``."""
