"""Inertial unit with satellite navigation on a car: yaw rate, lateral acceleration, lateral velocity at its point."""

OUTPUTS: dict[str, str] = {
    "yaw_rate": "yaw_rate",
    "lateral_acceleration": "lateral_acceleration",
    "lateral_velocity": "lateral_velocity_reference",
}
