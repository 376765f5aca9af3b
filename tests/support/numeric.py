"""Evaluate an assembled model with plain SymPy and NumPy; the compiled kernels are tested elsewhere."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from types import SimpleNamespace
from typing import Any

import numpy as np
import sympy as sp

from harness.common.arrays import Floats
from harness.models.assembly.assemble import StateSpaceModel, symbol

_COMPILED: dict[tuple[int, tuple[str, ...]], tuple[StateSpaceModel, Callable[..., Any]]] = {}


def evaluator(
    model: StateSpaceModel, values: Mapping[str, float], quantities: Sequence[str] = ()
) -> Callable[[Floats, Floats], Floats]:
    """Return ``f(x, u)``: the derivatives, or the named ports, for states (nx,) and inputs (nu,)."""
    key = (id(model), tuple(quantities))
    if key not in _COMPILED:
        expressions = [symbol(q) for q in quantities] if quantities else list(model.derivatives)
        ports = [(symbol(n), e) for n, e in model.ports.items()]
        arguments = [[symbol(n) for n in part] for part in (model.states, model.inputs, model.parameter_names)]
        raw = sp.lambdify(arguments, expressions, modules="math", cse=lambda e: (ports, e))
        _COMPILED[key] = model, raw  # keeps the model alive, so that its id stays its own
    _, raw = _COMPILED[key]
    p = [float(values[n]) for n in model.parameter_names]
    return lambda x, u: np.array(raw(x, u, p), dtype=float)


def jacobian(f: Callable[[Floats, Floats], Floats], x: Floats, u: Floats, size: Floats) -> Floats:
    """Return df/dx by central differences; ``size`` is the typical magnitude of each state."""
    columns = []
    for i, s in enumerate(size):
        d = np.zeros_like(x)
        d[i] = 1e-5 * s
        columns.append((f(x + d, u) - f(x - d, u)) / (2e-5 * s))
    return np.array(columns).T


def euler(
    f: Callable[[Floats, Floats], Floats], x: Floats, inputs: Floats, step: float, noise: Floats | None = None
) -> Floats:
    """Return the states (samples, nx) of an explicit Euler run over inputs (samples, nu)."""
    run = [np.array(x, dtype=float)]
    for k, u in enumerate(inputs[:-1]):
        following = run[-1] + step * f(run[-1], u)
        run.append(following if noise is None else following + noise[k])
    return np.array(run)


def named(model: StateSpaceModel, x: Floats) -> Any:
    """Return the state vector (or run) as attributes by signal name."""
    return SimpleNamespace(**{n: x[..., i] for i, n in enumerate(model.states)})
