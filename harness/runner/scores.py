"""Recorder of scores: an estimator runs over batches and is compared with the truth while it runs."""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import (
    LANES,
    NS,
    NX,
    NY,
    Belief,
    State,
    cholesky,
    get,
    mahalanobis,
    put,
    select,
    signals,
    signals_jacobian,
    splat,
    sqrt,
)
from harness.runner.filter_loop import BATCH, record_first, record_sample, recording_room, run_filter, write_covariance
from harness.runner.limits import outside, surprised, undefined


def estimate(inputs, y, truth, rows, until, belief, first, limits, options, bounds, scores, per_run, kept):
    """Run the estimator over batches and score it against the truth while it runs.

    With an axis of batches in front come all that end in ``LANES`` but ``belief.input_errors``; that of ``inputs`` may
    have the length 1, where all batches have the same.

    Args:
        inputs: The first four of what ``harness.runner.filter_loop.read_batch`` reads.
        y: Measurements ``(samples, ny, LANES)``, NaN where missing.
        truth: The plant's signals ``(samples, plant signals, LANES)``.
        rows: Row of ``truth`` of each state of the estimator, then of each target ``(nx + ns,)``; -1 where the
            plant has no such quantity, or the estimator does not give it.
        until: Scores stop before this sample ``(1, LANES)``; the truth of every target is a number up to there.
        belief: ``harness.engine.kernel_names.Belief``.
        first: ``harness.engine.kernel_names.State`` before the first step.
        limits: Largest magnitude of each state ``(nx,)``.
        options: NEES every that many samples, 1 if there is one to compute, 1 if the estimator states a covariance,
            and the first sample scored ``(4,)``.
        bounds: Two-sided 95 % chi-square bounds ``(1 + max(nx, ny), 2)`` by degrees of freedom.
        scores: Sum of squares, sum and largest magnitude of the error, written ``(3, ns, LANES)``.
        per_run: Written ``(10, LANES)``: samples scored, sum of NEES, samples of it, those inside, sum of NIS,
            samples with a measurement, those inside, log-likelihood, repairs, sample of divergence.
        kept: Estimates and standard deviations of the targets, written ``(samples or 0, 2, ns, LANES)``.
    """
    u, between, moved, moved_at = inputs
    memories = np.empty(first.memory.shape[1:]), np.empty(first.memory.shape[1:])
    for b in range(y.shape[0]):
        own, own_errors = min(b, u.shape[0] - 1), min(b, moved.shape[0] - 1)
        source = u[own], between[own], moved[own_errors], moved_at[own_errors], y[b]
        held = Belief(
            belief.constants[b], belief.process_noise[b], belief.measurement_noise[b], belief.tuning,
            belief.input_errors, belief.priors,
        )  # fmt: skip
        begun = State(first.mean[b], first.covariance[b], first.memory[b])
        record = truth[b], rows, until[b], limits, options, bounds, scores[b], per_run[b], kept[b]
        run_filter(source, held, begun, memories, record)


def room_of_scores():
    """Return room for the targets and their derivatives, and for the NEES."""
    return (
        (np.empty((NS, LANES)), np.empty((NS, NX, LANES))),
        (np.zeros((NX, NX, LANES)), np.empty((NX, LANES)), np.empty((NX, LANES))),
    )


def begin_scores(samples, state, u, belief, room, record):
    """Set all sums to zero and keep the first estimates, if any are kept."""
    _, _, _, _, _, _, scores, per_run, kept = record
    (s, slopes), _ = room
    scores[:] = 0.0
    per_run[:] = 0.0
    put(splat(1.0 * samples), per_run, 9)
    if kept.shape[0] > 0:
        keep_targets(state, u, belief, s, slopes, kept[0])


def add_scores(k, state, previous, u_before, u, y, belief, work, info, room, record):
    """Add one sample to all sums, as far as the run has not diverged, and keep the estimates."""
    truth, rows, until, limits, options, bounds, scores, per_run, kept = record
    (s, slopes), (factor, error, scratch) = room
    every, comparable, stated = int(options[0]), options[1] > 0.5, options[2] > 0.5
    diverged = get(per_run, 9)
    signals(state.mean, u, belief.constants, s)
    bad = (outside(state.mean, limits) > 0.0) | (undefined(s, rows[NX:]) > 0.0)
    if stated:
        bad = bad | (surprised(info) > 0.0)
    bad = bad & (diverged > 1.0 * k) & (get(until, 0) > 1.0 * k)
    diverged = select(bad, 1.0 * k, diverged)
    put(diverged, per_run, 9)
    active = (diverged > 1.0 * k) & (get(until, 0) > 1.0 * k) & (splat(1.0 * k) >= options[3])
    score_targets(s, truth[k], rows, active, scores)
    score_information(info, active, bounds, per_run)
    if comparable and k % every == 0:
        write_covariance(state, work)
        score_covariance(state, truth[k], rows, active, bounds, factor, error, scratch, per_run)
    if kept.shape[0] > 0:
        write_covariance(state, work)
        keep_targets(state, u, belief, s, slopes, kept[k])


def score_targets(s, truth, rows, active, scores):
    """Add one sample's target errors."""
    for i in range(NS):
        if rows[NX + i] >= 0:
            e = select(active, get(s, i) - get(truth, rows[NX + i]), 0.0)
            put(get(scores, 0, i) + e * e, scores, 0, i)
            put(get(scores, 1, i) + e, scores, 1, i)
            magnitude = select(e < 0.0, -e, e)
            largest = get(scores, 2, i)
            put(select(magnitude > largest, magnitude, largest), scores, 2, i)


def score_information(info, active, bounds, per_run):
    """Add one sample's NIS, likelihood and repairs."""
    seen = get(info.seen, 0)
    used = active & (seen > 0.0)
    nis = get(info.nis, 0)
    low, high = splat(0.0), splat(0.0)
    for m in range(1, NY + 1):
        low = select(seen == 1.0 * m, bounds[m, 0], low)
        high = select(seen == 1.0 * m, bounds[m, 1], high)
    put(get(per_run, 0) + select(active, 1.0, 0.0), per_run, 0)
    put(get(per_run, 4) + select(used, nis, 0.0), per_run, 4)
    put(get(per_run, 5) + select(used, 1.0, 0.0), per_run, 5)
    put(get(per_run, 6) + select(used & (nis >= low) & (nis <= high), 1.0, 0.0), per_run, 6)
    put(get(per_run, 7) + select(used, get(info.log_likelihood, 0), 0.0), per_run, 7)
    put(get(per_run, 8) + select(active, get(info.repairs, 0), 0.0), per_run, 8)


def score_covariance(state, truth, rows, active, bounds, factor, error, scratch, per_run):
    """Add one sample's normalised estimation error squared."""
    cholesky(state.covariance, factor, NX)
    for i in range(NX):
        put(get(state.mean, i) - get(truth, rows[i]), error, i)
    nees = mahalanobis(factor, error, scratch, NX)
    used = active & (nees == nees)
    put(get(per_run, 1) + select(used, nees, 0.0), per_run, 1)
    put(get(per_run, 2) + select(used, 1.0, 0.0), per_run, 2)
    inside = used & (nees >= bounds[NX, 0]) & (nees <= bounds[NX, 1])
    put(get(per_run, 3) + select(inside, 1.0, 0.0), per_run, 3)


def keep_targets(state, u, belief, s, slopes, kept):
    """Keep the estimates of the targets and their standard deviations."""
    signals(state.mean, u, belief.constants, s)
    signals_jacobian(state.mean, u, belief.constants, slopes)
    for a in range(NS):
        put(get(s, a), kept, 0, a)
        variance = splat(0.0)
        for i in range(NX):
            for j in range(NX):
                variance = variance + get(slopes, a, i) * get(state.covariance, i, j) * get(slopes, a, j)
        put(sqrt(select(variance < 0.0, 0.0, variance)), kept, 1, a)


SCORES = BATCH | {recording_room: room_of_scores, record_first: begin_scores, record_sample: add_scores}
"""Kernels that ``estimate`` is made of beside the estimator's."""
