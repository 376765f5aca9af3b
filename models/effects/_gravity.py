"""The acceleration due to gravity, for the effects of a road that is not level and of bodies that roll."""

GRAVITY = 9.81

CONSTANTS: dict[str, str] = {"GRAVITY": "m/s^2"}
