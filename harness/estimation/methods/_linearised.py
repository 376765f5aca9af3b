"""Prediction by the exact sparse Jacobians, shared by the filters that linearise, and what is left of measurements."""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import (
    LANES,
    NW,
    NX,
    NY,
    SEEN_STATES,
    Belief,
    Info,
    get,
    next_covariance,
    output_jacobian,
    put,
    select,
)
from harness.estimation.methods._input_errors import spread_inputs


def linear_workspace():
    """Return the scratch arrays of a run: of the model, prior mean and covariance, outputs, their slopes, update."""
    return (
        np.empty((NW, LANES)),
        np.empty((NX, LANES)),
        np.empty((NX, NX, LANES)),
        np.empty((NY, LANES)),
        np.empty((NY, NX, LANES)),
        np.empty((2 * NX, LANES)),
    )


def predict(before, u_before, u, belief, work):
    """Predict one sample ahead (Ziaukas 2.12, 2.13) and write predicted measurements and their slopes."""
    w, x_prior, P_prior, predicted, H, _ = work
    next_covariance(before.mean, u_before, belief.constants, before.covariance, x_prior, P_prior, w)
    for i in range(NX):
        put(get(P_prior, i, i) + get(belief.process_noise, i), P_prior, i, i)
    spread_inputs(P_prior, belief)
    output_jacobian(x_prior, u, belief.constants, predicted, H)


def with_measurement_noise(belief, r):
    """Return a belief with other variances of the measurements ``(ny, LANES)``."""
    return Belief(belief.constants, belief.process_noise, r, belief.tuning, belief.input_errors, belief.priors)


def residual(after, work, y, a):
    """Return what is left of measurement ``a`` behind the correction, linearised at the prior; 0 if it is missing."""
    _, x_prior, _, predicted, H, _ = work
    remainder = get(y, a) - get(predicted, a)
    for c in range(SEEN_STATES.shape[1]):
        j = SEEN_STATES[a, c]
        if j < 0:
            break
        remainder = remainder - get(H, a, j) * (get(after.mean, j) - get(x_prior, j))
    return select(get(y, a) == get(y, a), remainder, 0.0)


def residual_square(after, work, y, a):
    """Return the expected square of that under the corrected distribution, ``e^2 + H P H'``; 0 where it is missing."""
    H = work[4]
    remainder = residual(after, work, y, a)
    square = remainder * remainder
    for c in range(SEEN_STATES.shape[1]):
        i = SEEN_STATES[a, c]
        if i < 0:
            break
        for d in range(SEEN_STATES.shape[1]):
            j = SEEN_STATES[a, d]
            if j < 0:
                break
            square = square + get(H, a, i) * get(after.covariance, i, j) * get(H, a, j)
    return select(get(y, a) == get(y, a), square, 0.0)


def spare_info():
    """Return room for what a correction says that is not the last or the first of its step."""
    row = np.zeros((4, LANES))
    return Info(np.zeros((NY, LANES)), np.zeros((NY, NY, LANES)), row[0:1], row[1:2], row[2:3], row[3:4])
