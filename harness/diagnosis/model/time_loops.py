"""The filter of a nominal model around the mean of an augmented one, pasted behind the kernels of the nominal model.

The augmented model is the nominal one with every effect it may lack. Its first ``NX`` states are those of the nominal
model; the effects' own states come behind and are not corrected. Covariances and gains are the nominal model's: at
the neutral value of all effects they are those of its extended Kalman filter, and near it almost.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from harness.engine.kernel_names import (
    LANES,
    NW,
    NX,
    NY,
    SEEN_STATES,
    Info,
    StandIn,
    add_input_errors,
    correlated_update,
    get,
    next_covariance,
    output_jacobian,
    put,
    scalar_updates,
    select,
    splat,
)
from harness.engine.simd.memory import borrowed, retain
from harness.identification.time_loops import keep_correlated_gain, keep_gain, keep_lanes
from harness.runner.filter_loop import fill, fill_table

NX_WHOLE: Any = StandIn("NX_WHOLE")
NW_WHOLE: Any = StandIn("NW_WHOLE")


def filter_whole(u, between, nominal, y, errors, constants, nominal_constants, Q, R, x0, P0, valid, total, notes):
    """Run the filter over a recording and add up the log-likelihood of its innovations.

    Args:
        u: Inputs of the augmented model ``(samples, nu)``.
        between: The same during the step behind each sample.
        nominal: Columns of ``u`` that are the inputs of the nominal model.
        y: Measurements ``(samples, ny)``, NaN where missing; the first sample is not used.
        errors: What the errors of the inputs do to the next state of the nominal model and its outputs
            ``(samples, nx + ny, m)``; none if they are exact.
        constants: Of the augmented model ``(nc, LANES)``.
        nominal_constants: Of the nominal model.
        Q: Process-noise variances per step ``(nx, LANES)``.
        R: Measurement-noise variances ``(ny, LANES)``.
        x0: First mean of the augmented model ``(nx, LANES)``.
        P0: First variances of the nominal model ``(nx, LANES)``.
        valid: States of the augmented model that have a limit, and their largest magnitudes.
        total: Log-likelihood and first sample outside the limits (``samples`` if none), written ``(2, LANES)``.
        notes: What ``keep_lanes`` writes to, of no lanes if nothing is kept.
    """
    samples, nu = u.shape
    row = np.zeros((4, LANES))
    owned = (
        (np.empty((NW, LANES)), np.empty((NW_WHOLE, LANES))),
        (np.empty((NX_WHOLE, LANES)), np.empty((NX_WHOLE, LANES)), np.empty((NX, LANES))),
        (np.zeros((NX, NX, LANES)), np.zeros((NX, NX, LANES)), np.zeros((NY, NY, LANES)), np.zeros((NY, NY, LANES))),
        (np.empty((NY, LANES)), np.empty((NY, LANES)), np.empty((NY, NX, LANES)), np.empty((2 * NX, LANES))),
        Info(np.zeros((NY, LANES)), np.zeros((NY, NY, LANES)), row[0:1], row[1:2], row[2:3], row[3:4]),
        (np.empty((nu, LANES)), np.empty((len(nominal), LANES)), np.empty((NY, LANES))),
        np.zeros((NX + NY, errors.shape[2], LANES)),
        (np.zeros((NY, NX, LANES)), np.zeros((NY, NY, LANES)), np.empty((NY, errors.shape[2], LANES))),
    )
    (w, w_whole), means, covariances, outputs, info, inputs, errors_now, work = borrowed(owned)
    (x, x_prior, x_nominal), (P_prior, P, S, factor) = means, covariances
    (predicted, unused, H, scratch), (u_now, u_nominal, y_now) = outputs, inputs
    u, between, y, errors, constants, nominal_constants, notes = borrowed(
        (u, between, y, errors, constants, nominal_constants, notes)
    )
    begin_filter(x0, P0, samples, x, P, total)
    for k in range(1, samples):
        fill(between[k - 1], u_now)
        choose(u_now, nominal, u_nominal)
        next_covariance(x[:NX], u_nominal, nominal_constants, P, x_nominal, P_prior, w)
        for i in range(NX):
            put(get(P_prior, i, i) + get(Q, i), P_prior, i, i)
        next_state_whole(x, u_now, constants, x_prior, w_whole)
        fill(u[k], u_now)
        choose(u_now, nominal, u_nominal)
        output_jacobian(x_prior[:NX], u_nominal, nominal_constants, unused, H)
        output_whole(x_prior, u_now, constants, predicted)
        fill(y[k], y_now)
        if errors.shape[2] > 0:
            fill_table(errors[k], errors_now)
            add_input_errors(P_prior, errors_now)
            correlated_update(
                x_prior[:NX], P_prior, predicted, H, SEEN_STATES, y_now, R, errors_now, x[:NX], P, work, info
            )
        else:
            scalar_updates(x_prior[:NX], P_prior, predicted, H, SEEN_STATES, y_now, R, x[:NX], P, scratch, info)
        for i in range(NX, NX_WHOLE):
            put(get(x_prior, i), x, i)
        if notes[0].shape[0] > 0:
            keep_lanes(info, y_now, S, factor, x, k, notes)
            if errors.shape[2] > 0:
                keep_correlated_gain(work[0], y_now, k, notes)
            else:
                keep_gain(y_now, H, P, R, k, notes)
        put(get(total, 0) + get(info.log_likelihood, 0), total, 0)
        valid_until = get(total, 1)
        put(select((beyond(x, valid[0], valid[1]) > 0.0) & (valid_until > 1.0 * k), 1.0 * k, valid_until), total, 1)
    retain(owned)


def begin_filter(x0, P0, samples, x, P, total):
    """Write the first mean and covariance, and a log-likelihood of zero that holds for all samples."""
    for i in range(NX_WHOLE):
        put(get(x0, i), x, i)
    for i in range(NX):
        put(get(P0, i), P, i, i)
    put(splat(0.0), total, 0)
    put(splat(1.0 * samples), total, 1)


def choose(u, rows, chosen):
    """Write some of the inputs."""
    for i in range(len(rows)):
        put(get(u, rows[i]), chosen, i)


def beyond(x, limited, limits):
    """Return 1 in the lanes where one of some states is not a number or beyond its range."""
    bad = splat(0.0)
    for i in range(len(limits)):
        value = get(x, limited[i])
        inside = (value <= limits[i]) & (value >= -limits[i])  # false for NaN
        bad = select(inside, bad, 1.0)
    return bad


@StandIn
def next_state_whole(x, u, c, xn, w):
    """Stand in for the augmented model's ``next_state``."""


@StandIn
def output_whole(x, u, c, y):
    """Stand in for the augmented model's ``output``."""
