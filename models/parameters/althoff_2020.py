"""BMW 320i of the CommonRoad vehicle models, "vehicle 2", as two-track car (Althoff and Wuersching 2020, tables 6, 7).

From the publication: masses, inertias, lengths, springs, dampers, anti-roll bars, roll centres (on the road), wheel
radius, shape factor ``p_cy1``, friction ``p_dy1`` and cornering stiffness ``p_ky1 F_z`` of its tyre, brake and
engine split. The tyre's stiffness grows in proportion to the load there; ``stiffness_load`` far above any load makes
``c_1 sin(2 atan(F_z / c_2))`` do so. Computed from it, because this vehicle condenses springs and tyres into one roll
stiffness per axle:

* roll stiffness: ``T^2 K_s / 2 - K_ts`` in series with the tyres' ``T^2 K_zt / 2``; roll damping ``T^2 K_sd / 2``
  times the square of the share of the roll angle that falls to the springs;
* camber over roll angle ``1 + D T / 2``, and the camber thrust ``(p_ky1 p_hy3 + p_vy3) / p_ky1`` as a slip angle. The
  publication's multi-body model lets camber push *into* the turn (its tyre formula is for z up, its axes have z
  down) and gives it a jump at no camber; here a wheel that leans outwards pushes outwards, without a jump.

Chosen by this project, because the publication has none: steering ratio, relaxation length, gain of the
speed controller, rolling resistance and air drag, and all noise. The variance of the accelerations is that of Li et
al. 2017.
"""

VEHICLE = "car_two_track"

VALUES: dict[str, float] = {
    "sprung_mass": 965.7108098804363,
    "unsprung_mass_front": 63.7921826056784,
    "unsprung_mass_rear": 63.7921826056784,
    "yaw_inertia": 1791.5995300122856,
    "roll_inertia": 207.26524557936952,
    "cog_to_front_axle": 1.1561957064,
    "cog_to_rear_axle": 1.4227170936,
    "sprung_cog_height": 0.61373004,
    "unsprung_cog_height": 0.344,
    "roll_centre_front": 0.0,
    "roll_centre_rear": 0.0,
    "track_front": 1.38684,
    "track_rear": 1.36398,
    "roll_stiffness_front": 25361.0,
    "roll_stiffness_rear": 18309.0,
    "roll_damping_front": 1193.0,
    "roll_damping_rear": 1176.0,
    "camber_per_roll_front": 0.727,
    "camber_per_roll_rear": 0.3825,
    "camber_thrust": 0.0464,
    "friction": 1.0489,
    "relaxation_length": 0.3,
    "steering_ratio": 16.0,
    "speed_gain": 2.0,
    "driving_share_front": 0.0,
    "braking_share_front": 0.66,
    "rolling_resistance": 0.012,
    "air_drag": 0.4,
    "shape_factor_front": 1.3507,
    "shape_factor_rear": 1.3507,
    "stiffness_peak_front": 21.92e6 / 2,
    "stiffness_peak_rear": 21.92e6 / 2,
    "stiffness_load_front": 1e6,
    "stiffness_load_rear": 1e6,
}

NOISE_STEP = 0.01

PROCESS_NOISE: dict[str, float] = {
    "longitudinal_velocity": 1e-8,
    "lateral_velocity": 1e-7,
    "yaw_rate": 1e-8,
    "roll_angle": 1e-10,
    "roll_rate": 1e-8,
    "lateral_force_axle_fl": 25.0,
    "lateral_force_axle_fr": 25.0,
    "lateral_force_axle_rl": 25.0,
    "lateral_force_axle_rr": 25.0,
    "friction_coefficient": 0.0,
}
"""Variances per step: a road that is not quite even."""

MEASUREMENT_NOISE: dict[str, float] = {
    "lateral_acceleration": 0.005,
    "longitudinal_acceleration": 0.005,
    "yaw_rate": 1e-5,
    "longitudinal_velocity": 1e-2,
}
"""Variances per sample."""
