"""Every combination of the parts of a model, assembled once, and numbers to evaluate it with."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator, Mapping
from functools import cache
from types import ModuleType
from typing import Any

import numpy as np
import sympy as sp

from harness.common import components
from harness.common.components import remembered
from harness.common.errors import ModelError
from harness.common.registry import Role
from harness.models.assembly.assemble import StateSpaceModel, assemble, symbol
from harness.models.roles import ROLES

_COMPILED: dict[Any, Any] = {}


class ContractError(AssertionError):
    """A component that does not keep the contract of its role; the message says in what."""


def require(holds: object, what: str) -> None:
    """Raise ``ContractError`` with the sentence if something does not hold."""
    if not holds:
        raise ContractError(what)


@contextlib.contextmanager
def named(role: Role, component: str | ModuleType) -> Iterator[str]:
    """Give the name of a component; a module is registered as long as the block lasts, unless it is a component."""
    if isinstance(component, str):
        role.load(component)
        yield component
        return
    name = components.name_of(component)
    component_there = role.components().get(name)
    if component_there is not None and component_there.load() is component:
        yield name
        return
    components.register(role.word, component, name)
    try:
        yield name
    finally:
        components.unregister(role.word, name)


def load(role: str, name: str) -> ModuleType:
    """Return a part of a model by role and name."""
    return ROLES[role].load(name)


def tyres_of(vehicle: str) -> list[str | None]:
    """Return the tyres a vehicle can roll on: all of them, or none for a vehicle without axles."""
    return list(ROLES["tyres"].names()) if load("vehicles", vehicle).AXLES else [None]


def sets_of(vehicle: str) -> list[str]:
    """Return the parameter sets of a vehicle."""
    return [s for s in ROLES["parameters"].names() if vehicle == load("parameters", s).VEHICLE]


@remembered
@cache
def model(vehicle: str, tyre: str | None, sensors: str | None = None) -> StateSpaceModel:
    """Return a model without effects, assembled once."""
    return assemble(vehicle, tyre, (), sensors)


@remembered
@cache
def fitting_sensors(vehicle: str, tyre: str | None) -> tuple[str, ...]:
    """Return the sets of sensors that measure what a vehicle publishes, the one that measures most first."""
    sizes: dict[str, int] = {}
    for sensors in ROLES["sensors"].names():
        with contextlib.suppress(ModelError):
            sizes[sensors] = len(model(vehicle, tyre, sensors).outputs)
    return tuple(sorted(sizes, key=lambda name: -sizes[name]))


def evaluate(built: StateSpaceModel, expressions: list[sp.Expr], numbers: Mapping[str, float]) -> np.ndarray:
    """Return the values of expressions over states, inputs, parameters and ports."""
    names = [*built.states, *built.inputs, *built.parameter_names]
    key = (id(built), tuple(expressions))
    if key not in _COMPILED:
        ports = [(symbol(n), e) for n, e in built.ports.items()]
        heaviside = {"Heaviside": lambda x, half=0.5: 1.0 if x > 0 else half if x == 0 else 0.0}
        arguments = [symbol(n) for n in names]
        f = sp.lambdify(arguments, expressions, [heaviside, "math"], cse=lambda e: (ports, e))
        _COMPILED[key] = built, f  # keeps the model alive, so that its id stays its own
    return np.array(_COMPILED[key][1](*[numbers[n] for n in names]), dtype=float)


def random_point(built: StateSpaceModel, vehicle: str, rng: np.random.Generator) -> dict[str, float]:
    """Return states inside ``VALID``, inputs of a drive, and the values of a parameter set of the vehicle."""
    point = {}
    for name in built.states:
        limit = built.valid.get(name, 1e4 if "force" in name else 1.0)
        point[name] = rng.uniform(-1, 1) * limit
    ranges = {"speed": (0.0, 40.0), "time": (0.0, 100.0), "speed_rate": (-8.0, 4.0)}
    for name in built.inputs:
        point[name] = rng.uniform(*ranges.get(name, (-1.0, 1.0)))
    tables = [load("parameters", name).VALUES for name in sets_of(vehicle)]
    most = max(len(table.keys() & built.parameter_names) for table in tables)  # not those for another tyre
    values = rng.choice([table for table in tables if len(table.keys() & built.parameter_names) == most])
    return {**point, **{n: values[n] for n in built.parameter_names if n in values}}
