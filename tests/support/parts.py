"""Every combination of the files in ``models/``, assembled once, and numbers to evaluate it with."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache

import numpy as np
import sympy as sp

from harness.models.assembly.assemble import Model, assemble, symbol
from harness.models.roles import ROLES

VEHICLES = ROLES["vehicles"].names()
TYRES = ROLES["tyres"].names()
SENSORS = ROLES["sensors"].names()
EFFECTS = ROLES["effects"].names()
SETS = ROLES["parameters"].names()


def load(role: str, name: str):
    return ROLES[role].load(name)


def tyres_of(vehicle: str) -> list[str | None]:
    """Return the tyres a vehicle can roll on: all of them, or none for a vehicle without axles."""
    return list(TYRES) if load("vehicles", vehicle).AXLES else [None]


_COMPILED: dict = {}

COMBINATIONS = [(v, t) for v in VEHICLES for t in tyres_of(v)]


def sets_of(vehicle: str) -> list[str]:
    return [s for s in SETS if vehicle == load("parameters", s).VEHICLE]


@cache
def model(vehicle: str, tyre: str | None) -> Model:
    return assemble(vehicle, tyre)


def evaluate(built: Model, expressions: list[sp.Expr], numbers: Mapping[str, float]) -> np.ndarray:
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


def random_point(built: Model, vehicle: str, rng: np.random.Generator) -> dict[str, float]:
    """Return states inside ``VALID``, inputs of a drive, and the values of a parameter set of the vehicle."""
    point = {}
    for name in built.states:
        limit = built.valid.get(name, 1e4 if "force" in name else 1.0)
        point[name] = rng.uniform(-1, 1) * limit
    ranges = {"speed": (0.0, 40.0), "time": (0.0, 100.0), "speed_rate": (-8.0, 4.0)}
    for name in built.inputs:
        point[name] = rng.uniform(*ranges.get(name, (-1.0, 1.0)))
    values = load("parameters", rng.choice(sets_of(vehicle))).VALUES
    return {**point, **{n: values[n] for n in built.parameter_names if n in values}}
