"""What values a vehicle can have: bounds of each parameter, and relations between them."""

from __future__ import annotations

from collections.abc import Mapping

from models import registry
from models.contracts import ModelError, Parameter


def quantity(value: float, unit: str) -> str:
    """Write a number with its unit, short."""
    return f"{value:g}" if unit in ("", "dimensionless") else f"{value:g} {unit}"


def out_of_bounds(parameter: Parameter, value: float) -> str | None:
    """Say which bound a value breaks, or return ``None``."""
    if parameter.lower <= value <= parameter.upper:
        return None
    side, bound = ("below", parameter.lower) if value < parameter.lower else ("above", parameter.upper)
    least = "smallest" if side == "below" else "largest"
    unit = parameter.unit
    return (
        f"{parameter.name} = {quantity(value, unit)} lies {side} {quantity(bound, unit)}, the {least} value "
        f"allowed; give one from {parameter.lower:g} to {quantity(parameter.upper, unit)}"
    )


def broken_relations(vehicle: str, values: Mapping[str, float]) -> list[tuple[str, str]]:
    """Return ``(parameter, what is wrong)`` for values that are impossible together.

    Args:
        vehicle: File in ``models/vehicles``; its optional ``check(values)`` is asked.
        values: All parameters, SI.
    """
    check = getattr(registry.load("models.vehicles", vehicle), "check", None)
    if check is None:
        return []
    try:
        return list(check(dict(values)))
    except KeyError as missing:
        raise ModelError(f"vehicle '{vehicle}': check() reads {missing}, which has no value") from None
