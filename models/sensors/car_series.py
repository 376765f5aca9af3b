"""Sensors of a car's stability control in addition to its speed: yaw rate and lateral acceleration (Lex 2015)."""

OUTPUTS: dict[str, str] = {"yaw_rate": "yaw_rate", "lateral_acceleration": "lateral_acceleration"}
