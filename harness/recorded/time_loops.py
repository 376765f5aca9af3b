"""The loop over a recording of any estimator; pasted behind the kernels of a model and of the estimator.

A recording is the same in all lanes. What the first one does is kept.
"""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import (
    LANES,
    NS,
    NX,
    NY,
    Info,
    State,
    put,
    signals,
    signals_jacobian,
    splat,
)
from harness.engine.simd.memory import borrowed, retain
from harness.engine.time_loops import advance, outside, workspace, write_covariance


def estimate_recording(u, between, y, errors, belief, first, limits, rows, kept):
    """Run the estimator over a recording and keep what it says of every sample.

    Args:
        u: Inputs ``(samples, nu)``.
        between: Inputs during the step behind each sample ``(samples, nu)``.
        y: Measurements ``(samples, ny)``, NaN where missing; the first sample is not used.
        errors: What the errors of the inputs do ``(samples, nx + ny, m)``; at each sample written to ``belief``.
        belief: ``harness.engine.kernel_names.Belief``.
        first: ``harness.engine.kernel_names.State`` before the first step.
        limits: Largest magnitude of each state ``(nx,)``.
        rows: Signals of which the covariance is kept ``(m,)``.
        kept: Written for every sample: the signals and their standard deviations ``(samples, ns)``, the covariance of
            those in ``rows`` ``(samples, m, m)``, the innovation ``(samples, ny)``, its covariance
            ``(samples, ny, ny)``, and NIS, measurements used, log-likelihood, repairs and whether the state is outside
            its limits ``(samples, 5)``.
    """
    samples, nu = u.shape
    row = np.zeros((4, LANES))
    owned = (
        workspace(),
        State(first.mean.copy(), first.covariance.copy(), first.memory.copy()),
        State(np.empty((NX, LANES)), np.zeros((NX, NX, LANES)), np.empty(first.memory.shape)),
        Info(np.zeros((NY, LANES)), np.zeros((NY, NY, LANES)), row[0:1], row[1:2], row[2:3], row[3:4]),
        (np.empty((nu, LANES)), np.empty((nu, LANES)), np.empty((NY, LANES))),
        (np.empty((NS, LANES)), np.empty((NS, NX, LANES)), np.empty((1, LANES))),
    )
    work, before, after, info, (u_before, u_now, y_now), (s, slopes, left) = borrowed(owned)
    u, between, y, errors, belief, kept = borrowed((u, between, y, errors, belief, kept))
    estimate, deviation, covariance, innovation, spread, facts = kept
    fill_lanes(u[0], u_now)
    keep_signals(before, u_now, belief, s, slopes, rows, estimate[0], deviation[0], covariance[0])
    for k in range(1, samples):
        fill_lanes(between[k - 1], u_before)
        fill_lanes(u[k], u_now)
        fill_lanes(y[k], y_now)
        for i in range(errors.shape[1]):
            fill_lanes(errors[k, i], belief.input_errors[i])
        advance(before, u_before, u_now, y_now, belief, work, after, info)
        before, after = after, before
        write_covariance(before, work)
        keep_signals(before, u_now, belief, s, slopes, rows, estimate[k], deviation[k], covariance[k])
        put(outside(before.mean, limits), left, 0)
        facts[k, 0], facts[k, 1] = info.nis[0, 0], info.seen[0, 0]
        facts[k, 2], facts[k, 3] = info.log_likelihood[0, 0], info.repairs[0, 0]
        facts[k, 4] = left[0, 0]
        for a in range(NY):
            innovation[k, a] = info.innovation[a, 0]
            for b in range(NY):
                spread[k, a, b] = info.innovation_covariance[a, b, 0]
    retain(owned)


def fill_lanes(values, numbers):
    """Write plain values, the same for all lanes."""
    for i in range(numbers.shape[0]):
        put(splat(values[i]), numbers, i)


def keep_signals(state, u, belief, s, slopes, rows, estimate, deviation, covariance):
    """Write the signals of the first lane with their standard deviations, and the covariance of some of them."""
    signals(state.mean, u, belief.constants, s)
    signals_jacobian(state.mean, u, belief.constants, slopes)
    for a in range(NS):
        estimate[a] = s[a, 0]
        deviation[a] = np.sqrt(max(0.0, covariance_of_signals(slopes, state.covariance, a, a)))
    for m in range(rows.shape[0]):
        for n in range(rows.shape[0]):
            covariance[m, n] = covariance_of_signals(slopes, state.covariance, rows[m], rows[n])


def covariance_of_signals(slopes, P, a, b):
    """Return the covariance of two signals in the first lane."""
    total = 0.0
    for i in range(NX):
        if slopes[a, i, 0] != 0.0:
            for j in range(NX):
                if slopes[b, j, 0] != 0.0:
                    total += slopes[a, i, 0] * P[i, j, 0] * slopes[b, j, 0]
    return total
