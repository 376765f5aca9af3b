"""Degradations of sensors in a model: their parameters, and the readings that they act on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import ModuleType

from harness.common.errors import ModelError, UserError
from harness.common.registry import closest
from harness.models.assembly.model import StateSpaceModel
from harness.models.assembly.placement import OF_SIGNAL, degrades, load_effect, parameter_at, split
from harness.models.contracts import Parameter


def apart(
    effects: Sequence[str] | Mapping[str, ModuleType],
) -> tuple[dict[str, ModuleType], dict[str, ModuleType]]:
    """Return effects that are equations, and degradations of sensors, each in their order, with their files."""
    effects = effects if isinstance(effects, Mapping) else {name: load_effect(name) for name in effects}
    degradations = {name: file for name, file in effects.items() if degrades(file)}
    return {name: file for name, file in effects.items() if name not in degradations}, degradations


def with_degradations(model: StateSpaceModel, degradations: Mapping[str, ModuleType]) -> StateSpaceModel:
    """Return a model whose sensors are degraded.

    Args:
        model: With its outputs.
        degradations: Files by name in the order they act: ``dropout`` of all outputs with the same parameters, but for
            those that have the unit of the signal, ``dropout@yaw_rate`` of one output with its own.

    Raises:
        ModelError: If an output is not measured, or two degradations of one file share a parameter.
    """
    if not degradations:
        return model
    declared = {p.name: p for p in model.parameters}
    acting = []
    for name, file in degradations.items():
        only = split(name)[1]
        if only is not None and only not in model.outputs:
            raise ModelError(f"'{name}': the sensors do not measure '{only}'{closest(only, list(model.outputs))}")
        outputs = list(model.outputs) if only is None else [only]
        own = {p.name: p for output in outputs for p in (parameter_of(each, name, output) for each in file.PARAMETERS)}
        if taken := declared.keys() & own.keys():
            raise ModelError(f"'{name}' declares parameter '{min(taken)}', which exists already")
        declared |= own
        acting += [(name, output) for output in outputs]
    effects = (*model.effects, *degradations)
    return replace(model, parameters=tuple(declared.values()), effects=effects, degradations=tuple(acting))


def parameter_of(parameter: Parameter, name: str, output: str) -> Parameter:
    """Return a parameter of a degradation as it is declared for an output."""
    return parameter if split(name)[1] is None and parameter.unit != OF_SIGNAL else parameter_at(parameter, output)


def refuse_degradations(model: StateSpaceModel) -> None:
    """Refuse a model that an estimator shall believe in if it has degradations of sensors.

    Raises:
        UserError: If it has.
    """
    if model.degradations:
        name = model.degradations[0][0]
        raise UserError(
            f"'{name}' degrades the sensors of a plant; no estimator believes in it: remove it from 'effects'"
        )
