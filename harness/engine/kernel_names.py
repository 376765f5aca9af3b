"""The names an estimator's kernels may use.

An estimator file writes its kernels as ordinary functions that import from here. ``harness.engine.kernel_source`` puts
their source behind the compiled kernels of a model, which defines these names for that model. Here they only
make the file importable, so that editors, linters and readers know what they are.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, NamedTuple

from harness.engine.simd.functions import (
    atan,
    cos,
    exp,
    log,
    maximum,
    minimum,
    sign,
    sin,
    tan,
    tanh,
)
from harness.engine.simd.lanes import (
    LANES,
    absolute,
    any_of,
    floor,
    get,
    is_nan,
    put,
    select,
    splat,
    sqrt,
)
from harness.engine.simd.linalg import (
    add_input_errors,
    central_differences,
    cholesky,
    correlated_update,
    cross_covariance,
    deviations,
    mahalanobis,
    outer_sum,
    scalar_updates,
    sigma_mean,
    sigma_update,
)
from harness.engine.simd.random import gather, next_words, normal_pair, uniform

__all__ = [
    "CONSIDERED", "INPUT_ERRORS", "LANES", "LEADING", "NS", "NU", "NW", "NX", "NY", "OUTPUTS_ARE_LINEAR", "PARAMETERS",
    "SEEN_STATES", "SLOPES_VARY", "TURNS", "Belief", "Info", "StandIn", "State",
    "absolute", "add_input_errors", "any_of", "atan", "central_differences", "cholesky", "correlated_update", "cos",
    "cross_covariance", "deviations", "exp", "floor",
    "gather", "get", "is_nan", "leading_part", "log", "mahalanobis", "maximum", "minimum", "next_covariance",
    "next_jacobian", "next_linear", "next_state", "next_state_behind", "next_words", "normal_pair", "outer_sum",
    "output", "output_jacobian", "put", "scalar_updates", "select", "sigma_mean", "sigma_update", "sign", "signals",
    "signals_jacobian", "sin", "splat", "sqrt", "tan", "tanh", "uniform", "within_bounds",
]  # fmt: skip


class StandIn:
    """What a compiled module defines; outside it, it only makes a file importable.

    Args:
        what: Its name in the compiled module, or a function of that name whose docstring says what it does.
    """

    def __init__(self, what: str | Callable[..., Any]) -> None:
        self.name = what if isinstance(what, str) else what.__name__
        self.__doc__ = f"``{self.name}`` of the compiled module." if isinstance(what, str) else what.__doc__

    def __call__(self, *_: Any) -> Any:
        """Refuse: outside compiled modules there is nothing to call."""
        raise RuntimeError(f"'{self.name}' exists in compiled modules only; see harness.engine.kernel_source")


class State(NamedTuple):
    """What an estimator carries from sample to sample; nothing else may be carried.

    Attributes:
        mean: State estimate, shape ``(nx, LANES)``.
        covariance: Its error covariance, shape ``(nx, nx, LANES)``; NaN for an estimator that states none.
        memory: Whatever else the estimator declares by ``memory_size``, shape ``(rows, LANES)``.
    """

    mean: Any
    covariance: Any
    memory: Any


class Belief(NamedTuple):
    """What an estimator believes about the vehicle, fixed for a run.

    Attributes:
        constants: Constants of the model, shape ``(nc, LANES)``.
        process_noise: Variances per step, shape ``(nx, LANES)``.
        measurement_noise: Variances per sample, shape ``(ny, LANES)``.
        tuning: The estimator's own numbers, shape ``(nt,)``.
        input_errors: What the errors of the inputs do at this sample to the state and, behind it, the outputs: of ``m``
            independent ones of unit variance ``(nx + ny, m, LANES)``. Not read where inputs are exact.
        priors: Variance that the state of each parameter begins with, and the square of the change whose influence on
            the measurements tells whether something can be learnt of it, shape ``(parameters, 2)``.
    """

    constants: Any
    process_noise: Any
    measurement_noise: Any
    tuning: Any
    input_errors: Any = None
    priors: Any = None


class Info(NamedTuple):
    """What an estimator says about a step in addition to the state.

    Attributes:
        innovation: Measurement minus its prediction, shape ``(ny, LANES)``; NaN where nothing was measured.
        innovation_covariance: Shape ``(ny, ny, LANES)``.
        nis: Normalised innovation squared, shape ``(LANES,)`` as ``(1, LANES)``.
        log_likelihood: Of the sample's measurements, ``(1, LANES)``.
        seen: Number of measurements used, ``(1, LANES)``.
        repairs: 1 where a covariance factor had to be repaired, ``(1, LANES)``.
    """

    innovation: Any
    innovation_covariance: Any
    nis: Any
    log_likelihood: Any
    seen: Any
    repairs: Any


INPUT_ERRORS: Any = StandIn("INPUT_ERRORS")
"""Whether the estimator is told what the errors of its inputs do (``Belief.input_errors``), fixed when compiled."""


def _of_model(name: str) -> Any:
    return StandIn(name)


NX, NU, NY, NS, NW = (_of_model(n) for n in ("NX", "NU", "NY", "NS", "NW"))
OUTPUTS_ARE_LINEAR, SEEN_STATES, TURNS = (_of_model(n) for n in ("OUTPUTS_ARE_LINEAR", "SEEN_STATES", "TURNS"))
next_state, next_jacobian = _of_model("next_state"), _of_model("next_jacobian")
next_covariance, next_linear = _of_model("next_covariance"), _of_model("next_linear")
LEADING, leading_part, next_state_behind = (_of_model(n) for n in ("LEADING", "leading_part", "next_state_behind"))
output, output_jacobian = _of_model("output"), _of_model("output_jacobian")
signals, signals_jacobian = _of_model("signals"), _of_model("signals_jacobian")
PARAMETERS, CONSIDERED, SLOPES_VARY = (_of_model(n) for n in ("PARAMETERS", "CONSIDERED", "SLOPES_VARY"))
within_bounds = _of_model("within_bounds")
