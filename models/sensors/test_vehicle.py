"""The sensors of the test vehicle: both yaw rates, articulation angle, force of axle 21 (Ziaukas 2023, eq. 4.23)."""

OUTPUTS: dict[str, str] = {
    "yaw_rate_tractor": "yaw_rate_tractor",
    "yaw_rate_trailer": "yaw_rate_trailer",
    "articulation_angle": "articulation_angle",
    "lateral_force_axle_21": "lateral_force_axle_21",
}
