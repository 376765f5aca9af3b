"""Vehicles given by difference equations: the map itself is the step."""

import numpy as np
import pytest
import sympy as sp

from harness.common.errors import ModelError
from harness.config.model import resolve_single
from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation.observability import _simulate
from harness.models.assembly.assemble import assemble
from harness.models.contracts import Profile
from harness.simulation.simulate import in_lanes
from harness.testing.small_models import module
from support.small_maps import discrete


def curved_map():
    return discrete(3, lambda v, x, u: [x[0] * x[1] + u, sp.sin(x[0]) + 0.5 * x[1], 2 * u])


def step(compiled, x, u):
    nx = compiled.nx
    xn, A, Pn = np.empty((nx, LANES)), np.empty((nx, nx, LANES)), np.empty((nx, nx, LANES))
    c, w = compiled.constants(np.empty((0, LANES))), np.empty((compiled.nw, LANES))
    P = np.random.default_rng(5).normal(size=(nx, nx))
    P = P @ P.T
    compiled.kernels.next_covariance(x, u, c, in_lanes(P), xn, Pn, w)
    again = np.empty_like(xn)
    compiled.kernels.next_jacobian(x, u, c, again, A, w)
    np.testing.assert_array_equal(xn, again)
    compiled.kernels.next_state(x, u, c, again, w)
    np.testing.assert_array_equal(xn, again)
    return xn, A, P, Pn


@pytest.mark.parametrize(("integrator", "substeps"), [("euler", 1), ("rk4", 3)])
def test_the_map_is_the_step_whatever_the_integrator(integrator, substeps):
    compiled = compile_model(curved_map(), 0.1, integrator, substeps)
    a, b, u = np.linspace(-1, 1, LANES), np.linspace(0.5, 2, LANES), np.full(LANES, 0.3)
    x = np.stack([a, b, a + b])
    xn, A, P, Pn = step(compiled, x, u[None])
    np.testing.assert_allclose(xn, [a * b + u, np.sin(a) + 0.5 * b, 2 * u], atol=1e-14)
    zero = np.zeros(LANES)
    exact = np.array([[b, a, zero], [np.cos(a), zero + 0.5, zero], [zero, zero, zero]])
    np.testing.assert_allclose(A, exact, atol=1e-14)
    np.testing.assert_allclose(Pn, np.einsum("ijl,jk,mkl->iml", exact, P, exact), atol=1e-12)


def test_an_unknown_input_becomes_a_random_walk():
    bigger = discrete(1, lambda v, x, u: [0.5 * x[0] + u]).augment(["push_test"])
    compiled = compile_model(bigger)
    x = np.stack([np.full(LANES, 2.0), np.full(LANES, 3.0)])
    xn, A, _, _ = step(compiled, x, np.empty((0, LANES)))
    assert xn[:, 0].tolist() == [4.0, 3.0]
    assert A[:, :, 0].tolist() == [[0.5, 1.0], [0.0, 1.0]]


def vehicle(equations):
    return module(
        "both", STATES=("alpha_test", "beta_test"), INPUTS=(), PARAMETERS=(), AXLES={}, VALID={}, equations=equations
    )


def mixed(v):
    v.next_value("alpha_test", v.state("alpha_test"))
    v.derivative("beta_test", v.state("alpha_test"))


def twice(v):
    v.next_value("alpha_test", v.state("alpha_test"))
    v.next_value("alpha_test", v.state("alpha_test"))


@pytest.mark.parametrize(
    ("equations", "says"),
    [
        (mixed, "derivative for 'beta_test' and a next value for 'alpha_test'"),
        (twice, "next value of 'alpha_test' has two writers"),
        (lambda v: v.next_value("alpha_test", v.state("beta_test")), "no next value for beta_test"),
        (lambda v: v.next_value("gamma_test", v.state("beta_test")), "not a state"),
        (lambda v: [v.next_value(s, sp.Symbol("free")) for s in ("alpha_test", "beta_test")], "reads 'free'"),
    ],
)
def test_wrong_difference_equations_are_refused(equations, says):
    with pytest.raises(ModelError, match=says):
        assemble(vehicle(equations))


@pytest.mark.parametrize("sample_time", ["10 ms", "1 s"])
def test_variances_do_not_grow_with_the_step(sample_time):
    table = {"vehicle": "scalar_example", "parameters": "kit_2015a", "sensors": "example", "step": sample_time}
    assert resolve_single(table, "test").process_noise == {"example_state": 1.0}


def test_observability_runs_the_map_over_a_drive():
    model = discrete(2, lambda v, x, u: [0.5 * x[0] + u, x[0]]).augment(["push_test"])
    time = np.arange(5) * 0.1
    profile = Profile(time, np.zeros(5), np.ones(5))
    x = _simulate(model, np.empty(0), np.empty((5, 0)), profile)
    np.testing.assert_array_equal(x, np.zeros((5, 3)))
    driven = discrete(2, lambda v, x, u: [0.5 * x[0] + u, x[0]])
    x = _simulate(driven, np.empty(0), np.ones((5, 1)), profile)
    np.testing.assert_array_equal(x.T, [[0, 1, 1.5, 1.75, 1.875], [0, 0, 1, 1.5, 1.75]])
