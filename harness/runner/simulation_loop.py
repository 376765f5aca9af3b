"""The loop over time of a vehicle, and where its inputs come from.

It is pasted behind a model's kernels (``harness.engine.compile.paste``) and runs without Python and without the GIL.
What is kept of a sample, and what disturbs the next state, are kernels in place of the stand-ins below.
"""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import (
    LANES,
    NS,
    NU,
    NW,
    NX,
    NY,
    StandIn,
    get,
    next_state,
    output,
    put,
    select,
    signals,
    splat,
)
from harness.engine.simd.memory import borrowed, retain
from harness.runner.filter_loop import fill, no_room


def run_vehicle(source, c, x0, record):
    """Run a model over the inputs of a batch or of a recording.

    Args:
        source: What ``inputs_at`` reads from, inputs at the samples first.
        c: Constants ``(nc, LANES)``.
        x0: First state ``(nx, LANES)``.
        record: What ``record_state`` writes to and ``disturb`` reads from.
    """
    owned = np.empty((NX, LANES)), np.empty((NX, LANES)), np.empty((NW, LANES)), input_room(), state_room()
    x, ahead, w, reading, room = borrowed(owned)
    source, c, record = borrowed((source, c, record))
    samples = source[0].shape[0]
    record_start(samples, record)
    for i in range(NX):
        put(get(x0, i), x, i)
    for k in range(samples):
        u, between = inputs_at(source, k, reading)
        enough = record_state(k, x, u, c, room, record)
        if enough:
            break
        next_state(x, between, c, ahead, w)
        disturb(k, ahead, x, record)
    retain(owned)


def simulate(inputs, c, deviation_x, deviation_y, limits, largest, x0, noise, truth, y, left_at):
    """Simulate batches of one drive with process and measurement noise.

    A batch is ``LANES`` runs of one drive; they may differ in parameters and noise. Several batches are done one after
    the other in one call, because a call from Python takes as long as some steps: all arguments but ``inputs``,
    ``limits`` and ``largest`` have an axis of batches in front.

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
    for b in range(noise.shape[0]):
        record = deviation_x[b], deviation_y[b], limits, largest, noise[b], truth[b], y[b], left_at[b]
        run_vehicle(inputs, c[b], x0[b], record)


def begin_noisy(samples, record):
    """Take it that the run stays within its limits."""
    _, _, _, _, _, _, _, left_at = record
    put(splat(1.0 * samples), left_at, 0)


def measure(k, x, u, c, room, record):
    """Write signals and noisy measurements of a sample, and whether the run has left its limits."""
    _, deviation_y, limits, largest, noise, truth, y, left_at = record
    signals(x, u, c, truth[k])
    output(x, u, c, y[k])
    for i in range(NY):
        put(get(y, k, i) + get(deviation_y, i) * get(noise, k, NX + i), y, k, i)
    first_outside = get(left_at, 0)
    bad = (outside(x, limits) > 0.0) | (beyond(truth[k], largest) > 0.0)
    put(select(bad & (first_outside > 1.0 * k), 1.0 * k, first_outside), left_at, 0)
    return False


def add_noise(k, ahead, x, record):
    """Write the next state with its process noise."""
    deviation_x, _, _, _, noise, _, _, _ = record
    for i in range(NX):
        put(get(ahead, i) + get(deviation_x, i) * get(noise, k, i), x, i)


def inputs_of_batch(source, k, reading):
    """Return the inputs at a sample and during the step behind it, both of ``(samples, nu, LANES)``."""
    u, between = source
    return u[k], between[k]


def inputs_of_recording(source, k, reading):
    """Return the inputs at a sample and during the step behind it, both of ``(samples, nu)``, in lanes."""
    u, between = source
    u_now, u_between = reading
    fill(u[k], u_now)
    fill(between[k], u_between)
    return u_now, u_between


def room_of_inputs():
    """Return inputs at a sample and behind it in lanes."""
    return np.empty((NU, LANES)), np.empty((NU, LANES))


def undisturbed(k, ahead, x, record):
    """Write the next state as it is."""
    for i in range(NX):
        put(get(ahead, i), x, i)


@StandIn
def input_room():
    """Stand in for the room of ``inputs_at``."""


@StandIn
def inputs_at(source, k, reading):
    """Stand in for what reads the inputs at a sample and during the step behind it."""


@StandIn
def state_room():
    """Stand in for a recorder's scratch arrays."""


@StandIn
def record_start(samples, record):
    """Stand in for what a recorder does before the first of so many samples."""


@StandIn
def record_state(k, x, u, c, room, record):
    """Stand in for what a recorder keeps of a state; returns whether it has seen enough."""


@StandIn
def disturb(k, ahead, x, record):
    """Stand in for what becomes of the next state."""


SIMULATION = {
    input_room: no_room,
    inputs_at: inputs_of_batch,
    state_room: no_room,
    record_start: begin_noisy,
    record_state: measure,
    disturb: add_noise,
}
"""Kernels that ``simulate`` is made of."""

FREE = {input_room: room_of_inputs, inputs_at: inputs_of_recording, disturb: undisturbed}
"""Kernels of a run without noise over a recording; a recorder goes with them."""


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
    scorable = (nis <= LARGEST) & (likelihood <= LARGEST) & (likelihood >= -LARGEST)
    return select((get(info.seen, 0) > 0.0) & ~scorable, 1.0, 0.0)
