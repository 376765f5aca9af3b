"""Disturbances in the innovations of a filter: against dense least squares and against an augmented Kalman filter."""

import numpy as np
import pytest

from harness.diagnosis.innovations.innovation_model import InnovationModel, InputDirection, lasso
from harness.engine.simd.lanes import LANES

SAMPLES, STEP, TIME_CONSTANT, DEVIATION = 80, 0.1, 1.5, 0.7


@pytest.fixture
def linear():
    """A drive of ``x+ = A x + B d + w, y = H x + D d + v`` in which ``d`` is a Gauss-Markov process."""
    rng = np.random.default_rng(4)
    A = np.array([[0.9, 0.2, 0.0], [-0.15, 0.85, 0.1], [0.0, 0.05, 0.8]])
    H, B, D = rng.normal(size=(2, 3)), np.array([0.1, 0.3, 0.0]), np.array([0.0, 0.2])
    Q, R = np.diag([0.01, 0.02, 0.01]), np.diag([0.04, 0.09])
    decay = np.exp(-STEP / TIME_CONSTANT)
    x, d, y, truth = np.zeros(3), DEVIATION * rng.normal(), [], []
    for k in range(SAMPLES):
        if k:
            x = A @ x + B * d + np.sqrt(np.diag(Q)) * rng.normal(size=3)
            d = decay * d + DEVIATION * np.sqrt(1 - decay**2) * rng.normal()
        y.append(H @ x + D * d + np.sqrt(np.diag(R)) * rng.normal(size=2))
        truth.append(d)
    y = np.array(y)
    y[30:34, 0] = np.nan
    return A, H, B, D, Q, R, y, np.array(truth)


def kalman(A, H, Q, R, y, P):
    """Return the log-likelihood from the second sample on, with gains, whitening and whitened innovations."""
    x, total, kept = np.zeros(len(A)), 0.0, []
    for k in range(1, len(y)):
        x, P = A @ x, A @ P @ A.T + Q
        seen = np.isfinite(y[k])
        h, r = H[seen], R[np.ix_(seen, seen)]
        S = h @ P @ h.T + r
        K, W = np.zeros((len(A), len(y[k]))), np.zeros((len(y[k]), len(y[k])))
        K[:, seen] = P @ h.T @ np.linalg.inv(S)
        W[np.ix_(seen, seen)] = np.linalg.inv(np.linalg.cholesky(S))
        e = np.where(seen, np.nan_to_num(y[k]) - H @ x, 0.0)
        x, P = x + K @ e, (np.eye(len(A)) - K @ np.where(seen[:, None], H, 0.0)) @ P
        total -= 0.5 * (e[seen] @ np.linalg.solve(S, e[seen]) + np.linalg.slogdet(2 * np.pi * S)[1])
        kept.append((K, W, W @ e))
    return total, kept


def innovation_model(A, H, B, D, Q, R, y):
    total, kept = kalman(A, H, Q, R, y, np.eye(3))
    K, W, r = (np.array([np.zeros_like(kept[0][i]), *(k[i] for k in kept)]) for i in range(3))
    model = InnovationModel(A @ (np.eye(3) - K @ H), W @ H, r, STEP)
    return total, model, InputDirection(B - (A @ K @ D[:, None])[:, :, 0], W @ D)


def dense(model, input_direction):
    """Return responses to a disturbance of one sample each ``(rows, samples)`` and the covariance of the process."""
    X = model.responses(input_direction, np.eye(SAMPLES)).reshape(-1, SAMPLES)
    lag = np.abs(np.subtract.outer(np.arange(SAMPLES), np.arange(SAMPLES)))
    return X, DEVIATION**2 * np.exp(-lag * STEP / TIME_CONSTANT)


def test_the_gain_is_that_of_a_kalman_filter_with_the_disturbance_in_its_state(linear):
    A, H, B, D, Q, R, y, _ = linear
    without, model, input_direction = innovation_model(A, H, B, D, Q, R, y)
    decay = np.exp(-STEP / TIME_CONSTANT)
    more = np.block([[A, B[:, None]], [np.zeros((1, 3)), decay]])
    noise = np.diag([*np.diag(Q), DEVIATION**2 * (1 - decay**2)])
    # The disturbance begins at the second sample, when the innovations do: before it, only its variance is there.
    first = np.diag([1.0, 1.0, 1.0, DEVIATION**2])
    start = first.copy()
    start[:3, :3] = A @ np.eye(3) @ A.T + Q
    more_first = np.linalg.inv(more)
    with_it, _ = kalman(more, np.column_stack([H, D]), noise, R, y, more_first @ (start - noise) @ more_first.T)
    gains = model.gains(input_direction, TIME_CONSTANT, np.full(LANES, DEVIATION))
    assert gains == pytest.approx(np.full(LANES, with_it - without), rel=1e-9)
    assert gains[0] > 10


def test_gain_and_history_are_those_of_dense_least_squares(linear):
    _, model, input_direction = innovation_model(*linear[:-1])
    X, prior = dense(model, input_direction)
    r = model.residual.reshape(-1)
    S = X @ prior @ X.T + np.eye(len(r))
    expected = -0.5 * (r @ np.linalg.solve(S, r) - r @ r + np.linalg.slogdet(S)[1])
    deviations = DEVIATION * np.geomspace(0.5, 50, LANES)
    deviations[0] = DEVIATION
    assert model.gains(input_direction, TIME_CONSTANT, deviations)[0] == pytest.approx(expected, rel=1e-9)
    mean, error = model.smoothed(input_direction, TIME_CONSTANT, DEVIATION)
    weights = prior @ X.T @ np.linalg.inv(S)
    assert mean[1:] == pytest.approx((weights @ r)[1:], abs=1e-9)
    assert error[1:] == pytest.approx(np.sqrt(np.diag(prior - weights @ X @ prior))[1:], abs=1e-9)


def test_the_history_covers_the_truth(linear):
    _, model, input_direction = innovation_model(*linear[:-1])
    mean, error = model.smoothed(input_direction, TIME_CONSTANT, DEVIATION)
    away = (mean - linear[-1])[1:] / error[1:]
    assert np.mean(np.abs(away) < 2.0) > 0.85
    assert np.std(mean - linear[-1]) < 0.7 * np.std(linear[-1])


def test_the_lasso_meets_its_optimality_conditions():
    rng = np.random.default_rng(1)
    X = rng.normal(size=(200, 12))
    X[:, 3] = X[:, 2] + 0.2 * X[:, 3]
    X /= np.linalg.norm(X, axis=0)
    b = X.T @ (40 * X[:, 2] - 25 * X[:, 7] + rng.normal(size=200))
    found = lasso(X.T @ X, b, 4.0, 12)
    slope = b - X.T @ X @ found
    taken = found != 0
    assert slope[taken] == pytest.approx(4.0 * np.sign(found[taken]), abs=0.05)
    assert np.abs(slope[~taken]).max() < 4.05
    assert set(np.flatnonzero(np.abs(found) > 5)) == {2, 7}
    assert np.count_nonzero(lasso(X.T @ X, b, 1e-6, 2)) in (2, 3)
