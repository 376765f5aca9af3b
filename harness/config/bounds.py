"""Bounds of the parameters of a vehicle, and relations between them."""

from __future__ import annotations

import functools
from collections.abc import Callable, Iterable, Mapping
from typing import Any

from harness.common.components import remembered
from harness.common.errors import ModelError
from harness.models.contracts import Parameter
from harness.models.roles import VEHICLES


def quantity(value: float, unit: str) -> str:
    """Write a number with its unit, short."""
    return f"{value:g}" if unit in ("", "dimensionless") else f"{value:g} {unit}"


def out_of_bounds(parameter: Parameter, value: float) -> str | None:
    """Return the bound that a value breaks in words, or ``None``."""
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
        vehicle: File in ``models/vehicles``, whose optional ``check(values)`` is asked; empty for one without.
        values: All parameters, SI.
    """
    check = _check(vehicle)
    if check is None:
        return []
    try:
        return list(check(dict(values)))
    except KeyError as missing:
        raise ModelError(f"vehicle '{vehicle}': check() reads {missing}, which has no value") from None


@remembered
@functools.lru_cache(maxsize=64)
def _check(vehicle: str) -> Callable[[dict[str, float]], Iterable[tuple[str, str]]] | None:
    return getattr(VEHICLES.load(vehicle), "check", None) if vehicle else None


def loading_parameters(vehicle: str) -> dict[str, Parameter]:
    """Return the quantities that describe a vehicle's load, from which several of its parameters follow together."""
    return dict(_loading_parameters(vehicle))


@remembered
@functools.lru_cache(maxsize=64)
def _loading_parameters(vehicle: str) -> dict[str, Parameter]:  # looking for the vehicle reads folders
    return {p.name: p for p in getattr(VEHICLES.load(vehicle), "LOADING", ())} if vehicle else {}


def loading(vehicle: str, values: Mapping[str, float]) -> dict[str, float]:
    """Return the load that a vehicle of these parameters carries, by ``loading_parameters``."""
    return dict(VEHICLES.load(vehicle).loading(values)) if loading_parameters(vehicle) else {}


def settled_load(vehicle: str, values: Mapping[str, float], varied: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters that change when some quantities are given other values.

    Args:
        vehicle: File in ``models/vehicles``.
        values: All parameters, SI.
        varied: New values of parameters and of quantities of the load, numbers or arrays of one shape.

    Returns:
        New values by parameter; a quantity of the load is replaced by all parameters that follow from it.
    """
    of_load = {name: varied[name] for name in loading_parameters(vehicle) if name in varied}
    changed = {name: value for name, value in varied.items() if name not in of_load}
    if of_load:
        load = {**loading(vehicle, values), **of_load}
        changed |= VEHICLES.load(vehicle).loaded({**values, **changed}, load)
    return changed
