"""The same filters in extended precision (64 bits of mantissa on x86), to tell how wrong the fast ones are."""

from __future__ import annotations

from typing import Any

import numpy as np

from bench.peers.problem import NUMPY, UNSCENTED, Equations, Problem, equations
from harness.common.arrays import Floats

Long: Any = np.longdouble


def extended(kind: str, given: Problem) -> Floats:
    """Return the means of the first run ``(steps, nx)`` by the textbook, in extended precision.

    Args:
        kind: ``"ekf"`` or ``"ukf"``.
        given: The problem.

    Raises:
        ArithmeticError: If the processor has no precision beyond double.
    """
    if np.finfo(Long).nmant < 63:
        raise ArithmeticError("no extended precision on this processor")
    eqs = equations(given, NUMPY, Long)
    x, P = given.mean.astype(Long), np.diag(given.variance.astype(Long))
    Q, R = np.diag(given.process.astype(Long)), np.diag(given.measurement.astype(Long))
    inputs, y = given.inputs.astype(Long), given.measurements[:, :, 0].astype(Long)
    predict = _PREDICT[kind]
    means = np.empty((given.steps, len(x)), Long)
    for k in range(1, len(inputs)):
        x, P = predict(eqs, x, P, Q, inputs[k - 1])
        predicted, H = (np.asarray(part, Long) for part in eqs.output_and_slope(x, inputs[k]))  # linear outputs
        S = H @ P @ H.T + R
        gain = _solve(S, H @ P).T
        x, P = x + gain @ (y[k] - predicted), P - gain @ S @ gain.T
        means[k - 1] = x
    return means


def first_prediction(kind: str, given: Problem) -> tuple[Floats, Floats]:
    """Return mean and covariance at the second sample before its measurement, for libraries that begin with one."""
    x, P, Q = given.mean.astype(Long), np.diag(given.variance.astype(Long)), np.diag(given.process.astype(Long))
    ahead, covariance = _PREDICT[kind](equations(given, NUMPY, Long), x, P, Q, given.inputs[0].astype(Long))
    return ahead.astype(float), covariance.astype(float)


def _linearised(eqs: Equations, x: Any, P: Any, Q: Any, u: Any) -> tuple[Any, Any]:
    """Predict as the EKF does (Ziaukas 2.12, 2.13)."""
    ahead, slope = (np.asarray(part, Long) for part in eqs.ahead_and_slope(x, u))
    return ahead, slope @ P @ slope.T + Q


def _unscented(eqs: Equations, x: Any, P: Any, Q: Any, u: Any) -> tuple[Any, Any]:
    """Predict with sigma points (Ziaukas 2.19 to 2.24)."""
    n = len(x)
    total = Long(UNSCENTED["alpha"] ** 2 * (n + UNSCENTED["kappa"]))
    spread = np.sqrt(total) * _cholesky(P)
    points = np.array([eqs.ahead(point, u) for point in (x, *(x + spread.T), *(x - spread.T))], Long)
    mean_weights = np.full(2 * n + 1, 1 / (2 * total))
    mean_weights[0] = (total - n) / total
    weights = mean_weights.copy()
    weights[0] += 1 - UNSCENTED["alpha"] ** 2 + UNSCENTED["beta"]
    mean = mean_weights @ points
    apart = points - mean
    return mean, (weights[:, None] * apart).T @ apart + Q


_PREDICT = {"ekf": _linearised, "ukf": _unscented}


def _cholesky(P: Any) -> Any:
    factor = np.zeros_like(P)
    for j in range(len(P)):
        factor[j, j] = np.sqrt(P[j, j] - factor[j, :j] @ factor[j, :j])
        factor[j + 1 :, j] = (P[j + 1 :, j] - factor[j + 1 :, :j] @ factor[j, :j]) / factor[j, j]
    return factor


def _solve(A: Any, B: Any) -> Any:
    """Solve ``A X = B`` for a symmetric positive definite ``A``."""
    factor, X = _cholesky(A), np.array(B)
    for i in range(len(A)):
        X[i] = (X[i] - factor[i, :i] @ X[:i]) / factor[i, i]
    for i in reversed(range(len(A))):
        X[i] = (X[i] - factor[i + 1 :, i] @ X[i + 1 :]) / factor[i, i]
    return X


def error(means: Floats, exact: Floats) -> float:
    """Return the largest deviation of any state, as a share of the largest magnitude of that state."""
    size = np.abs(exact).max(axis=0)
    moved = size > 0
    return float((np.abs(means - exact)[:, moved] / size[moved]).max())
