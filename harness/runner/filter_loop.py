"""The loop over time of a filter, and where its inputs and measurements come from.

It is pasted behind the kernels of a model and of an estimator (``harness.engine.compile.paste``) and runs without
Python and without the GIL. What is read at a sample and what is kept of it are kernels too, in place of the stand-ins
below: a reader is ``read_batch`` or ``read_recording``, a recorder one of ``scores`` and ``history`` or that of an
identification. A recorder that keeps nothing costs nothing.

After each step of a filter with parameters among its states these are settled. A filter that corrects ``x`` and ``z``
together corrects ``x`` alone by leaving out the part of its gain that belongs to ``z``: of mean and covariance only the
block of ``z`` differs then, which stays as predicted (Schmidt 1966; Jazwinski 1970, chapter 8). So any filter of the
Kalman type leaves a parameter alone if that block is put back: where a parameter is considered, and where a sample says
nothing of it. A measurement moves the states by noise even on a straight road, and where the influence of a parameter
depends on the states, they then feign one. A sample is informative of such a parameter if its logarithm, off by one,
would move the predicted measurements by a good part of what they are uncertain if it is right. What is no logarithm is
taken to be off by its first deviation.
"""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import (
    CONSIDERED,
    INPUT_ERRORS,
    LANES,
    NU,
    NW,
    NX,
    NY,
    PARAMETERS,
    SLOPES_VARY,
    TURNS,
    Info,
    StandIn,
    State,
    floor,
    get,
    next_state,
    output,
    put,
    select,
    splat,
    sqrt,
    within_bounds,
)
from harness.engine.simd.memory import borrowed, retain


def run_filter(source, belief, first, memories, record):
    """Run a filter over the samples of a batch or of a recording.

    Args:
        source: What the reader reads from.
        belief: ``harness.engine.kernel_names.Belief``.
        first: ``harness.engine.kernel_names.State`` before the first step.
        memories: Room for what the estimator carries besides the estimate, before and after, each ``(rows, LANES)``.
        record: What the recorder writes to.
    """
    source, belief, record = borrowed((source, belief, record))
    mean, covariance = np.empty((NX, LANES)), np.zeros((NX, NX, LANES))
    memory, memory_after = memories
    for i in range(NX):
        put(get(first.mean, i), mean, i)
        for j in range(NX):
            put(get(first.covariance, i, j), covariance, i, j)
    for i in range(memory.shape[0]):
        put(get(first.memory, i), memory, i)
    row = np.zeros((4, LANES))
    owned = (
        workspace(),
        State(mean, covariance, memory),
        State(np.empty((NX, LANES)), np.zeros((NX, NX, LANES)), memory_after),
        Info(np.zeros((NY, LANES)), np.zeros((NY, NY, LANES)), row[0:1], row[1:2], row[2:3], row[3:4]),
        reading_room(),
        recording_room(),
    )
    work, before, after, info, reading, room = borrowed(owned)
    samples = source[0].shape[0]
    record_first(samples, before, read_first(source, reading), belief, room, record)
    for k in range(1, samples):
        u_before, u, y = read(source, k, before, belief, reading)
        advance(before, u_before, u, y, belief, work, after, info)
        before, after = turned(before, after)
        record_sample(k, before, after, u_before, u, y, belief, work, info, room, record)
    retain(owned)


def advance(before, u_before, u, y, belief, work, after, info):
    """Take one sample: the estimator's step, and what belongs to parameters among the states.

    ``step`` stands in for that of a file in ``harness/estimation/methods``, put in by
    ``harness.estimation.contract.kernels_of``.
    """
    step(before, u_before, u, nearest_turn(before, u, y, belief), belief, work, after, info)
    settle(before, u, belief, after, info)


def nearest_turn(before, u, y, belief):
    """Stand in for ``nearest_turns`` where no measurement is periodic.

    Put in by ``estimation.contract.kernels_of``.
    """
    return y


def nearest_turns(before, u, y, belief):
    """Return measurements ``(ny, LANES)``, those of periodic signals at the turn nearest to the state before.

    Innovations are then differences modulo a turn, whatever the estimator; no angle is expected to move by half a turn
    from sample to sample.
    """
    expected, nearest = np.empty((NY, LANES)), np.empty((NY, LANES))
    output(before.mean, u, belief.constants, expected)
    for a in range(NY):
        value = get(y, a)
        if TURNS[a] > 0.0:
            value = get(expected, a) + within_turn(value - get(expected, a), TURNS[a])
        put(value, nearest, a)
    return nearest


def within_turn(apart, turn):
    """Return a difference, of what repeats itself after a turn the one nearest to zero; a turn of 0 is none."""
    if turn > 0.0:
        return apart - turn * floor(apart / turn + 0.5)
    return apart


def turned(before, after):
    """Return what to go on from, and room for the next step."""
    return after, before


def read_batch(source, k, before, belief, reading):
    """Return the inputs before a sample and at it, and its measurements, of a batch of runs.

    Args:
        source: What the estimator knows of the inputs at the samples and during the step behind each, both
            ``(samples, nu, LANES)``, and what independent errors of unit variance do to the latter and to those at the
            next sample ``(samples, nu, m, LANES)``, which is not read where inputs are exact; measurements
            ``(samples, ny, LANES)``, NaN where missing.
        k: The sample.
        before: State that the inputs' errors are linearised at.
        belief: Its ``input_errors`` are written.
        reading: From ``reading_room``.
    """
    u, between, moved, moved_at, y = source
    if INPUT_ERRORS:
        spread_of_inputs(before.mean, between[k - 1], u[k], moved[k - 1], moved_at[k], belief)
    return between[k - 1], u[k], y[k]


def read_first_of_batch(source, reading):
    """Return the inputs at the first sample of a batch ``(nu, LANES)``."""
    return source[0][0]


def no_room():
    """Return next to no room, for what needs none."""
    return (np.empty((1, LANES)),)


def read_recording(source, k, before, belief, reading):
    """Return the inputs before a sample and at it, and its measurements, of a recording that all lanes share.

    Args:
        source: Inputs, and inputs during the step behind each sample, both ``(samples, nu)``; measurements
            ``(samples, ny)``, NaN where missing; and what the errors of the inputs do ``(samples, nx + ny, m)``.
        k: The sample.
        before: State.
        belief: Its ``input_errors`` are written.
        reading: From ``reading_room``.
    """
    u, between, y, errors = source
    u_before, u_now, y_now = reading
    fill(between[k - 1], u_before)
    fill(u[k], u_now)
    fill(y[k], y_now)
    fill_table(errors[k], belief.input_errors)
    return u_before, u_now, y_now


def read_first_of_recording(source, reading):
    """Return the inputs at the first sample of a recording ``(nu, LANES)``."""
    fill(source[0][0], reading[1])
    return reading[1]


def room_of_recording():
    """Return inputs before a sample, inputs and measurements in lanes."""
    return np.empty((NU, LANES)), np.empty((NU, LANES)), np.empty((NY, LANES))


def fill(values, numbers):
    """Write plain values, the same for all lanes."""
    for i in range(numbers.shape[0]):
        put(values[i], numbers, i)


def fill_table(values, numbers):
    """Write a plain matrix, the same for all lanes."""
    for i in range(numbers.shape[0]):
        for j in range(numbers.shape[1]):
            put(values[i, j], numbers, i, j)


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
    w, forward, backward = np.empty((NW, LANES)), np.empty((NX, LANES)), np.empty((NX, LANES))
    ahead, seen, unlike = np.empty((NX, LANES)), np.empty((NY, LANES)), np.empty((NY, LANES))
    shifted, back = np.empty((NU, LANES)), np.empty((NU, LANES))
    next_state(x, between, belief.constants, ahead, w)
    for c in range(moved.shape[1]):
        for i in range(NU):
            put(get(between, i) + reach * get(moved, i, c), shifted, i)
            put(get(between, i) - reach * get(moved, i, c), back, i)
        next_state(x, shifted, belief.constants, forward, w)
        next_state(x, back, belief.constants, backward, w)
        for i in range(NX):
            put((get(forward, i) - get(backward, i)) / (2.0 * reach), belief.input_errors, i, c)
        for i in range(NU):
            put(get(u, i) + reach * get(moved_at, i, c), shifted, i)
            put(get(u, i) - reach * get(moved_at, i, c), back, i)
        output(ahead, shifted, belief.constants, seen)
        output(ahead, back, belief.constants, unlike)
        for a in range(NY):
            put((get(seen, a) - get(unlike, a)) / (2.0 * reach), belief.input_errors, NX + a, c)


@StandIn
def workspace():
    """Stand in for that of a file in ``harness/estimation/methods``, put in by ``estimation.contract.kernels_of``."""


@StandIn
def step(before, u_before, u, y, belief, work, after, info):
    """Stand in for that of a file in ``harness/estimation/methods``, put in by ``estimation.contract.kernels_of``."""


def write_covariance(state, work):
    """Stand in for that of an estimator whose ``step`` does not write the covariance: there is nothing to do.

    Put in by ``estimation.contract.kernels_of``.
    """


def settle(before, u, belief, after, info):
    """Stand in for ``harness.estimation.contract`` where no parameter is a state: there is nothing to do.

    Put in by ``estimation.contract.kernels_of``.
    """


@StandIn
def reading_room():
    """Stand in for a reader's room: ``BATCH`` or ``RECORDING``."""


@StandIn
def read_first(source, reading):
    """Stand in for a reader's inputs at the first sample: ``BATCH`` or ``RECORDING``."""


@StandIn
def read(source, k, before, belief, reading):
    """Stand in for a reader: ``BATCH`` or ``RECORDING``."""


@StandIn
def recording_room():
    """Stand in for a recorder's scratch arrays, put in by ``harness.runner.contract.Recorder.kernels``."""


@StandIn
def record_first(samples, state, u, belief, room, record):
    """Stand in for what a recorder keeps of the first state, behind which there are so many samples."""


@StandIn
def record_sample(k, state, previous, u_before, u, y, belief, work, info, room, record):
    """Stand in for what a recorder keeps of a sample: of the state after its step, and the one before."""


BATCH = {reading_room: no_room, read_first: read_first_of_batch, read: read_batch}
"""Kernels that read a batch."""

RECORDING = {reading_room: room_of_recording, read_first: read_first_of_recording, read: read_recording}
"""Kernels that read a recording."""


FEIGNED = 0.1
"""Share of the variance of predicted measurements, the parameter being right, up to which its influence may be feigned.

At rest the influence that noise feigns is some hundredths at most; less than 0.1 lets an estimate drift, and of 1 a
parameter that is very uncertain is not found, because the filter then trusts its measurements more and hides it.
"""


def bound_parameters(before, u, belief, after, info):
    """Bring the states of parameters back to within their bounds."""
    bounded = np.empty((PARAMETERS, LANES))
    within_bounds(after.mean, u, belief.constants, bounded)
    for i in range(PARAMETERS):
        put(get(bounded, i), after.mean, NX - PARAMETERS + i)


def settle_parameters(before, u, belief, after, info):
    """Leave parameters alone of which nothing is learnt; the variance of a walk then grows to the first one at most."""
    first = NX - PARAMETERS
    held = np.empty((PARAMETERS, LANES))
    hold(before, belief, after, info, held)
    for i in range(PARAMETERS):
        still = get(held, i) > 0.0
        put(select(still, get(before.mean, first + i), get(after.mean, first + i)), after.mean, first + i)
        for j in range(i + 1):
            value = get(before.covariance, first + i, first + j)
            if i == j:
                value = value + get(belief.process_noise, first + i)
            both = still & (get(held, j) > 0.0)
            value = select(both, value, get(after.covariance, first + i, first + j))
            put(value, after.covariance, first + i, first + j)
            put(value, after.covariance, first + j, first + i)
    for i in range(PARAMETERS):
        limit_variance(after.covariance, first + i, select(get(held, i) > 0.0, belief.priors[i, 0], np.inf))
    bound_parameters(before, u, belief, after, info)


def hold(before, belief, after, info, held):
    """Write 1 for parameters that are considered, or of which this sample says nothing, else 0 ``(parameters, LANES)``.

    With ``s`` the slope of the predicted measurements to a parameter, ``P`` its variance and ``S`` their covariance,
    the sample takes ``P s' S^-1 s P`` away from ``P``. So ``s' S^-1 s`` is found for any filter, whatever its kernels.
    """
    first = NX - PARAMETERS
    uncertain = splat(0.0)
    for a in range(NY):
        share = 1.0 - get(belief.measurement_noise, a) / get(info.innovation_covariance, a, a)
        measured = get(info.innovation, a) == get(info.innovation, a)
        uncertain = uncertain + select(measured, share, 0.0)
    for i in range(PARAMETERS):
        predicted = get(before.covariance, first + i, first + i) + get(belief.process_noise, first + i)
        removed = (predicted - get(after.covariance, first + i, first + i)) / predicted
        uncertain = uncertain - removed
        put(belief.priors[i, 1] * removed / predicted, held, i)
    for i in range(PARAMETERS):
        feigned = (get(held, i) <= 0.0) | (get(held, i) <= FEIGNED * uncertain)
        if CONSIDERED[i]:
            put(1.0, held, i)
        elif SLOPES_VARY[i]:
            put(select(feigned, 1.0, 0.0), held, i)
        else:
            put(0.0, held, i)


def limit_variance(P, i, largest):
    """Scale row and column of a covariance so that a variance is at most ``largest``."""
    variance = get(P, i, i)
    factor = select(variance > largest, sqrt(largest / variance), 1.0)
    for j in range(NX):
        value = get(P, i, j) * factor
        put(value, P, i, j)
        put(value, P, j, i)
    put(variance * factor * factor, P, i, i)
