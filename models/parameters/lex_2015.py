"""Car for the estimation of friction as in Lex 2015, ch. 5.

The page at hand gives the filter and no numbers of its car, so mass, inertia, lengths and axle stiffnesses are those of
the test car of Sun 2015 (3.2): 1707 kg, 2741.9 kg m2, 70 and 65.1 kN/rad per tyre, two tyres an axle.

Chosen by this project: ``stiffness_load``, so that the stiffness still grows with the load; the peaks are then such
that it is Sun's at the static loads of 10433 and 6312 N. Likewise shape factors, steering ratio, sensor noise of a
series car (0.1 deg/s and 0.1 m/s2), the noise of the car's own states, and the random walk of the friction: 0.004 per
step of 10 ms, 0.04 in a second.
"""

from math import radians

VEHICLE = "car_friction"

VALUES: dict[str, float] = {
    "mass": 1707.0,
    "yaw_inertia": 2741.9,
    "cog_to_front_axle": 1.014,
    "cog_to_rear_axle": 1.676,
    "friction": 0.9,
    "steering_ratio": 16.0,
    "lowest_speed": 1.5,
    "shape_factor_front": 1.3,
    "shape_factor_rear": 1.3,
    "stiffness_peak_front": 2.2562e5,
    "stiffness_peak_rear": 3.2309e5,
    "stiffness_load_front": 3e4,
    "stiffness_load_rear": 3e4,
}

NOISE_STEP = 0.01
"""s; the step to which the process-noise variances below belong."""

PROCESS_NOISE: dict[str, float] = {
    "lateral_velocity": 0.002**2,
    "yaw_rate": radians(0.02) ** 2,
    "friction_coefficient": 0.004**2,
}
"""Variances per step in the square of the state's SI unit."""

MEASUREMENT_NOISE: dict[str, float] = {
    "yaw_rate": radians(0.1) ** 2,
    "lateral_acceleration": 0.1**2,
}
"""Variances per sample in SI units."""
