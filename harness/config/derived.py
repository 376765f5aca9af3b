"""Quantities that parameters follow from: load of a vehicle, cornering stiffness of its axles, understeer gradient.

A study varies them like parameters. Cornering stiffness and understeer gradient are those at the static loads of the
run, without effects. The stiffness of an axle scales the parameter that its tyre exports as ``STIFFNESS``; the
understeer gradient scales both axles, by opposite factors.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from typing import Any

import numpy as np

from harness.common.components import remembered
from harness.config.bounds import loading, loading_parameters, settled_load
from harness.config.specs import ModelSpec
from harness.models.assembly.assemble import assemble
from harness.models.assembly.straight_axles import StraightAxles
from harness.models.contracts import Parameter
from harness.models.roles import TYRES, VEHICLES

GRADIENT = "understeer_gradient"


def axle_parameters(spec: ModelSpec) -> dict[str, Parameter]:
    """Return cornering stiffness of every axle and understeer gradient, as far as the vehicle has axles and tyres."""
    if (axles := axles_of(spec)) is None:
        return {}
    what = "cornering stiffness at static load, "
    rows = [
        Parameter(_name(group), f"C_{{F,{group}}}", "N/rad", 0.1, 1e9, what + ", ".join(names))
        for group, names in axles.groups.items()
    ]
    if axles.steered:
        first, second = axles.steered
        what = f"slip angle per lateral acceleration of {first} less {second}"
        rows.append(Parameter(GRADIENT, "EG", "rad*s^2/m", -1.0, 1.0, what))
    return {p.name: p for p in rows}


def derived_parameters(spec: ModelSpec) -> dict[str, Parameter]:
    """Return what a study may vary in place of the parameters that follow from it."""
    scaled = spec.tyre is not None and hasattr(TYRES.load(spec.tyre), "STIFFNESS")
    return loading_parameters(spec.vehicle) | (axle_parameters(spec) if scaled else {})


def axle_values(spec: ModelSpec, values: Mapping[str, float] | None = None) -> dict[str, float]:
    """Return the values of ``axle_parameters``, SI units, for the parameters of the model or for others."""
    if (axles := axles_of(spec)) is None:
        return {}
    held = spec.values if values is None else values
    of_axles = {_name(group): float(c) for group, c in axles.stiffness(held).items()}
    if axles.steered:
        first, second = axles.compliances(held)
        of_axles[GRADIENT] = float(first - second)
    return of_axles


def derived_value(spec: ModelSpec, name: str) -> float:
    """Return the value of one of ``derived_parameters`` of a model, SI units.

    Raises:
        ModelError: If the vehicle carries no load whose quantity it could be.
    """
    of_load = name in loading_parameters(spec.vehicle)
    return loading(spec.vehicle, spec.values)[name] if of_load else axle_values(spec)[name]


def settled(spec: ModelSpec, varied: Mapping[str, Any]) -> dict[str, Any]:
    """Return the parameters that change when some quantities are given other values.

    Args:
        spec: The model.
        varied: New values of parameters and of ``derived_parameters``, numbers or arrays of one shape.

    Returns:
        New values by parameter; a derived quantity is replaced by all parameters that follow from it.
    """
    of_axles = {n: v for n, v in varied.items() if n not in spec.values and n in axle_parameters(spec)}
    changed = settled_load(spec.vehicle, spec.values, {n: v for n, v in varied.items() if n not in of_axles})
    if not of_axles:
        return changed
    axles, now = axles_of(spec), {**spec.values, **changed}
    assert axles is not None
    assert spec.tyre is not None
    factors = {g: of_axles[_name(g)] / c for g, c in axles.stiffness(now).items() if _name(g) in of_axles}
    if GRADIENT in of_axles:
        (first, second), gradient = axles.compliances(now), of_axles[GRADIENT]
        # a s - b / s = EG: the compliance of one axle grows as that of the other shrinks
        grown = (gradient + np.sqrt(gradient**2 + 4 * first * second)) / (2 * first)
        factors |= {axles.steered[0]: 1 / grown, axles.steered[1]: grown}
    scaled = TYRES.load(spec.tyre).STIFFNESS
    return changed | {f"{scaled}_{g}": now[f"{scaled}_{g}"] * factor for g, factor in factors.items()}


def axles_of(spec: ModelSpec) -> StraightAxles | None:
    """Return the axles of a model; ``None`` of one without tyres of the library."""
    if not spec.vehicle or spec.tyre is None or not VEHICLES.load(spec.vehicle).AXLES:
        return None
    return _axles(spec.vehicle, spec.tyre)


@remembered
@functools.lru_cache(maxsize=32)
def _axles(vehicle: str, tyre: str) -> StraightAxles:
    return StraightAxles(assemble(vehicle, tyre), VEHICLES.load(vehicle))


def _name(group: str) -> str:
    return f"axle_stiffness_{group}"
