"""The loop over one run that keeps what an estimator holds at every sample; pasted behind its kernels.

It takes the steps of ``harness.engine.time_loops.estimate`` and scores nothing. The run is in all lanes; what the first
one does is kept.
"""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import INPUT_ERRORS, LANES, NX, NY, Info, State
from harness.engine.time_loops import advance, spread_of_inputs, workspace, write_covariance


def follow(inputs, y, belief, first, kept):
    """Run the estimator over a run and keep all of it.

    Args:
        inputs: As ``harness.engine.time_loops.estimate`` takes them.
        y: Measurements ``(samples, ny, LANES)``.
        belief: ``harness.engine.kernel_names.Belief``.
        first: ``harness.engine.kernel_names.State`` before the first step; of its covariance the variances are taken.
        kept: Written for every sample: mean ``(samples, nx)``, covariance ``(samples, nx, nx)``, innovation
            ``(samples, ny)``, its variance ``(samples, ny)``, and NIS and measurements used ``(samples, 2)``; the last
            three from the second sample on.
    """
    u, between, moved, moved_at = inputs
    mean, covariance, innovation, spread, facts = kept
    work = workspace()
    before = State(first.mean.copy(), np.zeros((NX, NX, LANES)), first.memory.copy())
    for i in range(NX):
        before.covariance[i, i] = first.covariance[i, i]
    after = State(np.empty((NX, LANES)), np.zeros((NX, NX, LANES)), np.empty(first.memory.shape))
    row = np.zeros((4, LANES))
    info = Info(np.zeros((NY, LANES)), np.zeros((NY, NY, LANES)), row[0:1], row[1:2], row[2:3], row[3:4])
    write_down(before, mean[0], covariance[0])
    for k in range(1, u.shape[0]):
        if INPUT_ERRORS:
            spread_of_inputs(before.mean, between[k - 1], u[k], moved[k - 1], moved_at[k], belief)
        advance(before, between[k - 1], u[k], y[k], belief, work, after, info)
        before, after = after, before
        write_covariance(before, work)
        write_down(before, mean[k], covariance[k])
        facts[k, 0], facts[k, 1] = info.nis[0, 0], info.seen[0, 0]
        for a in range(NY):
            innovation[k, a] = info.innovation[a, 0]
            spread[k, a] = info.innovation_covariance[a, a, 0]


def write_down(state, mean, covariance):
    """Write mean and covariance of the first lane."""
    for i in range(NX):
        mean[i] = state.mean[i, 0]
        for j in range(NX):
            covariance[i, j] = state.covariance[i, j, 0]
