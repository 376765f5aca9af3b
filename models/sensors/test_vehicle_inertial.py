"""The sensors of the test vehicle (Ziaukas 2023, eq. 4.23) and an accelerometer on the tractor."""

OUTPUTS: dict[str, str] = {
    "yaw_rate_tractor": "yaw_rate_tractor",
    "yaw_rate_trailer": "yaw_rate_trailer",
    "articulation_angle": "articulation_angle",
    "lateral_force_axle_21": "lateral_force_axle_21",
    "lateral_acceleration_tractor": "lateral_acceleration_tractor",
}
