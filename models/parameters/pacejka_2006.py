"""A car on the tyre 205/60R15 91V of Pacejka 2006, table A3.1, for ``magic_formula_61``.

From the publication: the coefficients of the tyre without camber, for both axles, in the signs of
``magic_formula_61``; its nominal load of 4000 N and pressure of 2.2 bar. Chosen by this project, of the usual size: the
car, whose axles put about the nominal load on each tyre, and all noise.
"""

from math import radians

VEHICLE = "car"
TYRE = "magic_formula_61"

_TYRE: dict[str, float] = {
    "tyres": 2.0,
    "nominal_load": 4000.0,
    "nominal_pressure": 2.2e5,
    "tangent": 1.0,
    "pressure": 2.2e5,
    "pcy1": 1.193,
    "pdy1": 0.990,
    "pdy2": -0.145,
    "pey1": -1.003,
    "pey2": -0.537,
    "pky1": 14.95,
    "pky2": 2.130,
    "pky4": 2.0,
    **{f"ppy{i}": 0.0 for i in range(1, 5)},
}

VALUES: dict[str, float] = {
    "mass": 1600.0,
    "yaw_inertia": 2700.0,
    "cog_to_front_axle": 1.3,
    "cog_to_rear_axle": 1.4,
    "friction": 1.0,
    "steering_ratio": 16.0,
    "reference_from_cog": 0.0,
    "lowest_speed": 1.5,
    **{f"{name}_{axle}": value for axle in ("front", "rear") for name, value in _TYRE.items()},
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
