"""The one signal a series trailer offers: its yaw rate from the wheel speeds (Ziaukas 2023, eqs 4.22, 4.24, 5.2)."""

OUTPUTS: dict[str, str] = {"yaw_rate_trailer": "yaw_rate_trailer"}
