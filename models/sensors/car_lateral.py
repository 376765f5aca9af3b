"""The one output of Li et al. 2017 (9): the lateral acceleration of the car."""

OUTPUTS: dict[str, str] = {"lateral_acceleration": "lateral_acceleration"}
