"""The trailer's yaw rate and what stability control measures on the tractor: its yaw rate and lateral acceleration."""

OUTPUTS: dict[str, str] = {
    "yaw_rate_trailer": "yaw_rate_trailer",
    "yaw_rate_tractor": "yaw_rate_tractor",
    "lateral_acceleration_tractor": "lateral_acceleration_tractor",
}
