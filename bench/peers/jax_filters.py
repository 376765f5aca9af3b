"""The filters of dynamax and cuthbert on the problem, compiled by JAX over the whole batch, in double precision."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import jax
import jax.numpy as jnp
import numpy as np
from cuthbert.filtering import filter as cuthbert_filter
from cuthbert.gaussian import moments
from dynamax.nonlinear_gaussian_ssm import ParamsNLGSSM, UKFHyperParams, extended_kalman_filter, unscented_kalman_filter

from bench.peers.jax_numbers import JAX
from bench.peers.problem import UNSCENTED, Problem, equations
from bench.peers.reference import first_prediction
from harness.common.arrays import Floats

Filter = Callable[[Any], Any]
"""Measurements of one run ``(steps, ny)`` to means ``(steps, nx)``."""


def _functions(given: Problem) -> tuple[Callable[[Any, Any], Any], Callable[[Any, Any], Any]]:
    eqs = equations(given, JAX)
    return lambda x, u: jnp.stack(list(eqs.ahead(x, u))), lambda x, u: jnp.stack(list(eqs.output(x, u)))


def dynamax(kind: str, given: Problem) -> Filter:
    """Return dynamax's EKF or UKF; it begins with a measurement, so it is given our first prediction."""
    ahead, output = _functions(given)
    first, spread = first_prediction(kind, given)
    parameters = ParamsNLGSSM(
        initial_mean=jnp.asarray(first),
        initial_covariance=jnp.asarray(spread),
        dynamics_function=ahead,
        dynamics_covariance=jnp.diag(jnp.asarray(given.process)),
        emission_function=output,
        emission_covariance=jnp.diag(jnp.asarray(given.measurement)),
    )
    inputs = jnp.asarray(given.inputs[1:])
    wanted = ["filtered_means"]
    if kind == "ekf":
        return lambda y: extended_kalman_filter(parameters, y, inputs=inputs, output_fields=wanted).filtered_means
    spread_of_points = UKFHyperParams(**UNSCENTED)
    return lambda y: (
        unscented_kalman_filter(parameters, y, spread_of_points, inputs=inputs, output_fields=wanted).filtered_means
    )


def cuthbert(kind: str, given: Problem) -> Filter:
    """Return cuthbert's linearised filter, an EKF that carries the square root of the covariance."""
    if kind != "ekf":
        raise ValueError("cuthbert has no filter with sigma points for nonlinear dynamics")
    ahead, output = _functions(given)
    noise, error = jnp.diag(jnp.sqrt(given.process)), jnp.diag(jnp.sqrt(given.measurement))
    built = moments.build_filter(
        jnp.asarray(given.mean),
        jnp.diag(jnp.sqrt(given.variance)),
        lambda state, sample: ((lambda x: (ahead(x, sample["before"]), noise)), state.mean),
        lambda state, sample: ((lambda x: (output(x, sample["now"]), error)), state.mean, sample["y"]),
    )
    before, now = jnp.asarray(given.inputs[:-1]), jnp.asarray(given.inputs[1:])

    def run(y: Any) -> Any:
        states = cuthbert_filter(built, {"before": before, "now": now, "y": y}, built.init_prepare())
        return states.mean[1:]

    return run


def filtering(run: Filter, given: Problem) -> tuple[Callable[[], object], Callable[[], Floats]]:
    """Return what runs a filter over the whole batch, compiled, and what gives the means of the first run."""
    y = jnp.asarray(np.moveaxis(given.measurements[1:], 2, 0))
    compiled = jax.jit(jax.vmap(run))
    return lambda: compiled(y).block_until_ready(), lambda: np.asarray(compiled(y)[0])
