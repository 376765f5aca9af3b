"""The particle smoothers: against their formula, and against the Rauch-Tung-Striebel smoother on a linear model."""

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.particle_smoother import (
    Clouds,
    mean_of,
    propagate,
    reweight,
    run_filter,
    simulate_backward,
)
from harness.simulation.simulate import in_lanes
from harness.testing.small_models import P0, STEP, Q, R, compiled_linear, drive_linear, textbook

SEEDS = [np.random.SeedSequence(9, spawn_key=(lane,)) for lane in range(LANES)]


@pytest.fixture(scope="module")
def compiled():
    return compiled_linear()


def clouds_of(compiled, u, y, size, lanes=1, q=Q):
    estimator = CompiledEstimator("particle", compiled, {"particles": size})
    belief = estimator.belief(compiled.constants(in_lanes(np.array([1.5]))), in_lanes(q), in_lanes(R))
    first = estimator.init(np.zeros(3), P0, SEEDS)
    return run_filter(estimator, in_lanes(u), in_lanes(y), belief, first, lanes)


def rts(u, y, A, B, C):
    """The Rauch-Tung-Striebel smoother with full matrices."""
    means, covariances, _ = textbook(u, y, A, B, C)
    for k in range(len(y) - 2, -1, -1):
        x, P = A @ means[k] + B @ u[k], A @ covariances[k] @ A.T + np.diag(Q)
        G = covariances[k] @ A.T @ np.linalg.inv(P)
        means[k] = means[k] + G @ (means[k + 1] - x)
        covariances[k] = covariances[k] + G @ (covariances[k + 1] - P) @ G.T
    return means[1:], covariances[1:]


@pytest.fixture(scope="module")
def smoothed(compiled):
    u, y, A, B, C = drive_linear(60)
    return rts(u, y, A, B, C), textbook(u, y, A, B, C)[0][1:], clouds_of(compiled, u, y, 1500, lanes=2)


def test_reweighting_agrees_with_the_linear_smoother(smoothed):
    (means, covariances), filtered, runs = smoothed
    std = np.sqrt(np.einsum("kii->ki", covariances))
    gap = np.sqrt(np.mean(((filtered - means) / std) ** 2))  # what smoothing is to gain
    for clouds in runs:
        weights = reweight(clouds)
        assert weights.sum(axis=1) == pytest.approx(np.ones(len(weights)))
        np.testing.assert_allclose(weights[-1], clouds.weights[-1])
        error = (mean_of(clouds.particles, weights) - means) / std
        assert np.sqrt(np.mean(error[1:] ** 2)) < 0.12 < 0.2 * gap
        away = clouds.particles - mean_of(clouds.particles, weights)[:, None]
        ratio = np.einsum("tn,tni->ti", weights, away**2) / std**2
        assert 0.85 < np.mean(ratio[1:]) < 1.15


def test_backward_simulation_agrees_with_the_linear_smoother(smoothed):
    (means, covariances), _, runs = smoothed
    std = np.sqrt(np.einsum("kii->ki", covariances))
    for clouds in runs:
        drawn = simulate_backward(clouds, 600, np.random.default_rng(0))
        error = (drawn.mean(axis=1) - means) / std
        assert np.sqrt(np.mean(error[1:] ** 2)) < 0.15
        assert 0.85 < np.mean((drawn.var(axis=1) / std**2)[1:]) < 1.15
        # trajectories, not only marginals: steps scatter as the process noise says, given the data
        residual = (
            drawn[1:, :, 0] - (drawn[:-1] @ (np.eye(3) + STEP * np.array([[-0.45, 1, 0]]).repeat(3, 0)).T)[:, :, 0]
        )
        assert np.var(residual) == pytest.approx(Q[0], rel=0.15)


def small_clouds(rng, samples=4, count=13, nx=2):
    weights = rng.exponential(size=(samples, count))
    weights[1, 4] = 0.0
    particles = rng.normal(size=(samples, count, nx))
    ahead = rng.normal(size=(samples - 1, count, nx))
    return Clouds(particles, weights / weights.sum(axis=1, keepdims=True), ahead, np.array([0.5, 1.5]))


def transition(clouds, t):
    """Return ``p(x_i(t+1) | x_j(t))`` as ``(i, j)``, but for a factor."""
    away = clouds.particles[t + 1][:, None] - clouds.ahead[t][None]
    return np.exp(-0.5 * np.sum(away**2 / clouds.process_noise, axis=-1))


def test_reweighting_is_the_printed_formula():
    clouds = small_clouds(np.random.default_rng(3))
    got, expected = reweight(clouds), clouds.weights.copy()
    for t in (2, 1, 0):
        p, w = transition(clouds, t), clouds.weights[t]
        for j in range(13):  # (2.74)
            expected[t, j] = sum(expected[t + 1, i] * w[j] * p[i, j] / (w @ p[i]) for i in range(13))
    np.testing.assert_allclose(got, expected, rtol=1e-12, atol=1e-15)


def test_far_particles_do_not_underflow():
    clouds = small_clouds(np.random.default_rng(3))
    far = Clouds(
        clouds.particles + 1e4 * np.arange(4)[:, None, None], clouds.weights, clouds.ahead, clouds.process_noise
    )
    weights = reweight(far)
    assert np.isfinite(weights).all()
    assert weights.sum(axis=1) == pytest.approx(np.ones(4))


def test_backward_simulation_draws_with_the_right_probabilities():
    clouds = small_clouds(np.random.default_rng(3), samples=2)
    drawn = simulate_backward(clouds, 60_000, np.random.default_rng(1))
    index = [np.argmin(np.abs(drawn[t, :, 0][:, None] - clouds.particles[t][None, :, 0]), axis=1) for t in (0, 1)]
    joint = np.zeros((13, 13))
    np.add.at(joint, (index[1], index[0]), 1 / 60_000)
    p, w = transition(clouds, 0), clouds.weights[0]
    expected = clouds.weights[1][:, None] * (w * p) / (p @ w)[:, None]
    assert (np.abs(joint - expected) < 5 * np.sqrt(expected / 60_000) + 1e-12).all()


def test_propagation_is_the_model(compiled):
    rng = np.random.default_rng(0)
    x, u = rng.normal(size=(11, 3)), rng.normal(size=1)
    _, _, A, B, _ = drive_linear(2)
    constants = compiled.constants(in_lanes(np.array([1.5])))[:, 0]
    np.testing.assert_allclose(propagate(compiled, x, u, constants), x @ A.T + B @ u, atol=1e-12)


def test_what_a_smoother_cannot_do_is_said(compiled):
    u, y, *_ = drive_linear(5)
    with pytest.raises(UserError, match="'gamma_test' has none"):
        clouds_of(compiled, u, y, 10, q=np.array([1e-3, 1e-3, 0.0]))
    kalman = CompiledEstimator("ekf", compiled)
    with pytest.raises(UserError, match="needs the estimator 'particle', got 'ekf'"):
        run_filter(kalman, in_lanes(u), in_lanes(y), None, kalman.init(np.zeros(3), P0))
    y[3] = np.inf
    with pytest.raises(UserError, match="run 0: all weights are zero at sample 3"):
        clouds_of(compiled, u, y, 10)
