"""What the tests of the car models share: the reference car, and numbers out of a model's equations."""

from __future__ import annotations

from functools import cache

import numpy as np
import sympy as sp

from harness.models.assembly.assemble import StateSpaceModel, symbol
from harness.models.contracts import DriveContext
from harness.models.roles import PARAMETERS

CAR = dict(PARAMETERS.load("althoff_2020").VALUES)
WHEELS = ("fl", "fr", "rl", "rr")
CONTEXT = DriveContext(2.58, 16.0)
_HEAVISIDE = {"Heaviside": lambda x, half=0.5: 1.0 if x > 0 else 0.0 if x < 0 else half}


@cache
def function_of(model: StateSpaceModel, names: tuple[str, ...]):
    """Return ``f(**states and inputs and parameters)``: derivatives of the states, then the named quantities."""
    read = [*model.states, *model.inputs, *model.parameter_names]
    ports = [(symbol(n), e) for n, e in model.ports.items()]
    wanted = [*model.derivatives, *(model.resolve(n) for n in names)]
    f = sp.lambdify([symbol(n) for n in read], wanted, [_HEAVISIDE, "math"], cse=lambda e: (ports, e))
    return lambda point: np.array(f(*[point[n] for n in read]), dtype=float)
