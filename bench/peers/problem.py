"""One estimation problem that every library is given: the equations, the drive and the noise of the mass study.

The source of the compiled model is executed over other numbers (NumPy, extended precision, JAX), so that no
library pays for, or gains from, equations written another way.
"""

from __future__ import annotations

import dataclasses
import inspect
import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any, cast

import numpy as np

from bench.engine import mass_study
from harness.common.arrays import Floats
from harness.engine.compile import CompiledModel
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case

UNIT = Unit(0, 4, 3, 0, 1)
"""Drive 3 of the mass study at 24 t, which is what the filters believe."""

UNSCENTED = {"alpha": 1.0, "beta": 2.0, "kappa": 0.0}
"""The spread of the sigma points in every library: the default of ours (Ziaukas 5.5)."""

_IMPORT = re.compile(r"^(from|import)\b.*$", re.MULTILINE)


@dataclass(frozen=True)
class Problem:
    """What a filter is given.

    Attributes:
        compiled: The model.
        inputs: Known inputs ``(samples, nu)``.
        measurements: ``(samples, ny, batch)``; the first sample is not used.
        constants: Of the model ``(nc, 1)``.
        process, measurement: Variances of the noise per sample, ``(nx,)`` and ``(ny,)``.
        mean, variance: At the first sample, ``(nx,)`` each.
        evaluator: Of the study that the problem is taken from.
        cases: The runs of the batch.
    """

    compiled: CompiledModel
    inputs: Floats
    measurements: Floats
    constants: Floats
    process: Floats
    measurement: Floats
    mean: Floats
    variance: Floats
    evaluator: StudyEvaluator
    cases: tuple[Case, ...]

    @property
    def batch(self) -> int:
        """Number of runs."""
        return self.measurements.shape[2]

    @property
    def steps(self) -> int:
        """Number of steps of a filter."""
        return len(self.inputs) - 1

    @property
    def measured_state(self) -> int:
        """Place of the trailer's yaw rate, which is measured, among the states."""
        return int(self.compiled.model.states.index("yaw_rate_trailer"))

    def groups(self) -> list[list[Case]]:
        """Return the runs as they are computed by ours, ``LANES`` at a time."""
        return [list(self.cases[i : i + LANES]) for i in range(0, self.batch, LANES)]


def problem(kind: str, samples: int, batch: int, settings: Mapping[str, Any] | None = None) -> Problem:
    """Return the problem of an estimator of the mass study.

    Args:
        kind: Of the estimator, e.g. ``"ekf"``.
        samples: Samples of the drive.
        batch: Runs, each with noise of its own.
        settings: Of the estimator, beside those of the study.
    """
    study = mass_study(kind)
    plain = study.estimators[0]  # the tuned filter, if there is one, comes behind it
    plain = dataclasses.replace(plain, settings=plain.settings | dict(settings or {}))
    evaluator = StudyEvaluator(dataclasses.replace(study, estimators=(plain,)))
    cases = tuple(Case(0, r) for r in range(batch))
    measured = []
    for i in range(0, batch, LANES):
        group = list(cases[i : i + LANES])
        simulated = evaluator.simulate(UNIT, group, samples)
        measured.append(evaluator.compiled.measured(simulated.measurements)[:, :, : len(group)])
    group = list(cases[:LANES])
    believed = evaluator.held(UNIT, group, "belief")
    inputs = evaluator.inputs(0, UNIT.drive, simulated, believed).at
    estimator = cast(CompiledEstimator, evaluator.compiled.estimators[0])
    belief, first = estimator.begin(evaluator.believed_by(0, UNIT, group, believed))
    nx = evaluator.compiled.belief.nx
    return Problem(
        evaluator.compiled.belief,
        inputs[:samples, :, 0],
        np.concatenate(measured, axis=2),
        belief.constants[:, :1],
        belief.process_noise[:, 0],
        belief.measurement_noise[:, 0],
        first.mean[:, 0],
        first.covariance[range(nx), range(nx), 0],
        evaluator,
        cases,
    )


def driven(given: Problem) -> Problem:
    """Return the problem with the equations of the plant, whose steering is an input, for simulations without noise."""
    evaluator = given.evaluator
    plant, group = evaluator.compiled.plant, list(given.cases[:LANES])
    values = evaluator.held(UNIT, group, "plant").values
    return dataclasses.replace(
        given,
        compiled=plant,
        inputs=evaluator.compiled.drives[UNIT.drive].plant[: len(given.inputs), :, 0],
        constants=plant.constants(values)[:, :1],
        mean=np.zeros(plant.nx),
    )


def compiled_step(given: Problem) -> Callable[[Floats, int], Floats]:
    """Return the compiled step ``(x, k)`` of one run, as a user of numba would write it."""
    compiled = given.compiled
    x, after, work = (np.zeros((rows, LANES)) for rows in (compiled.nx, compiled.nx, compiled.nw))
    constants, inputs = np.repeat(given.constants, LANES, axis=1), np.repeat(given.inputs[:, :, None], LANES, axis=2)

    def ahead(state: Floats, k: int) -> Floats:
        x[:] = state[:, None]
        compiled.kernels.next_state(x, inputs[k], constants, after, work)
        return after[:, 0].copy()

    return ahead


@dataclass(frozen=True)
class Equations:
    """The equations of a problem over some kind of number; states and inputs are sequences of numbers.

    Attributes:
        ahead: ``(x, u)`` to the next state.
        ahead_and_slope: ``(x, u)`` to the next state and its Jacobian ``(nx, nx)``.
        drift: ``(x, u)`` to the derivative of the state.
        output: ``(x, u)`` to the measured quantities.
        signals: ``(x, u)`` to the quantities that are scored.
        output_and_slope: ``(x, u)`` to those and their Jacobian ``(ny, nx)``.

    All return object arrays.
    """

    ahead: Callable[[Any, Any], Any]
    ahead_and_slope: Callable[[Any, Any], Any]
    drift: Callable[[Any, Any], Any]
    output: Callable[[Any, Any], Any]
    signals: Callable[[Any, Any], Any]
    output_and_slope: Callable[[Any, Any], Any]


def equations(given: Problem, numbers: Mapping[str, Any], kind: Callable[[float], Any] = float) -> Equations:
    """Return the equations of a problem over other numbers; see ``equations_of``."""
    constants = np.array([kind(value) for value in given.constants[:, 0]], dtype=object)
    return equations_of(given.compiled, constants, numbers, kind)


def equations_of(
    compiled: CompiledModel, constants: Any, numbers: Mapping[str, Any], kind: Callable[[float], Any] = float
) -> Equations:
    """Return the equations of a model over other numbers.

    Args:
        compiled: The model.
        constants: Of the model, a sequence of numbers.
        numbers: The functions ``sin, cos, tan, atan, tanh, exp, log, sqrt, absolute, sign, where, maximum, minimum``.
        kind: What a number that stands in the equations becomes.
    """
    names: dict[str, Any] = dict(numbers)
    names |= {
        "np": np,
        "LANES": 1,
        "jit": lambda function: function,
        "njit": lambda **_: lambda function: function,
        "get": lambda array, *index: array[index[0]] if len(index) == 1 else array[index],
        "put": _put,
        "select": numbers["where"],
        "splat": kind,
    }
    exec(compile(_IMPORT.sub("", inspect.getsource(compiled.kernels)), "model", "exec"), names)
    nx, ny, ns, nw = names["NX"], names["NY"], names["NS"], names["NW"]

    def empty(*shape: int) -> Any:
        return np.full(shape, kind(0.0), dtype=object)

    def ahead(x: Any, u: Any) -> Any:
        result = empty(nx)
        names["next_state"](x, u, constants, result, empty(nw))
        return result

    def ahead_and_slope(x: Any, u: Any) -> Any:
        result, slope = empty(nx), empty(nx, nx)
        names["next_jacobian"](x, u, constants, result, slope, empty(nw))
        return result, slope

    def drift(x: Any, u: Any) -> Any:
        result = empty(nx)
        names["drift"](x, u, constants, result)
        return result

    def output(x: Any, u: Any) -> Any:
        result = empty(ny)
        names["output"](x, u, constants, result)
        return result

    def signals(x: Any, u: Any) -> Any:
        result = empty(ns)
        names["signals"](x, u, constants, result)
        return result

    def output_and_slope(x: Any, u: Any) -> Any:
        result, slope = empty(ny), empty(ny, nx)
        names["output_jacobian"](x, u, constants, result, slope)
        return result, slope

    return Equations(ahead, ahead_and_slope, drift, output, signals, output_and_slope)


def _put(value: Any, array: Any, *index: int) -> None:
    array[index] = value


NUMPY = {
    "sin": np.sin,
    "cos": np.cos,
    "tan": np.tan,
    "atan": np.arctan,
    "tanh": np.tanh,
    "exp": np.exp,
    "log": np.log,
    "sqrt": np.sqrt,
    "absolute": np.absolute,
    "sign": np.sign,
    "where": np.where,
    "maximum": np.maximum,
    "minimum": np.minimum,
}
"""The functions over NumPy's numbers, extended precision among them."""
