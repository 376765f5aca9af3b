"""A small linear model sampled by hand, data of it, and the Kalman filter of the textbook on them."""

import numpy as np

from harness.engine.compile import CompiledModel, compile_model
from harness.testing.small_vehicles import linear

STEP = 0.05

Q, R, P0 = np.array([1e-3, 2e-3, 5e-4]), np.array([1e-2, 4e-2]), np.array([0.5, 1.0, 2.0])


def compiled_linear() -> CompiledModel:
    """Return the small linear model: one for all, so that an estimator is compiled on it once."""
    return compile_model(linear(), STEP, signals=("beta_test",))


def drive_linear(samples=80, seed=3):
    """Return inputs, measurements and the matrices of the sampled linear model."""
    rng = np.random.default_rng(seed)
    A = np.eye(3) + STEP * np.array([[-0.3 * 1.5, 1, 0], [-4, -1.5, 0], [0.5, 0, -0.2]])
    B = STEP * np.array([[0.0], [1.0], [0.0]])
    C = np.array([[1.0, 0, 0], [0, 0, 1.0]])
    u = rng.normal(size=(samples, 1))
    x, y = np.zeros(3), np.empty((samples, 2))
    for k in range(samples):
        y[k] = C @ x + rng.normal(size=2) * np.sqrt(R)
        x = A @ x + B @ u[k] + rng.normal(size=3) * np.sqrt(Q)
    return u, y, A, B, C


def textbook(u, y, A, B, C):
    """The Kalman filter with full matrices; a NaN measurement is left out."""
    x, P, log_likelihood = np.zeros(3), np.diag(P0), 0.0
    means, covariances = [x], [P]
    likelihoods: list[float] = []
    for k in range(1, len(y)):
        x, P = A @ x + B @ u[k - 1], A @ P @ A.T + np.diag(Q)
        seen = ~np.isnan(y[k])
        H = C[seen]
        S = H @ P @ H.T + np.diag(R[seen])
        innovation = y[k, seen] - H @ x
        K = P @ H.T @ np.linalg.inv(S)
        log_likelihood = -0.5 * (
            innovation @ np.linalg.solve(S, innovation) + np.linalg.slogdet(2 * np.pi * S)[1] if seen.any() else 0.0
        )
        x, P = x + K @ innovation, P - K @ S @ K.T
        means.append(x)
        covariances.append(P)
        likelihoods.append(log_likelihood)
    return np.array(means), np.array(covariances), np.array(likelihoods)
