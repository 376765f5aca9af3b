"""From a model's equations to compiled kernels.

The kernels are generated as a Python module of numba functions over lanes (``harness.engine.simd.lanes``), written to a
cache folder under a name that holds the hash of everything that shaped it, and imported from there, so that
numba's disk cache applies and a second start is warm.

A compiled model offers, with ``x (nx, LANES)``, ``u (nu, LANES)``, ``p (np, LANES)``, constants ``c (nc, LANES)``
and a work array ``w (nw, LANES)``:

==========================================  ================================================================
``constants(p, c)``                         what depends on parameters only, of batches ``(..., nc, LANES)``
``drift(x, u, c, dx)``                      dx/dt; of a discrete model the state one sample later
``drift_jacobian(x, u, c, J)``              d(dx/dt)/dx, dense ``(nx, nx, LANES)``
``next_state(x, u, c, xn, w)``              one sample ahead (Ziaukas 2.9 for Euler)
``next_jacobian(x, u, c, xn, A, w)``        the same and A = d(next x)/dx, dense
``next_covariance(x, u, c, P, xn, Pn, w)``  the same and A P A', the prediction (2.13) without process noise
``next_linear(x, u, c, d, P, xn, Pn, w)``   the same of a state ``x + d`` as linearised about x: next(x) + A d
``leading_part(x, u, c, w)``                what of ``next_state`` depends on the first ``LEADING`` states only, into w
``next_state_behind(x, u, c, xn, w)``       one sample ahead of a state with these first states; takes up ``w``
``output(x, u, c, y)``                      y = h(x, u)
``output_jacobian(x, u, c, y, H)``          the same and H = dh/dx, dense ``(ny, nx, LANES)``
``signals(x, u, c, s)``                     further quantities asked for, ``(ns, LANES)``
``signals_jacobian(x, u, c, J)``            their derivatives to the states, dense ``(ns, nx, LANES)``
==========================================  ================================================================

Of a model whose effects may be absent, ``next_state`` in stages leaves out the states of those that are, and without
Jacobians ``drift`` does not write their rows.

Where derivatives to inputs or parameters are asked for there are ``drift_input_jacobian(x, u, c, J)``,
``drift_parameter_jacobian(x, u, c, J)`` and ``output_parameter_jacobian(x, u, c, J)``. ``SEEN_STATES (ny, nx)`` holds
the columns of ``H`` that may differ from zero, row by row, and then -1. Of a model with parameters among its states
``within_bounds(x, u, c, b)`` gives those states within the bounds of the parameters, ``PARAMETERS`` is their number,
``CONSIDERED`` says which of them are left alone, ``SLOPES_VARY`` which have an influence that depends on the states.

The same kernels are compiled over lanes of another kind by their sources. A controller has one run: over lanes of width
one they are scalar double-precision code of the same operations in the same order. Derivatives need seven digits: of
single-precision numbers one register holds twice as many.
"""

from __future__ import annotations

import functools
import hashlib
import importlib
import importlib.util
import inspect
import re
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from threading import RLock
from types import ModuleType
from typing import Any

import numba
import numpy as np
import sympy
from numba.core.dispatcher import Dispatcher
from numba.extending import _Intrinsic

from harness.common import places
from harness.common.arrays import batches
from harness.common.cache import TEXT, cache_folder, kept
from harness.common.errors import ModelError, UserError
from harness.common.sources import digest, is_own
from harness.engine import kernel_names
from harness.engine.codegen.derivatives import Equations, derive
from harness.engine.codegen.identity import identity
from harness.engine.codegen.integrators import sampled
from harness.engine.codegen.printer import constants_kernel, kernel, matrix, vector
from harness.engine.kernel_source import JIT, Kernel, kernel_source
from harness.engine.simd import (
    dual,
    dual_functions,
    lanes,
)
from harness.engine.simd import (
    functions as lane_math,
)
from harness.models.assembly.assemble import StateSpaceModel
from harness.models.assembly.degradation import refuse_degradations
from harness.models.signals import turn_of

INTEGRATORS = ("euler", "heun", "rk4")

HEADER = f"""\
import numpy as np
from numba import njit
from {lanes.__name__} import LANES, absolute, any_of, floor, get, is_nan, put, select, splat, sqrt
from {lane_math.__name__} import atan, cos, exp, log, maximum, minimum, sign, sin, tan, tanh

{JIT}
"""


@dataclass(frozen=True)
class Exchange:
    """Other numbers for the same kernels.

    Attributes:
        modules: Which module the numbers come from in place of another.
        any_code: Whether machine code written for the first numbers (intrinsics) holds for these as well.
        rewrite: What else becomes of the source of a module; by default nothing.
    """

    modules: Mapping[ModuleType, ModuleType]
    any_code: bool
    rewrite: Callable[[str], str] = str


DUALS = Exchange({lanes: dual, lane_math: dual_functions, kernel_names: kernel_names}, any_code=False)

_FROM = re.compile(r"^from[ \t]+(\.*[\w.]*)[ \t]+import\b", re.MULTILINE)
_WHOLE = re.compile(r"^import[ \t]+([\w.]+)", re.MULTILINE)
_generated: set[str] = set()
_importing = RLock()


def is_on_disk(function: Dispatcher) -> bool:
    """Return whether numba's cache has machine code of a function (of any processor or card); yes without a cache."""
    if not hasattr(function, "stats"):
        return True  # numba's simulator of a card compiles nothing
    names, folder = f"{function.py_func.__module__}.{function.py_func.__name__}-*.nbi", function.stats.cache_path
    return folder is None or any(Path(folder).glob(names))


def load_source(stem: str, source: str) -> ModuleType:
    """Write generated source to the cache under ``<stem>_<hash>.py`` and import it.

    The hash covers the source, the modules it imports and the compiler's version, because numba's own cache
    looks at the time stamp of the calling file only.
    """
    homes = {_module(name) for pattern in (_FROM, _WHOLE) for name in pattern.findall(source)}
    own = sorted((h for h in homes if h and is_own(h) and h.__name__ not in _generated), key=lambda h: h.__name__)
    covered = "\n".join([numba.__version__, np.__version__, digest(own), source])
    name = f"{stem}_{hashlib.sha256(covered.encode()).hexdigest()[:16]}"
    with _importing:
        _generated.add(name)
        return sys.modules.get(name) or _imported(name, source)


def _imported(name: str, source: str) -> ModuleType:
    folder = cache_folder()
    path = folder / f"{name}.py"
    if not path.exists():
        try:
            places.write(path, source.encode())  # whole, so another process never imports half a file
        except OSError as error:
            raise UserError(
                f"cannot write compiled models to {folder}: {error.strerror}; set HARNESS_CACHE to a folder you own"
            ) from error
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    sys.modules[name] = module
    spec.loader.exec_module(module)
    return module


def _module(name: str, package: str = "") -> ModuleType | None:
    """Return a module by the name that a statement imports it by; ``None`` if it is none."""
    try:
        return importlib.import_module(importlib.util.resolve_name(name, package))
    except ImportError:
        return None


def written_over(source: str, exchange: Exchange, package: str = "") -> str:
    """Return the source of a module of kernels that takes its numbers from other modules.

    What is written over the exchanged modules, such as linear algebra, is itself generated anew, whatever its name.

    Args:
        source: Statements ``from module import names`` at the margin are looked at.
        exchange: What is taken in place of what.
        package: Against which relative imports are resolved.

    Raises:
        ModelError: If it imports machine code that does not hold for the other numbers.
    """
    homes = {name: home for name in set(_FROM.findall(source)) if (home := _module(name, package)) and is_own(home)}
    others = {name: _counterpart(home, exchange) for name, home in homes.items()}
    if others != homes:
        source = _FROM.sub(
            lambda match: f"from {others[match[1]].__name__} import" if match[1] in others else match[0], source
        )
    return exchange.rewrite(source)


def _counterpart(home: ModuleType, exchange: Exchange) -> ModuleType:
    """Return what stands for a module once others are exchanged; itself, if it is not written over them."""
    if home in exchange.modules:
        return exchange.modules[home]
    written_here = [v for v in vars(home).values() if getattr(v, "__module__", None) == home.__name__]
    has_code = any(isinstance(v, _Intrinsic) for v in written_here)
    if home in exchange.modules.values() or not (has_code or any(isinstance(v, Dispatcher) for v in written_here)):
        return home
    source, spec = inspect.getsource(home), home.__spec__
    written = written_over(source, exchange, spec.parent or "" if spec else "")
    if written == source:
        return home
    if has_code and not exchange.any_code:
        raise ModelError(f"{home.__file__}: it writes machine code for plain lanes, which holds for no other numbers")
    return load_source(home.__name__.rpartition(".")[2], written)


def over_duals(source: str) -> str:
    """Return the same module over dual numbers, whose kernels carry derivatives (``harness.engine.simd.dual``)."""
    return written_over(source, DUALS)


def paste(
    compiled: CompiledModel, stem: str, functions: Sequence[Kernel], given: Mapping[Any, Any] | None = None
) -> str:
    """Return the source of a module that runs functions on a compiled model's kernels, over the same numbers.

    Args:
        compiled: The model.
        stem: What the module does.
        functions: Ordinary functions; those they call come with them.
        given: What their stand-ins stand for, in addition to the names of the model.

    Raises:
        ModelError: If a function uses an undefined name.
    """
    source = kernel_source(f"{stem} on {compiled.kernels.__name__}", functions, compiled.kernels, given)
    return over_duals(source) if compiled.duals else source


class CompiledModel:
    """A model with its kernels.

    Attributes:
        model: The equations.
        kernels: Module of the compiled functions listed above.
        step_size: Sample time in s.
        signal_names: Names of the quantities that ``kernels.signals`` computes.
        nx, nu, ny, nc, nw: Lengths of state, input, output, constants and work array.
        lanes: Length of the last axis of every array of the kernels.
        duals: Whether the kernels run over dual numbers.
    """

    def __init__(self, model: StateSpaceModel, kernels: ModuleType, step: float, signals: Sequence[str]) -> None:
        self.model, self.kernels, self.step_size = model, kernels, step
        self.signal_names = tuple(dict.fromkeys(signals))
        self.nx, self.nu, self.ny = len(model.states), len(model.inputs), len(model.outputs)
        self.nc, self.nw = max(1, int(kernels.CONSTANTS) + len(kernels.CONDITIONS)), int(kernels.NW)
        self.lanes = int(kernels.LANES)
        self.duals = self.lanes == dual.LANES
        names = model.parameter_names
        self._amplitudes = sorted({names.index(n) for of_flag in model.flags.values() for n in of_flag})
        neutral = [model.parameters[row].neutral for row in self._amplitudes]
        self._neutral = np.array([np.nan if value is None else value for value in neutral]).reshape(-1, 1)
        self._of_condition = np.zeros((len(kernels.CONDITIONS), len(self._amplitudes)), dtype=bool)
        for row, flags in zip(self._of_condition, kernels.CONDITIONS, strict=True):
            row[[self._amplitudes.index(names.index(n)) for flag in flags for n in model.flags[flag]]] = True

    def parameter_vector(self, values: dict[str, float]) -> np.ndarray:
        """Return the parameters in the model's order, shape ``(np,)``."""
        missing = [n for n in self.model.parameter_names if n not in values]
        if missing:
            raise UserError(f"no value for {', '.join(missing)} of model '{self.model.name}'")
        return np.array([float(values[n]) for n in self.model.parameter_names])

    def constants(self, parameters: np.ndarray) -> np.ndarray:
        """Return the constants for parameter vectors of shape ``(np, lanes)``, shape ``(nc, lanes)``.

        Of several batches both have their axis in front.
        """
        given = batches(np.ascontiguousarray(parameters, dtype=float), 2)
        c = np.zeros((len(given), self.nc, self.lanes))
        self.kernels.constants(given, c)
        first, conditions = int(self.kernels.CONSTANTS), self._of_condition
        c[:, first : first + len(conditions)] = (self._in_force(given) @ conditions.T)[:, :, None]
        return c[0] if np.ndim(parameters) == 2 else c

    def _in_force(self, given: np.ndarray) -> np.ndarray:
        """Return of each batch whether amplitudes, in lanes or duals, are other than neutral or have a slope."""
        amplitudes = given[:, self._amplitudes]
        moved: np.ndarray = np.any(amplitudes[:, :, : lanes.LANES] != self._neutral, axis=2)
        return moved | np.any(amplitudes[:, :, lanes.LANES :], axis=2)


@functools.lru_cache(maxsize=64)
def compile_model(
    model: StateSpaceModel,
    step: float = 0.01,
    integrator: str = "euler",
    substeps: int = 1,
    signals: tuple[str, ...] = (),
    parameters: tuple[str, ...] = (),
    duals: bool = False,
    jacobians: bool = True,
) -> CompiledModel:
    """Return the compiled kernels of a model.

    Args:
        model: The model; augmented already if inputs are to be estimated.
        step: Sample time in s.
        integrator: ``euler`` (as the thesis), ``heun`` or ``rk4``; a discrete model has none and takes any.
        substeps: Steps of the integrator per sample.
        signals: Quantities that ``kernels.signals`` computes.
        parameters: Parameters whose derivatives are wanted.
        duals: Whether the kernels run over dual numbers, which carry derivatives along any direction.
        jacobians: Whether derivatives are wanted; a large model is there much sooner without those of its kernels.

    Raises:
        UserError: If the integrator is unknown, the cache folder cannot be written, or the model has no equations.
    """
    if model.opaque:
        raise UserError(f"'{model.name}' has no equations that could be compiled; take a vehicle of the library")
    if integrator not in INTEGRATORS:
        raise UserError(f"unknown integrator '{integrator}'; there are: {', '.join(INTEGRATORS)}")
    if model.discrete:
        integrator, substeps = "euler", 1
    source = _source(model, signals, parameters, jacobians, step, integrator, substeps)
    if duals:
        refuse_degradations(model)
        source = over_duals(source)
    return CompiledModel(model, load_source(f"model_{model.name.replace('+', '_')}", source), step, signals)


@functools.lru_cache(maxsize=8)
def _source(
    model: StateSpaceModel,
    signals: tuple[str, ...],
    parameters: tuple[str, ...],
    jacobians: bool,
    step: float,
    integrator: str,
    substeps: int,
) -> str:
    """Return the source, which is the same for kernels over lanes and over duals, kept from earlier processes."""

    def derived() -> str:
        return model_source(derive(model, signals, parameters, jacobians), step, integrator, substeps, jacobians)

    name = identity(model)
    if name is None:
        return derived()
    wanted = (sympy.__version__, digest([sys.modules[__name__]]), signals, parameters, jacobians, step)
    # The digest is the same whatever modules are called; the source names those that it imports.
    key = f"{wanted} {integrator} {substeps}\n{HEADER}\n{name}"
    return kept("kernels", key, derived, TEXT)


def _seen(eqs: Equations) -> list[list[int]]:
    """Return the columns of the output Jacobian that may differ from zero, row by row, then -1."""
    nx = len(eqs.derivatives)
    rows = [sorted(j for a, j in eqs.output_state_jacobian if a == row) for row in range(len(eqs.outputs))]
    return [[*row, *[-1] * (nx - len(row))] for row in rows]


def model_source(eqs: Equations, step: float, integrator: str, substeps: int, jacobians: bool = True) -> str:
    """Return the source text of a model's kernels."""
    nx, nu, ny = len(eqs.derivatives), len(eqs.model.inputs), len(eqs.outputs)
    y = vector("y", eqs.outputs)
    ahead = sampled(eqs, step, integrator, substeps, jacobians)

    def when(text: Callable[[], str]) -> list[str]:
        return [text()] if jacobians else []

    parts = [
        HEADER,
        f"NX, NU, NY, NS, NW, CONSTANTS = {nx}, {nu}, {ny}, {len(eqs.signals)}, {ahead.work}, {len(eqs.constants)}",
        *when(lambda: f"OUTPUTS_ARE_LINEAR, LEADING = {eqs.outputs_are_linear}, {ahead.leading}"),
        *when(lambda: f"SEEN_STATES = np.array({_seen(eqs)})"),
        constants_kernel(eqs),
        kernel(eqs, "drift", "x, u, c, dx", vector("dx", eqs.derivatives), zeros=jacobians),
        *when(lambda: kernel(eqs, "drift_jacobian", "x, u, c, J", matrix("J", eqs.state_jacobian, nx, nx))),
        kernel(eqs, "output", "x, u, c, y", y),
        *when(
            lambda: kernel(eqs, "output_jacobian", "x, u, c, y, H", y + matrix("H", eqs.output_state_jacobian, ny, nx))
        ),
        kernel(eqs, "signals", "x, u, c, s", vector("s", eqs.signals.values())),
        *when(
            lambda: kernel(
                eqs, "signals_jacobian", "x, u, c, J", matrix("J", eqs.signal_jacobian, len(eqs.signals), nx)
            )
        ),
        *ahead.sources,
    ]
    turns = [turn_of(name) for name in eqs.model.outputs]
    if any(turns):
        parts.append(f"TURNS = np.array({turns})")
    if eqs.within:
        considered = [state in eqs.model.considered for state in eqs.model.within]
        vary = [eqs.slope_varies(state) for state in eqs.model.within]
        numbers = f"CONSIDERED, SLOPES_VARY = np.array({considered}), np.array({vary})"
        parts.append(f"PARAMETERS = {len(considered)}\n{numbers}")
        parts.append(kernel(eqs, "within_bounds", "x, u, c, b", vector("b", eqs.within)))
    if eqs.parameters:
        count = len(eqs.parameters)
        for name, entries, rows, columns in (
            ("drift_input_jacobian", eqs.input_jacobian, nx, nu),
            ("drift_parameter_jacobian", eqs.parameter_jacobian, nx, count),
            ("output_parameter_jacobian", eqs.output_parameter_jacobian, ny, count),
        ):
            parts.append(kernel(eqs, name, "x, u, c, J", matrix("J", entries, rows, columns)))
    # What all kernels above have asked for.
    parts.insert(1, f"CONDITIONS = {tuple(tuple(sorted(flags)) for flags in eqs.conditions)}")
    return "\n\n\n".join(parts) + "\n"


SINGLES = 2 * lanes.LANES
"""Single-precision numbers in a lane of ``over_singles``."""


def in_one_lane(source: str) -> str:
    """Return the source of a kernel module over lanes of width one, and of everything it is written over."""
    return written_over(source, _exchange("one_lane", 1, "float64"))


def over_singles(source: str) -> str:
    """Return the source of a kernel module over ``SINGLES`` single-precision numbers in every lane.

    Its arrays of lanes are of ``float32``, and of functions there is what ``lanes`` has but those of exponents.
    """
    return written_over(source, _exchange("singles", SINGLES, "float32"))


@functools.cache
def _exchange(name: str, width: int, number: str) -> Exchange:
    source = inspect.getsource(lanes)
    for line, other in ((r"LANES = \d+", f"LANES = {width}"), (r"NUMBER = types\.\w+", f"NUMBER = types.{number}")):
        source, count = re.subn(rf"^{line}$", other, source, flags=re.MULTILINE)
        assert count == 1
    return Exchange({lanes: load_source(name, source), kernel_names: kernel_names}, any_code=True)
