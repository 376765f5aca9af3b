"""What a smoother reaches on the runs of a study that knows the vehicle, and all measurements of a run at every sample.

An extended Kalman filter with the vehicle's parameters and noise runs forwards; backwards the innovations behind each
sample correct its estimate, in the form of Bierman (1977), which needs no inverse of a predicted covariance:
``l_k = A_k' (C_k+1' l_k+1 - H_k+1' S_k+1^-1 e_k+1)`` with ``C = I - K H``, and the smoothed state is ``x_k - P_k l_k``.
On a linear model it is the fixed-interval smoother of Rauch, Tung and Striebel.
"""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.engine.simd.lanes import LANES
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.known_runs import KnownRuns


def smoothed_rmse(evaluator: StudyEvaluator, unit: Unit) -> Floats:
    """Return the RMSE of each target over the first runs of a unit, at most as many as there are lanes, SI."""
    known, compiled = KnownRuns.of_unit(evaluator, unit), evaluator.compiled
    targets = evaluator.study.targets
    states = smoothed(evaluator, known)
    s = np.empty((len(compiled.signals), LANES))
    rows = [compiled.truth_names.index(t) if t in compiled.truth_names else None for t in targets]
    squares = np.empty((len(states), LANES, len(targets)))
    for k, x in enumerate(states):
        compiled.belief.kernels.signals(x, known.inputs[k], known.constants, s)
        for t, row in enumerate(rows):
            squares[k, :, t] = np.nan if row is None else (s[t] - known.truth[k, row]) ** 2
    return known.rmse(squares)


def smoothed(evaluator: StudyEvaluator, known: KnownRuns) -> Floats:
    """Return the smoothed states ``(samples, nx, LANES)``; what a run measured behind its range does not count."""
    model = evaluator.compiled.belief
    samples, nx, ny = len(known.inputs), model.nx, model.ny
    A, H = np.empty((nx, nx, LANES)), np.empty((ny, nx, LANES))
    w, y, ahead = np.empty((model.nw, LANES)), np.empty((ny, LANES)), np.empty((nx, LANES))
    Q, R = (v[:, :, None] * np.eye(v.shape[1]) for v in (known.walk, known.noise))
    x, P = known.mean, known.first[:, :, None] * np.eye(nx)
    means, covariances = np.empty((samples, nx, LANES)), np.empty((samples, LANES, nx, nx))
    back, pull = np.empty((samples, LANES, nx, nx)), np.empty((samples, LANES, nx))
    means[0], covariances[0] = x, P
    last = np.where(known.scored.any(axis=0), samples - np.argmax(known.scored[::-1], axis=0), 0)
    for k in range(1, samples):
        model.kernels.next_jacobian(x, known.inputs[k - 1], known.constants, ahead, A, w)
        F = np.moveaxis(A, -1, 0)
        P = F @ P @ F.swapaxes(-1, -2) + Q
        model.kernels.output_jacobian(ahead, known.inputs[k], known.constants, y, H)
        rest = (known.measurements[k] - y).T
        seen = np.isfinite(rest) & (k < last)[:, None]
        slopes, rest = np.moveaxis(H, -1, 0) * seen[:, :, None], np.where(seen, rest, 0.0)
        S = slopes @ P @ slopes.swapaxes(-1, -2) + R
        weighed = np.linalg.solve(S, np.concatenate([slopes, rest[:, :, None]], axis=-1))  # S^-1 H and S^-1 e
        K = P @ weighed[:, :, :nx].swapaxes(-1, -2)
        left = np.eye(nx) - K @ slopes
        x = np.ascontiguousarray(ahead + np.einsum("lia,la->il", K, rest))
        P = left @ P @ left.swapaxes(-1, -2) + K @ R @ K.swapaxes(-1, -2)
        means[k], covariances[k] = x, P
        back[k] = F.swapaxes(-1, -2) @ left.swapaxes(-1, -2)
        pull[k] = np.einsum("lji,laj,la->li", F, slopes, weighed[:, :, nx])
    behind = np.zeros((LANES, nx))
    for k in range(samples - 1, 0, -1):
        means[k] -= np.einsum("lij,lj->il", covariances[k], behind)
        behind = np.einsum("lij,lj->li", back[k], behind) - pull[k]
    means[0] -= np.einsum("lij,lj->il", covariances[0], behind)
    return means
