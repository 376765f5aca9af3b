"""Prediction and correction with inputs that are not exact, shared by the estimators; nothing where they are.

An error ``e`` of unit variance moves the next state by ``G e`` and the outputs by ``D e`` (``Belief.input_errors``).
"""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import (
    INPUT_ERRORS,
    LANES,
    NX,
    NY,
    SEEN_STATES,
    add_input_errors,
    correlated_update,
    get,
    put,
    scalar_updates,
)


def spread_inputs(P, belief):
    """Add what the errors of the inputs do to a predicted covariance."""
    if INPUT_ERRORS:
        add_input_errors(P, belief.input_errors)


def correct(x_prior, P_prior, predicted, H, y, belief, after, scratch, info):
    """Correct a prior with measurements whose slope is known; the arguments are those of ``scalar_updates``."""
    if INPUT_ERRORS:  # noqa: SIM102 - where this is 0, nothing of the branch is compiled
        if belief.input_errors.shape[1] > 0:
            seen = np.empty((NY, belief.input_errors.shape[1], LANES))
            work = np.empty((NY, NX, LANES)), np.zeros((NY, NY, LANES)), seen
            correlated_update(
                x_prior,
                P_prior,
                predicted,
                H,
                SEEN_STATES,
                y,
                belief.measurement_noise,
                belief.input_errors,
                after.mean,
                after.covariance,
                work,
                info,
            )
            return
    r = belief.measurement_noise
    scalar_updates(x_prior, P_prior, predicted, H, SEEN_STATES, y, r, after.mean, after.covariance, scratch, info)


def output_noise(belief):
    """Return measurement variances with those of the errors of the inputs, as if independent ``(ny, LANES)``."""
    if INPUT_ERRORS:
        return enlarged(belief.measurement_noise, belief.input_errors, NX)
    return belief.measurement_noise


def state_noise(belief):
    """Return process-noise variances with those of the errors of the inputs, as if independent ``(nx, LANES)``."""
    if INPUT_ERRORS:
        return enlarged(belief.process_noise, belief.input_errors, 0)
    return belief.process_noise


def enlarged(variances, errors, first):
    """Return variances with the squares of rows of errors, from ``first`` on, added."""
    total_variances = np.empty(variances.shape)
    for i in range(variances.shape[0]):
        total = get(variances, i)
        for c in range(errors.shape[1]):
            total = total + get(errors, first + i, c) * get(errors, first + i, c)
        put(total, total_variances, i)
    return total_variances
