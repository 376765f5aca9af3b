"""The loops over time that compiled modules are made of: simulate batches, estimate and score batches.

Both are pasted behind a model's kernels (``harness.engine.compile``) and run without Python and without the GIL. A
batch is ``LANES`` runs of one drive; they may differ in parameters and noise. Several batches are done one after the
other in one call, because a call from Python takes as long as some steps.
"""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import (
    INPUT_ERRORS,
    LANES,
    NS,
    NU,
    NW,
    NX,
    NY,
    Belief,
    Info,
    StandIn,
    State,
    cholesky,
    get,
    mahalanobis,
    next_state,
    output,
    put,
    select,
    signals,
    signals_jacobian,
    splat,
    sqrt,
)
from harness.engine.simd.memory import borrowed, retain

LARGEST = 1e150
"""Largest magnitude of a number that enters a score: squares of millions of them can be summed."""


def outside(x, limits):
    """Return 1 in the lanes whose state is not a number or beyond the range where the equations hold."""
    bad = splat(0.0)
    for i in range(NX):
        magnitude = get(x, i)
        inside = (magnitude <= limits[i]) & (magnitude >= -limits[i])  # false for NaN
        bad = select(inside, bad, 1.0)
    return bad


def undefined(s, rows):
    """Return 1 in the lanes in which a signal is no number that can be scored: not one, infinite or absurdly large.

    Args:
        s: Signals ``(ns, LANES)``.
        rows: Negative for those that do not count ``(ns,)``.
    """
    bad = splat(0.0)
    for i in range(NS):
        if rows[i] >= 0:
            value = get(s, i)
            bad = select((value <= LARGEST) & (value >= -LARGEST), bad, 1.0)
    return bad


def beyond(s, largest):
    """Return 1 in the lanes in which a signal is not a number of the magnitude that it may have.

    Args:
        s: Signals ``(ns, LANES)``.
        largest: Largest magnitude of each; zero for those that may be anything ``(ns,)``.
    """
    bad = splat(0.0)
    for i in range(NS):
        if largest[i] > 0.0:
            value = get(s, i)
            bad = select((value <= largest[i]) & (value >= -largest[i]), bad, 1.0)  # false for NaN
    return bad


def surprised(info):
    """Return 1 in the lanes in which NIS or likelihood of a measurement is no number that can be scored."""
    nis, likelihood = get(info.nis, 0), get(info.log_likelihood, 0)
    known = (nis <= LARGEST) & (likelihood <= LARGEST) & (likelihood >= -LARGEST)
    return select((get(info.seen, 0) > 0.0) & ~known, 1.0, 0.0)


def simulate(inputs, c, deviation_x, deviation_y, limits, largest, x0, noise, truth, y, left_at):
    """Simulate batches of one drive with process and measurement noise.

    The arguments are those of ``simulate_batch``, all but ``inputs``, ``limits`` and ``largest`` with an axis of
    batches in front.
    """
    for b in range(noise.shape[0]):
        simulate_batch(
            inputs, c[b], deviation_x[b], deviation_y[b], limits, largest, x0[b], noise[b], truth[b], y[b], left_at[b]
        )


def simulate_batch(inputs, c, deviation_x, deviation_y, limits, largest, x0, noise, truth, y, left_at):
    """Simulate a batch with process and measurement noise.

    Args:
        inputs: At the samples and during the step behind each, both ``(samples, nu, LANES)``.
        c: Constants of the plant ``(nc, LANES)``.
        deviation_x: Standard deviation of the process noise per step ``(nx, LANES)``.
        deviation_y: Standard deviation of the measurement noise ``(ny, LANES)``.
        limits: Largest magnitude of each state ``(nx,)``.
        largest: Largest magnitude of each signal, zero where it may be anything ``(ns,)``.
        x0: First state ``(nx, LANES)``.
        noise: Standard normal numbers ``(samples, nx + ny, LANES)``.
        truth: Signals, written ``(samples, ns, LANES)``.
        y: Measurements, written ``(samples, ny, LANES)``.
        left_at: First sample at which a state or a signal is beyond its largest magnitude or no number, written
            ``(1, LANES)``; ``samples`` if there is none.
    """
    owned = np.empty((NX, LANES)), np.empty((NX, LANES)), np.empty((NW, LANES))
    x, ahead, w = borrowed(owned)
    (u, between), c, truth, y, noise = borrowed((inputs, c, truth, y, noise))
    samples = u.shape[0]
    put(splat(1.0 * samples), left_at, 0)
    for i in range(NX):
        put(get(x0, i), x, i)
    for k in range(samples):
        signals(x, u[k], c, truth[k])
        output(x, u[k], c, y[k])
        for i in range(NY):
            put(get(y, k, i) + get(deviation_y, i) * get(noise, k, NX + i), y, k, i)
        left = get(left_at, 0)
        bad = (outside(x, limits) > 0.0) | (beyond(truth[k], largest) > 0.0)
        put(select(bad & (left > 1.0 * k), 1.0 * k, left), left_at, 0)
        next_state(x, between[k], c, ahead, w)
        for i in range(NX):
            put(get(ahead, i) + get(deviation_x, i) * get(noise, k, i), x, i)
    retain(owned)


def estimate(inputs, y, truth, rows, until, belief, first, limits, options, bounds, scores, per_run, kept):
    """Run the estimator over batches and score it against the truth while it runs.

    The arguments are those of ``estimate_batch``. With an axis of batches in front come all that end in ``LANES`` but
    ``belief.input_errors``; that of ``inputs`` may have the length 1, where all batches have the same.
    """
    u, between, moved, moved_at = inputs
    memories = np.empty(first.memory.shape[1:]), np.empty(first.memory.shape[1:])
    for b in range(y.shape[0]):
        own, own_errors = min(b, u.shape[0] - 1), min(b, moved.shape[0] - 1)
        told = u[own], between[own], moved[own_errors], moved_at[own_errors]
        held = Belief(
            belief.constants[b], belief.process_noise[b], belief.measurement_noise[b], belief.tuning,
            belief.input_errors, belief.priors,
        )  # fmt: skip
        begun = State(first.mean[b], first.covariance[b], first.memory[b])
        estimate_batch(
            told, y[b], truth[b], rows, until[b], held, begun, limits, options, bounds, scores[b], per_run[b], kept[b],
            memories,
        )  # fmt: skip


def estimate_batch(
    inputs, y, truth, rows, until, belief, first, limits, options, bounds, scores, per_run, kept, memories
):
    """Run the estimator over a batch and score it against the truth while it runs.

    Args:
        inputs: What the estimator knows of them at the samples and during the step behind each, both
            ``(samples, nu, LANES)``, and what independent errors of unit variance do to the latter and to those at the
            next sample ``(samples, nu, m, LANES)``, which is not read where inputs are exact.
        y: Measurements ``(samples, ny, LANES)``, NaN where missing.
        truth: The plant's signals ``(samples, plant signals, LANES)``.
        rows: Row of ``truth`` of each state of the estimator, then of each target ``(nx + ns,)``; -1 where the
            plant has no such quantity, or the estimator does not give it.
        until: Scores stop before this sample ``(1, LANES)``; the truth of every target is a number up to there.
        belief: ``harness.engine.kernel_names.Belief``.
        first: ``harness.engine.kernel_names.State`` before the first step; of its covariance the variances are taken.
        limits: Largest magnitude of each state ``(nx,)``.
        options: NEES every that many samples, 1 if there is one to compute, 1 if the estimator states a covariance,
            and the first sample scored ``(4,)``.
        bounds: Two-sided 95 % chi-square bounds ``(1 + max(nx, ny), 2)`` by degrees of freedom.
        scores: Sum of squares, sum and largest magnitude of the error, written ``(3, ns, LANES)``.
        per_run: Written ``(10, LANES)``: samples scored, sum of NEES, samples of it, those inside, sum of NIS,
            samples with a measurement, those inside, log-likelihood, repairs, sample of divergence.
        kept: Estimates and standard deviations of the targets, written ``(samples or 0, 2, ns, LANES)``.
        memories: Room for what the estimator carries beside, before and after a step, each ``(rows, LANES)``.
    """
    (u, between, moved, moved_at), y, truth, belief = borrowed((inputs, y, truth, belief))
    covariance = np.zeros((NX, NX, LANES))
    mean, (memory, memory_after) = np.empty((NX, LANES)), memories
    for i in range(NX):
        put(get(first.mean, i), mean, i)
        put(get(first.covariance, i, i), covariance, i, i)
    for i in range(memory.shape[0]):
        put(get(first.memory, i), memory, i)
    row = np.zeros((4, LANES))
    owned = (
        workspace(),
        State(mean, covariance, memory),
        State(np.empty((NX, LANES)), np.zeros((NX, NX, LANES)), memory_after),
        Info(np.zeros((NY, LANES)), np.zeros((NY, NY, LANES)), row[0:1], row[1:2], row[2:3], row[3:4]),
        (np.empty((NS, LANES)), np.empty((NS, NX, LANES))),
        (np.zeros((NX, NX, LANES)), np.empty((NX, LANES)), np.empty((NX, LANES))),
    )
    work, before, after, info, (s, slopes), (factor, error, scratch) = borrowed(owned)
    samples, every, comparable, stated = u.shape[0], int(options[0]), options[1] > 0.5, options[2] > 0.5
    scores[:] = 0.0
    per_run[:] = 0.0
    put(splat(1.0 * samples), per_run, 9)
    if kept.shape[0] > 0:
        keep(before, u[0], belief, s, slopes, kept[0])
    for k in range(1, samples):
        if INPUT_ERRORS:
            spread_of_inputs(before.mean, between[k - 1], u[k], moved[k - 1], moved_at[k], belief)
        advance(before, between[k - 1], u[k], y[k], belief, work, after, info)
        before, after = turned(before, after)
        diverged = get(per_run, 9)
        signals(before.mean, u[k], belief.constants, s)
        bad = (outside(before.mean, limits) > 0.0) | (undefined(s, rows[NX:]) > 0.0)
        if stated:
            bad = bad | (surprised(info) > 0.0)
        bad = bad & (diverged > 1.0 * k) & (get(until, 0) > 1.0 * k)
        diverged = select(bad, 1.0 * k, diverged)
        put(diverged, per_run, 9)
        active = (diverged > 1.0 * k) & (get(until, 0) > 1.0 * k) & (splat(1.0 * k) >= options[3])
        score_targets(s, truth[k], rows, active, scores)
        score_information(info, active, bounds, per_run)
        if comparable and k % every == 0:
            write_covariance(before, work)
            score_covariance(before, truth[k], rows, active, bounds, factor, error, scratch, per_run)
        if kept.shape[0] > 0:
            write_covariance(before, work)
            keep(before, u[k], belief, s, slopes, kept[k])
    retain(owned)


def spread_of_inputs(x, between, u, moved, moved_at, belief):
    """Write what the errors of the inputs do to the next state and to the outputs: ``belief.input_errors``.

    By central differences over a square root of three standard deviations to either side, the interval of Nørgaard,
    Poulsen and Ravn (2000) for normal errors.

    Args:
        x: State ``(nx, LANES)``.
        between: Inputs that lead to the next state ``(nu, LANES)``.
        u: Inputs there ``(nu, LANES)``.
        moved: What each error of unit variance does to the former ``(nu, m, LANES)``.
        moved_at: What it does to the latter ``(nu, m, LANES)``.
        belief: ``harness.engine.kernel_names.Belief``.
    """
    reach = np.sqrt(3.0)
    w, one, other = np.empty((NW, LANES)), np.empty((NX, LANES)), np.empty((NX, LANES))
    ahead, seen, unlike = np.empty((NX, LANES)), np.empty((NY, LANES)), np.empty((NY, LANES))
    shifted, back = np.empty((NU, LANES)), np.empty((NU, LANES))
    next_state(x, between, belief.constants, ahead, w)
    for c in range(moved.shape[1]):
        for i in range(NU):
            put(get(between, i) + reach * get(moved, i, c), shifted, i)
            put(get(between, i) - reach * get(moved, i, c), back, i)
        next_state(x, shifted, belief.constants, one, w)
        next_state(x, back, belief.constants, other, w)
        for i in range(NX):
            put((get(one, i) - get(other, i)) / (2.0 * reach), belief.input_errors, i, c)
        for i in range(NU):
            put(get(u, i) + reach * get(moved_at, i, c), shifted, i)
            put(get(u, i) - reach * get(moved_at, i, c), back, i)
        output(ahead, shifted, belief.constants, seen)
        output(ahead, back, belief.constants, unlike)
        for a in range(NY):
            put((get(seen, a) - get(unlike, a)) / (2.0 * reach), belief.input_errors, NX + a, c)


def advance(before, u_before, u, y, belief, work, after, info):
    """Take one sample: the estimator's step, and what belongs to parameters among the states."""
    step(before, u_before, u, y, belief, work, after, info)
    settle(before, u, belief, after, info)


def turned(before, after):
    """Return what to go on from, and room for the next step."""
    return after, before


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


def keep(state, u, belief, s, slopes, kept):
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


@StandIn
def workspace():
    """Stand in for the estimator's own function of this name."""


@StandIn
def step(before, u_before, u, y, belief, work, after, info):
    """Stand in for the estimator's own function of this name."""


def write_covariance(state, work):
    """Stand for the function of an estimator whose ``step`` does not write the covariance: there is nothing to do."""


def settle(before, u, belief, after, info):
    """Stand for ``harness.engine.parameter_loops`` where no parameter is a state: there is nothing to do."""
