"""Satellite navigation and inertial unit of Sun 2015 (2.22, 2.23): all states of ``car_reference_point``."""

OUTPUTS: dict[str, str] = {
    "lateral_velocity_rear": "lateral_velocity_rear",
    "yaw_rate": "yaw_rate",
    "heading": "heading",
}
