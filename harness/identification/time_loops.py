"""The loops over a recording that identification is made of; pasted behind the kernels of a model and its filter.

A recording is the same in all lanes; the lanes differ in what they hold the model to be. Over plain lanes these are
eight candidates, over dual numbers one candidate with its derivatives along eight directions. ``note`` is called at
every sample: over plain lanes it is ``note_run``, over dual numbers ``note_slopes``.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.engine.kernel_names import (
    LANES,
    NW,
    NX,
    NY,
    Belief,
    StandIn,
    State,
    add_input_errors,
    cholesky,
    get,
    next_covariance,
    next_state,
    output,
    output_jacobian,
    put,
    select,
    splat,
)
from harness.engine.simd import lanes as plain
from harness.engine.simd.dual import tangent_of, value_of
from harness.engine.simd.memory import borrowed, retain
from harness.runner.contract import Filter, History, Recorder
from harness.runner.filter_loop import (
    fill,
    record_first,
    record_sample,
    recording_room,
    run_filter,
)
from harness.runner.simulation_loop import FREE, outside, record_start, record_state, run_vehicle, state_room


def innovate(source, belief, first, limits, total, notes):
    """Run the filter over a recording and add up the log-likelihood of its innovations.

    Args:
        source: As ``harness.runner.filter_loop.read_recording`` reads it; the first sample is not corrected.
        belief: ``harness.engine.kernel_names.Belief``.
        first: ``harness.engine.kernel_names.State`` before the first step.
        limits: Largest magnitude of each state ``(nx,)``.
        total: Log-likelihood and first sample outside the limits (``samples`` if none), written ``(2, LANES)``.
        notes: What ``note`` writes to.
    """
    memories = np.empty(first.memory.shape), np.empty(first.memory.shape)
    run_filter(source, belief, first, memories, (limits, total, notes))


def begin_likelihood(samples, state, u, belief, room, record):
    """Set the log-likelihood to zero."""
    _, total, _ = record
    put(splat(0.0), total, 0)
    put(splat(1.0 * samples), total, 1)


def add_likelihood(k, state, previous, u_before, u, y, belief, work, info, room, record):
    """Add the log-likelihood of a sample, note what is asked for, and whether the state is outside its limits."""
    limits, total, notes = record
    note(previous, state, u_before, u, y, belief, info, room, k, notes)
    put(get(total, 0) + get(info.log_likelihood, 0), total, 0)
    valid_until = get(total, 1)
    put(select((outside(state.mean, limits) > 0.0) & (valid_until > 1.0 * k), 1.0 * k, valid_until), total, 1)


def scratchpad():
    """Return the scratch arrays of ``note``."""
    return (
        np.zeros((NY, NY, LANES)),
        np.zeros((NY, NY, LANES)),
        np.empty((NX, LANES)),
        np.empty((NY, LANES)),
        np.empty((NY, NX, LANES)),
        np.empty((NW, LANES)),
        np.zeros((NY, NY, plain.LANES)),
        np.zeros((NX, NX, LANES)),
        np.empty((NY, NX, LANES)),
    )


def factorise(info, y, S, factor):
    """Write the Cholesky factor of the innovation covariance, with unit rows in place of missing measurements."""
    for a in range(NY):
        for b in range(NY):
            seen = (get(y, a) == get(y, a)) & (get(y, b) == get(y, b))
            put(select(seen, get(info.innovation_covariance, a, b), 1.0 if a == b else 0.0), S, a, b)
    cholesky(S, factor, NY)


def note_run(before, after, u_before, u, y, belief, info, scratch, k, notes):
    """Keep what the filters of the first lanes did at a sample, of as many as there is room for.

    The gain is that of a filter linearised at its prediction.
    """
    S, factor, x_prior, predicted, H, w, _, P_prior, V = scratch
    if notes[0].shape[0] > 0:
        next_state(before.mean, u_before, belief.constants, x_prior, w)
        output_jacobian(x_prior, u, belief.constants, predicted, H)
        R, errors = belief.measurement_noise, belief.input_errors
        keep_lanes(info, y, S, factor, after.mean, k, notes)
        if errors.shape[1] == 0:
            keep_gain(y, H, after.covariance, R, k, notes)
        else:
            next_covariance(before.mean, u_before, belief.constants, before.covariance, x_prior, P_prior, w)
            for i in range(NX):
                put(get(P_prior, i, i) + get(belief.process_noise, i), P_prior, i, i)
            add_input_errors(P_prior, errors)
            see_errors(P_prior, H, errors, y, factor, V)
            keep_correlated_gain(V, y, k, notes)


def see_errors(P_prior, H, errors, y, factor, V):
    """Write the covariance of measurements and state over the factor of theirs, ``L^-1 (H P + D G')``.

    Args:
        P_prior: Covariance of the prediction, with ``G G'`` in it ``(nx, nx, LANES)``.
        H: Output Jacobian ``(ny, nx, LANES)``.
        errors: Effect ``G`` of the inputs' errors on the state and ``D`` on the outputs ``(nx + ny, m, LANES)``.
        y: Measurements ``(ny, LANES)``, NaN where missing.
        factor: ``L`` with unit rows of missing measurements ``(ny, ny, LANES)``.
        V: Written ``(ny, nx, LANES)``, 0 in rows of missing measurements.
    """
    for a in range(NY):
        for i in range(NX):
            total = splat(0.0)
            for j in range(NX):
                total = total + get(P_prior, i, j) * get(H, a, j)
            for c in range(errors.shape[1]):
                total = total + get(errors, i, c) * get(errors, NX + a, c)
            for b in range(a):
                total = total - get(factor, a, b) * get(V, b, i)
            put(select(get(y, a) == get(y, a), total / get(factor, a, a), 0.0), V, a, i)


def keep_lanes(info, y, S, factor, x, k, notes):
    """Keep what the filters of the first lanes did at a sample, as plain numbers, lane by lane.

    Written to ``notes`` are the innovation and its standard deviation ``(lanes, samples, ny)``; the innovation over its
    Cholesky factor ``(lanes, samples, ny)``, NaN where missing; the inverse of that factor ``(lanes, samples, ny,
    ny)``; and the corrected mean ``(lanes, samples, states of x)``, of which the first ``NX`` are those of the filter.
    """
    innovation, deviation, whitened, whitening, _, state = notes
    factorise(info, y, S, factor)
    for n in range(state.shape[0]):
        for a in range(NY):
            missing = np.isnan(y[a, n])
            for b in range(a + 1):
                total = 1.0 if a == b else 0.0
                for c in range(b, a):
                    total -= factor[a, c, n] * whitening[n, k, c, b]
                whitening[n, k, a, b] = total / factor[a, a, n]
            total = 0.0
            for b in range(a + 1):
                if not np.isnan(y[b, n]):
                    total += whitening[n, k, a, b] * info.innovation[b, n]
            innovation[n, k, a] = info.innovation[a, n]
            deviation[n, k, a] = np.sqrt(info.innovation_covariance[a, a, n])
            whitened[n, k, a] = np.nan if missing else total
        for i in range(x.shape[0]):
            state[n, k, i] = x[i, n]


def keep_gain(y, H, P, R, k, notes):
    """Keep the gain ``K = P H' R^-1`` with the corrected covariance ``P``, lane by lane ``(lanes, samples, nx, ny)``.

    It holds for noise of the measurements that is independent of the prediction.
    """
    gain = notes[4]
    for n in range(gain.shape[0]):
        for a in range(NY):
            missing = np.isnan(y[a, n])
            for i in range(NX):
                total = 0.0
                for j in range(NX):
                    total += P[i, j, n] * H[a, j, n]
                gain[n, k, i, a] = 0.0 if missing else total / R[a, n]


def keep_correlated_gain(V, y, k, notes):
    """Keep the gain of measurements that see the same errors of the inputs as the prediction.

    It is their covariance with the state over the Cholesky factor ``L`` of theirs, ``V`` ``(ny, nx, LANES)``, times
    ``L^-1``, which ``keep_lanes`` has kept.
    """
    whitening, gain = notes[3], notes[4]
    for n in range(gain.shape[0]):
        for i in range(NX):
            for b in range(NY):
                total = 0.0
                if not np.isnan(y[b, n]):
                    for a in range(b, NY):
                        if not np.isnan(y[a, n]):
                            total += V[a, i, n] * whitening[n, k, a, b]
                gain[n, k, i, b] = total


def note_slopes(before, after, u_before, u, y, belief, info, scratch, k, notes):
    """Keep the derivatives of a sample from which the Fisher information follows; over dual numbers only.

    With the innovation ``e``, its covariance ``S = L L'`` and the derivatives ``de, dS`` along each direction,
    ``L^-1 de`` and ``G = L^-1 dS L^-T`` are whitened, and the information that the sample holds on two directions is
    ``(L^-1 de_i)' (L^-1 de_j) + tr(G_i G_j) / 2``. Written to ``notes (samples, ny + ny (ny + 1) / 2, lanes)`` are
    ``L^-1 de`` and the lower triangle of ``G``, its diagonal over the root of 2, so that the information is the sum
    of products of the rows. Rows of missing measurements are zero.
    """
    S, factor, _, _, _, _, ratio, _, _ = scratch
    factorise(info, y, S, factor)
    row = NY
    for a in range(NY):
        inverse = 1.0 / value_of(get(factor, a, a))
        e = select(get(y, a) == get(y, a), get(info.innovation, a), 0.0)
        rest = tangent_of(e)
        for b in range(a):
            rest = rest - value_of(get(factor, a, b)) * plain.get(notes, k, b)
        plain.put(rest * inverse, notes, k, a)
        for b in range(a + 1):  # ratio = L^-1 dL, of which G is the sum with its transpose
            rest = tangent_of(get(factor, a, b))
            for c in range(b, a):
                rest = rest - value_of(get(factor, a, c)) * plain.get(ratio, c, b)
            rest = rest * inverse
            plain.put(rest, ratio, a, b)
            plain.put(1.4142135623730951 * rest if a == b else rest, notes, k, row)
            row += 1


def follow(u, between, y, constants, x0, gain, whitening, slopes):
    """Run the mean alone, with the gains and the whitening of an earlier run; over dual numbers only.

    Args:
        u: Inputs ``(samples, nu)``.
        between: Inputs during the step behind each sample ``(samples, nu)``.
        y: Measurements ``(samples, ny)``, NaN where missing.
        constants: ``(nc, LANES)``.
        x0: First mean ``(nx, LANES)``.
        gain: That of the run, ``(samples, nx, ny)``; states behind its rows are not corrected.
        whitening: From ``keep_lanes``, ``(samples, ny, ny)``.
        slopes: Derivatives of the whitened innovations, written ``(samples, ny, lanes)``.
    """
    samples, nu = u.shape
    owned = (
        (np.empty((NX, LANES)), np.empty((NX, LANES)), np.empty((NW, LANES))),
        (np.empty((NY, LANES)), np.empty((nu, LANES))),
    )
    (x, x_prior, w), (e, u_now) = borrowed(owned)
    u, between, constants, slopes = borrowed((u, between, constants, slopes))
    for i in range(NX):
        put(get(x0, i), x, i)
    for k in range(1, samples):
        fill(between[k - 1], u_now)
        next_state(x, u_now, constants, x_prior, w)
        fill(u[k], u_now)
        output(x_prior, u_now, constants, e)
        for a in range(NY):
            if np.isnan(y[k, a]):
                put(splat(0.0), e, a)
            else:
                put(y[k, a] - get(e, a), e, a)
        for i in range(NX):
            value = get(x_prior, i)
            for a in range(NY if i < gain.shape[1] else 0):
                value = value + gain[k, i, a] * get(e, a)
            put(value, x, i)
        for a in range(NY):
            total = plain.splat(0.0)
            for b in range(a + 1):
                total = total + whitening[k, a, b] * tangent_of(get(e, b))
            plain.put(total, slopes, k, a)
    retain(owned)


def run_free(source, constants, x0, limits, states, outputs, left_at):
    """Run the model free over the inputs of a recording, without noise and without measurements.

    Args:
        source: Inputs and inputs during the step behind each sample, both ``(samples, nu)``.
        constants: ``(nc, LANES)``.
        x0: First state ``(nx, LANES)``.
        limits: Largest magnitude of each state ``(nx,)``.
        states: Of the first lane, written ``(samples, nx)``.
        outputs: Of the first lane, written ``(samples, ny)``.
        left_at: First sample outside the limits, written ``(1, LANES)``; ``samples`` if there is none.
    """
    run_vehicle(source, constants, x0, (limits, states, outputs, left_at))


def begin_free(samples, record):
    """Take it that the run stays within its limits."""
    _, _, _, left_at = record
    put(splat(1.0 * samples), left_at, 0)


def room_of_outputs():
    """Return the outputs of a sample in lanes."""
    return (np.empty((NY, LANES)),)


def keep_free(k, x, u, c, room, record):
    """Write state and outputs of a sample, and whether the state is outside its limits."""
    (y,), (limits, states, outputs, left_at) = room, record
    output(x, u, c, y)
    for i in range(NX):
        states[k, i] = x[i, 0]
    for a in range(NY):
        outputs[k, a] = y[a, 0]
    valid_until = get(left_at, 0)
    put(select((outside(x, limits) > 0.0) & (valid_until > 1.0 * k), 1.0 * k, valid_until), left_at, 0)
    return False


@StandIn
def note(before, after, u_before, u, y, belief, info, scratch, k, notes):
    """Stand in for one of the notes above."""


LIKELIHOOD = {
    recording_room: scratchpad,
    record_first: begin_likelihood,
    record_sample: add_likelihood,
}
"""Kernels that ``innovate`` is made of with the estimator's and ``note``."""


@dataclass(frozen=True)
class Likelihood:
    """Log-likelihood and first sample outside the limits (``samples`` if none), in every lane ``(2, lanes)``.

    Attributes:
        kernel: What is kept of the samples, in place of ``note``.
        notes: What it writes to.
    """

    kernel: Callable[..., None]
    notes: Any

    @property
    def recorder(self) -> Recorder:
        """Its kernels."""
        return Recorder(innovate, LIKELIHOOD | {note: self.kernel})

    def run(
        self,
        loop: Callable[..., None],
        source: tuple[Any, ...],
        belief: Belief,
        first: State,
        limits: Floats,
        filter_: Filter,
    ) -> Floats:
        """Run the compiled loop over a recording."""
        total = np.empty((2, first.mean.shape[-1]))
        loop(source, belief, first, limits, total, self.notes)
        return total

    def of(self, history: History, filter_: Filter) -> Floats:
        """Return those of runs side by side, of which nothing else is kept."""
        outside_limits = history.facts[:, 4] > 0
        first_outside = np.where(outside_limits.any(axis=0), outside_limits.argmax(axis=0), len(outside_limits))
        return np.stack([history.facts[1:, 2].sum(axis=0), first_outside])


FREE_RUN = FREE | {state_room: room_of_outputs, record_start: begin_free, record_state: keep_free}
"""Kernels that ``run_free`` is made of."""
