"""What the commands share: pairs of name and value, and the parameter set that a vehicle has."""

from __future__ import annotations

from typing import Any

from harness.errors import UserError


def pairs(given: list[str] | None, option: str) -> dict[str, Any]:
    """Read ``NAME=VALUE`` pairs; a value that is a number becomes one, text keeps its unit.

    Raises:
        UserError: If an entry has no name or no value.
    """
    found: dict[str, Any] = {}
    for item in given or []:
        name, equals, text = item.partition("=")
        if not equals or not name.strip() or not text.strip():
            raise UserError(f"{option} '{item}': write NAME=VALUE, e.g. {option} speed=\"10 m/s\"")
        try:
            found[name.strip()] = float(text)
        except ValueError:
            found[name.strip()] = text.strip()
    return found


def parameter_set(vehicle: str, given: str | None) -> str:
    """Return the parameter set asked for, or the vehicle's only one.

    Raises:
        UserError: If none is asked for and the vehicle has none or several.
        ModelError: If there is no such vehicle.
    """
    from models import registry

    registry.load("models.vehicles", vehicle)
    if given is not None:
        return given
    sets = registry.names("models.parameters")
    fit = [n for n in sets if vehicle == registry.load("models.parameters", n).VEHICLE]
    if len(fit) != 1:
        there = ", ".join(fit) or "none, so write one or a TOML parameter file"
        raise UserError(f"--parameters: which set of '{vehicle}'? There are: {there}")
    return fit[0]
