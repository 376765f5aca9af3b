"""The output of the lecture's scalar example: the state itself (KIT 2015, exercise 1)."""

OUTPUTS: dict[str, str] = {"example_state": "example_state"}
