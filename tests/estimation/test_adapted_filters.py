"""The H-infinity filter against its Riccati equation, and filters that find their noise in their innovations."""

import numpy as np
import pytest

from harness.estimation.compiled_estimator import CompiledEstimator
from harness.simulation.simulate import in_lanes
from harness.testing.small_models import P0, Q, R, compiled_linear, drive_linear


@pytest.fixture(scope="module")
def model():
    return compiled_linear()


def run(kind, model, settings, u, y, q=Q, r=R):
    estimator = CompiledEstimator(kind, model, settings)
    belief = estimator.belief(model.constants(in_lanes(np.array([1.5]))), in_lanes(q), in_lanes(r))
    state = estimator.init(np.zeros(3), P0)
    means, covariances, infos = [], [], []
    for k in range(1, len(y)):
        state, info = estimator.step(state, in_lanes(u[k - 1]), in_lanes(u[k]), in_lanes(y[k]), belief)
        means.append(state.mean[:, 0].copy())
        covariances.append(state.covariance[:, :, 0].copy())
        infos.append(info)
    return np.array(means), np.array(covariances), state, infos


@pytest.mark.parametrize("bound", [0.0, 0.5])
def test_the_game_is_that_of_the_riccati_equation(model, bound):
    u, y, A, B, C = drive_linear(60)
    means, covariances, *_ = run("h_infinity", model, {"bound": bound}, u, y)
    x, P = np.zeros(3), np.diag(P0)
    for k in range(1, len(y)):
        x, P = A @ x + B @ u[k - 1], A @ P @ A.T + np.diag(Q)
        W = np.diag(1 / np.diag(P)) / 3
        P = np.linalg.inv(np.linalg.inv(P) - bound * W + C.T @ np.diag(1 / R) @ C)
        x = x + P @ C.T @ np.diag(1 / R) @ (y[k] - C @ x)
        np.testing.assert_allclose(means[k - 1], x, rtol=0, atol=1e-9)
        np.testing.assert_allclose(covariances[k - 1], P, rtol=1e-8, atol=1e-12)


def test_without_a_bound_it_is_the_ekf_bit_for_bit(model):
    u, y, *_ = drive_linear(60)
    for mine, theirs in zip(
        run("h_infinity", model, {"bound": 0.0}, u, y)[:2], run("ekf", model, {}, u, y)[:2], strict=True
    ):
        np.testing.assert_array_equal(mine, theirs)


def test_it_finds_the_noise_of_sensors_that_is_believed_wrongly(model):
    """Believed are 16 times and a sixteenth of the variances of the two sensors."""
    u, y, *_ = drive_linear(6000)
    wrong = R * np.array([16.0, 1 / 16])
    *_, state, _ = run("innovation_ekf", model, {"adapts": "measurement", "window": 1000}, u, y, r=wrong)
    found = state.memory[:2, 0]
    assert np.abs(np.log(found / R)).max() < 0.35


def test_it_finds_process_noise_that_is_believed_far_too_small(model):
    """The NIS comes back to what it should be, and the error towards that with the right noise."""
    u, y, *_ = drive_linear(4000)
    few = Q / 1e3
    means, _, _, infos = run("innovation_ekf", model, {"window": 100}, u, y, q=few)
    fixed, _, _, others = run("ekf", model, {}, u, y, q=few)
    right, *_ = run("ekf", model, {}, u, y)
    nis = [np.mean([i.nis[0, 0] for i in some[1000:]]) / 2 for some in (infos, others)]
    assert nis[1] > 1.5
    assert 0.9 < nis[0] < 1.1
    off = [np.sqrt(np.mean((m - right)[1000:] ** 2)) for m in (means, fixed)]
    assert off[0] < 0.2 * off[1]
