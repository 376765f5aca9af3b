"""Square-root filters: the numbers of EKF and UKF, and right ones where covariances lose their digits."""

from fractions import Fraction

import numpy as np
import pytest
import sympy as sp

from harness.engine.compile import compile_model
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.models.assembly.assemble import assemble
from harness.simulation.simulate import in_lanes
from harness.testing.small_models import P0, RATE, STEP, Q, R, curved, drive_linear, linear, module

NEARLY = 1e-9
"""By how much the second of two sensors differs from the first, and their standard deviation."""


def constants():
    """Three constants, and two sensors that see nearly the same sum of them (Dyer and McReynolds 1969)."""
    states = ("alpha_test", "beta_test", "gamma_test")

    def equations(v):
        a, b, c = (v.state(s) for s in states)
        for s in states:
            v.derivative(s, sp.Integer(0))
        v.port("product_test", a + b + c)
        v.port("second_product_test", a + b + (1 + sp.Float(NEARLY)) * c + 0 * v.p("rate") * v.input("push_test"))

    outputs = {"product_test": "product_test", "second_product_test": "second_product_test"}
    vehicle = module(
        "constants_test",
        STATES=states,
        INPUTS=("push_test",),
        PARAMETERS=(RATE,),
        AXLES={},
        VALID={},
        equations=equations,
    )
    return assemble(vehicle, sensors=module("sensors_test", OUTPUTS=outputs))


def exact(samples):
    """Return the covariance of the constants after so many samples, in rational numbers."""
    d = Fraction(NEARLY)
    rows = [[Fraction(1)] * 3, [Fraction(1), Fraction(1), 1 + Fraction(float(1 + d)) - 1]]
    information = sp.eye(3)
    for row in rows:
        h = sp.Matrix([[sp.Rational(v.numerator, v.denominator) for v in row]])
        information += samples * h.T * h / sp.Rational(d.numerator, d.denominator) ** 2
    return np.array(information.inv().evalf(30).tolist(), dtype=float)


def steps(kind, compiled, u, y, q, r, p0, settings=None):
    estimator = CompiledEstimator(kind, compiled, settings)
    belief = estimator.belief(compiled.constants(in_lanes(np.array([1.5]))), in_lanes(q), in_lanes(r))
    state = estimator.init(np.zeros(compiled.nx), p0)
    means, covariances, likelihoods, repairs = [], [], [], 0.0
    for k in range(1, len(y)):
        state, info = estimator.step(state, in_lanes(u[k - 1]), in_lanes(u[k]), in_lanes(y[k]), belief)
        means.append(state.mean[:, 0].copy())
        covariances.append(state.covariance[:, :, 0].copy())
        likelihoods.append(info.log_likelihood[0, 0])
        repairs += info.repairs[0, 0]
    return np.array(means), np.array(covariances), np.array(likelihoods), repairs


@pytest.mark.parametrize("kind", ["sr_ekf", "sr_ukf"])
def test_where_sensors_are_nearly_alike_and_nearly_exact_the_covariance_stays_right(kind):
    """Of a covariance nothing is left after the first sample: what the second sensor adds is 1e-18 of it."""
    compiled = compile_model(constants(), STEP)
    u, y, small = np.zeros((4, 1)), np.zeros((4, 2)), np.full(2, NEARLY**2)
    zero = np.full(3, 1e-300)
    _, found, _, repairs = steps(kind, compiled, u, y, zero, small, np.ones(3))
    _, plain, _, _ = steps(kind.removeprefix("sr_"), compiled, u, y, zero, small, np.ones(3))
    off, without = (np.abs(c[0] / exact(1) - 1).max() for c in (found, plain))
    assert off < 1e-5
    assert without > 1e-3
    assert np.abs(found[2] / exact(3) - 1).max() < 1e-5
    assert repairs == 0


@pytest.mark.parametrize("settings", [{}, {"alpha": 0.1, "kappa": 0.0}])
@pytest.mark.parametrize("kind", ["sr_ekf", "sr_ukf"])
@pytest.mark.parametrize("model", [linear, curved])
def test_elsewhere_it_is_the_filter_without_a_square_root(kind, model, settings):
    """With a centre of negative weight too, which is taken away from the factor."""
    if kind == "sr_ekf" and settings:
        pytest.skip("the EKF has no points")
    compiled = compile_model(model(), STEP, signals=("beta_test",))
    u, y, *_ = drive_linear(200)
    q, r, p0 = Q[: compiled.nx], R[: compiled.ny], P0[: compiled.nx]
    y = y[:, : compiled.ny].copy()
    y[20:30] = np.nan
    y[40, 0] = np.nan
    found = steps(kind, compiled, u, y, q, r, p0, settings)
    plain = steps(kind.removeprefix("sr_"), compiled, u, y, q, r, p0, settings)
    for mine, theirs in zip(found[:3], plain[:3], strict=True):
        np.testing.assert_allclose(mine, theirs, rtol=1e-7, atol=1e-9)
