"""Car with three degrees of freedom of Li et al. 2017: their noise on the car of ``althoff_2020``.

From the paper: the process noise ``Q = 0.001 I`` and the measurement noise ``R = 0.005`` (section 3). It prints no
unit for either. ``R`` is read in (m/s^2)^2. ``Q`` is read in m/s, rad and rad/s for the motion, and in units of
1e5 N/rad for the stiffnesses, which makes 1e7 (N/rad)^2: a stiffness then changes by 3 kN/rad per step, 32 kN/rad per
second. In N/rad the same number would hold the stiffnesses fixed for hours. The step it belongs to is taken as
10 ms, as the paper prints none either.

Not from the paper: its table 1 with the car's parameters and first stiffnesses is not at hand. These are those of
``althoff_2020`` condensed to one track; the first stiffnesses are the tyres' slopes at the static loads,
``21.92 F_z``. Its first covariance, the identity, is not used: as in every study, the filters begin with the process
noise, and at the true speed.
"""

VEHICLE = "car_3dof"

VALUES: dict[str, float] = {
    "mass": 1093.2952334674046,
    "yaw_inertia": 1791.5995300122856,
    "cog_to_front_axle": 1.1561957064,
    "cog_to_rear_axle": 1.4227170936,
    "steering_ratio": 16.0,
    "first_stiffness_front": 128300.0,
    "first_stiffness_rear": 106800.0,
}

NOISE_STEP = 0.01

PROCESS_NOISE: dict[str, float] = {
    "longitudinal_velocity": 1e-3,
    "sideslip_angle": 1e-3,
    "yaw_rate": 1e-3,
    "cornering_stiffness_front": 1e7,
    "cornering_stiffness_rear": 1e7,
}

MEASUREMENT_NOISE: dict[str, float] = {
    "lateral_acceleration": 0.005,
    "longitudinal_acceleration": 0.005,
    "yaw_rate": 1e-5,
}
