"""Step an estimator by hand over measurements, and predict once; lane 0 of everything."""

import numpy as np

from harness.engine.compile import compile_model
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.simulation.simulate import in_lanes


class Stepper:
    """An estimator on a model without parameters, with its noise.

    Args:
        kind: File in ``harness/estimation/methods``.
        model: What it believes.
        q: Process-noise variances ``(nx,)``.
        r: Measurement-noise variances ``(ny,)``.
        settings: Its settings.
        parameters: Of the model.
        step: Sample time in s; a discrete model has none.
    """

    def __init__(self, kind, model, q, r, settings=None, parameters=(), step=0.1):
        self.compiled = compile_model(model, step)
        self.estimator = CompiledEstimator(kind, self.compiled, settings)
        constants = self.compiled.constants(in_lanes(np.array(parameters, dtype=float)))
        self.belief = self.estimator.belief(constants, in_lanes(np.array(q)), in_lanes(np.array(r)))

    def run(self, mean, covariance, u, y):
        """Return means ``(samples, nx)``, covariances, memories and infos after each sample from the second on.

        Args:
            mean: At the first sample ``(nx,)``.
            covariance: At the first sample, ``(nx,)`` variances or ``(nx, nx)``.
            u: Inputs ``(samples, nu)``.
            y: Measurements ``(samples, ny)``; the first row is not used.
        """
        state = self.estimator.init(np.array(mean, dtype=float), np.array(covariance, dtype=float))
        means, covariances, memories, infos = [], [], [], []
        for k in range(1, len(y)):
            state, info = self.estimator.step(state, in_lanes(u[k - 1]), in_lanes(u[k]), in_lanes(y[k]), self.belief)
            means.append(state.mean[:, 0])
            covariances.append(state.covariance[:, :, 0])
            memories.append(state.memory[:, 0])
            infos.append(info)
        return np.array(means), np.array(covariances), np.array(memories), infos

    def predict(self, mean, covariance, u=0.0):
        """Return mean and covariance one sample ahead, without a measurement."""
        y = np.full((2, self.compiled.ny), np.nan)
        means, covariances, _, _ = self.run(mean, covariance, np.full((2, self.compiled.nu), u), y)
        return means[0], covariances[0]

    def update(self, mean, covariance, y, u=0.0):
        """Return mean, covariance and info after one sample with a measurement ``(ny,)``."""
        means, covariances, _, infos = self.run(mean, covariance, np.full((2, self.compiled.nu), u), np.array([y, y]))
        return means[0], covariances[0], infos[0]


def textbook(matrices, q, r, mean, variances, u, y):
    """The Kalman filter with full matrices ``(A, B, C)`` that may depend on the input: means and covariances."""
    x, P = np.array(mean, dtype=float), np.diag(np.array(variances, dtype=float))
    means, covariances = [], []
    for k in range(1, len(y)):
        (A, b, _), (_, _, C) = matrices(u[k - 1]), matrices(u[k])
        x, P = A @ x + b, A @ P @ A.T + np.diag(q)
        S = C @ P @ C.T + np.diag(r)
        K = P @ C.T @ np.linalg.inv(S)
        x, rest = x + K @ (y[k] - C @ x), np.eye(len(x)) - K @ C
        P = rest @ P @ rest.T + K @ np.diag(r) @ K.T
        means.append(x)
        covariances.append(P)
    return np.array(means), np.array(covariances)
