"""Moving-horizon estimation: against the textbook where all is linear, and against a least-squares solver where not."""

import numpy as np
import pytest
from numba import njit
from scipy.optimize import least_squares

from harness.engine.compile import compile_model
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.testing.estimators import Ground, step_through
from harness.testing.small_models import P0, STEP, Q, R, compiled_linear, curved, drive_linear, textbook
from support.oscillator import VALUES, compiled, drive, mass, run


@pytest.mark.parametrize("settings", [{"window": 1, "iterations": 1}, {"window": 7, "iterations": 3}, {"window": 200}])
def test_on_a_linear_model_it_is_the_kalman_filter_whatever_the_window(settings):
    u, y, A, B, C = drive_linear()
    y[5, 0] = y[9] = y[20:30, 1] = np.nan
    model = compiled_linear()
    ground = Ground(CompiledEstimator("moving_horizon", model, settings), model, np.array([1.5]), Q, R, P0, u, y)
    means, covariances, infos = step_through(ground)
    right, P, likelihoods = textbook(u, y, A, B, C)
    np.testing.assert_allclose(means, right, atol=1e-10)
    np.testing.assert_allclose(covariances, P, atol=1e-10)
    np.testing.assert_allclose([i.log_likelihood[0, 0] for i in infos], likelihoods, atol=1e-9)


def likeliest(u, y, q, r, first, spread):
    """Return the last of the likeliest states of the curved model, by a solver that knows nothing of filters."""

    def residuals(flat):
        x = flat.reshape(-1, 2)
        found = [(x[0] - first) / np.sqrt(spread)]
        for k in range(1, len(x)):
            a, b = x[k - 1]
            ahead = x[k - 1] + STEP * np.array([b, -2.0 * np.sin(a) - 0.2 * b * abs(b) + u[k - 1, 0]])
            found += [(x[k] - ahead) / np.sqrt(q)]
            if np.isfinite(y[k, 0]):
                found += [(y[k] - np.exp(0.3 * x[k, 0]) - x[k, 0] * x[k, 1]) / np.sqrt(r)]
        return np.concatenate(found)

    solved = least_squares(residuals, np.tile(first, len(y)), x_scale="jac", xtol=1e-14, ftol=1e-14, gtol=1e-14)
    return solved.x.reshape(-1, 2)[-1]


@pytest.mark.parametrize(("window", "samples"), [(12, 12), (50, 9)])
def test_it_finds_the_least_squares_of_a_nonlinear_window(window, samples):
    """With noise so large that one linearisation is far off, and a first state that is wrong."""
    rng = np.random.default_rng(11)
    q, r, first, spread = np.array([1e-3, 1e-2]), np.array([4e-2]), np.array([0.8, -0.5]), np.array([0.5, 0.5])
    u = np.sin(0.5 * STEP * np.arange(samples + 1))[:, None]
    x, y = np.array([0.2, 0.3]), np.empty((samples + 1, 1))
    for k in range(samples + 1):
        y[k] = np.exp(0.3 * x[0]) + x[0] * x[1] + rng.normal() * r[0] ** 0.5
        x = x + STEP * np.array([x[1], -2.0 * np.sin(x[0]) - 0.2 * x[1] * abs(x[1]) + u[k, 0]])
        x = x + rng.normal(size=2) * np.sqrt(q)
    y[4] = np.nan
    model = compile_model(curved(), STEP)
    right = likeliest(u, y, q, r, first, spread)

    def last(kind, settings):
        estimator = CompiledEstimator(kind, model, settings)
        belief = estimator.belief(model.constants(np.full((1, 8), 2.0)), np.tile(q[:, None], 8), np.tile(r[:, None], 8))
        state = estimator.init(first, spread)
        for k in range(1, samples + 1):
            state, _ = estimator.step(*(state, *(np.tile(a[:, None], 8) for a in (u[k - 1], u[k], y[k]))), belief)
        return state.mean[:, 0]

    found = last("moving_horizon", {"window": window, "iterations": 30})
    np.testing.assert_allclose(found, right, atol=1e-6)
    assert np.abs(last("ekf", {}) - right).max() > 1e-3


def test_a_mass_that_is_far_off_is_found():
    u, y = drive({**VALUES, "mass": 4.0}, samples=1500, excitation=4.0)
    means, covariances = run("moving_horizon", compiled(mass()), u, y, [0.0], {"window": 5})
    assert np.exp(means[-1, 2]) == pytest.approx(4.0, rel=0.1)
    assert (means[-1, 2] - np.log(4.0)) ** 2 < 9 * covariances[-1, 2, 2]


@pytest.mark.parametrize("first", [0, 3])
def test_noise_of_inputs_adds_its_squares_to_that_of_states_and_outputs(first):
    enlarged = CompiledEstimator("moving_horizon", compiled_linear())._kernels.enlarged
    variances, errors = np.random.default_rng(5).random((2, 8)), np.random.default_rng(6).normal(size=(5, 3, 8))
    total = njit(lambda v, e, k: enlarged(v, e, k))(variances, errors, first)
    np.testing.assert_allclose(total, variances + (errors[first : first + 2] ** 2).sum(axis=1), rtol=1e-14)
