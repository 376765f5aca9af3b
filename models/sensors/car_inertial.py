"""The acceleration sensor of a car: longitudinal (Li et al. 2017, 8, an input there) and lateral (9)."""

OUTPUTS: dict[str, str] = {
    "lateral_acceleration": "lateral_acceleration",
    "longitudinal_acceleration": "longitudinal_acceleration",
}
