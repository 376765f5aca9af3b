"""The loop over time of a vehicle.

It is pasted behind a model's kernels (``harness.engine.compile``) and runs without Python and without the GIL. A batch
is ``LANES`` runs of one drive; they may differ in parameters and noise. Several batches are done one after the other
in one call, because a call from Python takes as long as some steps.
"""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import LANES, NW, NX, NY, get, next_state, output, put, select, signals, splat
from harness.engine.simd.memory import borrowed, retain
from harness.runner.limits import beyond, outside


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
