"""The loops over time as kernels of a card: one thread for each run."""

from __future__ import annotations

import numpy as np
from numba import cuda

from harness.cuda.lanes import own, shaped
from harness.engine.kernel_names import LANES, NU, NX, NY, Belief, State, get, put
from harness.engine.standard_normal import begin, draw, refused
from harness.runner.filter_loop import run_filter
from harness.runner.simulation_loop import run_vehicle


def draw_noise(words, widths, inside, heights, noise):
    """Draw standard normal numbers of each run; see ``harness.engine.standard_normal.fill``.

    Args:
        words: Of the seed of each run ``(runs, 1 + words)``.
        widths: Of the layers, over the largest word ``(256,)``.
        inside: Words below these lie inside the rectangle of their layer ``(256,)``.
        heights: Of the density at the layers' edges ``(256,)``.
        noise: Written ``(samples, width, runs)``.
    """
    run = cuda.grid(1)
    if run < noise.shape[2]:
        state = np.empty(4, np.uint64)
        begin(words[run], state)
        for k in range(noise.shape[0]):
            for i in range(noise.shape[1]):
                word = draw(state)
                layer, at = word & np.uint64(0xFF), (word >> np.uint64(9)) & np.uint64(0x000FFFFFFFFFFFFF)
                x = np.float64(np.int64(at)) * widths[layer]
                if at < inside[layer]:
                    noise[k, i, run] = -x if (word >> np.uint64(8)) & np.uint64(1) else x
                else:
                    noise[k, i, run] = refused(word, state, widths, inside, heights)


def copy_row(source, row, target, place):
    """Copy one row of ``(samples, rows, runs)`` to one of another such array, each run its own."""
    run = cuda.grid(1)
    if run < target.shape[2]:
        for k in range(target.shape[0]):
            target[k, place, run] = source[k, row, run]


def hold_row(values, row, target, place):
    """Write what does not change over time, a row of ``(rows, runs)``, to a row of ``(samples, rows, runs)``."""
    run = cuda.grid(1)
    if run < target.shape[2]:
        for k in range(target.shape[0]):
            target[k, place, run] = values[row, run]


def carried_over(before, after):
    """Return what to go on from, and room for the next step: the same arrays each time, which stay in registers."""
    for i in range(NX):
        put(get(after.mean, i), before.mean, i)
        for j in range(NX):
            put(get(after.covariance, i, j), before.covariance, i, j)
    for i in range(before.memory.shape[0]):
        put(get(after.memory, i), before.memory, i)
    return before, after


def simulate_runs(u, between, c, deviation_x, deviation_y, limits, largest, x0, noise, truth, y, left_at):
    """Simulate the run of each thread; see ``harness.runner.simulation_loop``, with runs in place of lanes."""
    run = cuda.grid(1)
    if run < left_at.shape[1]:
        record = (
            own(deviation_x, run),
            own(deviation_y, run),
            limits,
            largest,
            own(noise, run),
            own(truth, run),
            own(y, run),
            own(left_at, run),
        )
        run_vehicle((own(u, run), own(between, run)), own(c, run), own(x0, run), record)


def estimate_runs(
    u, y, truth, rows, turns, until, constants, process_noise, measurement_noise, tuning, priors, mean, covariance,
    memory, limits, options, bounds, scores, per_run,
):  # fmt: skip
    """Estimate the run of each thread; see ``harness.runner.scores``, with runs in place of lanes.

    Before the first of ``priors`` is a row of no meaning: there may be none, and a card takes no array of no length.
    """
    run = cuda.grid(1)
    if run < until.shape[1]:
        inputs = shaped(own(u, run), (0, NU, LANES))
        belief = Belief(
            own(constants, run), own(process_noise, run), own(measurement_noise, run), tuning, None, priors[1:]
        )
        first = State(own(mean, run), own(covariance, run), own(memory[0], run))
        source = inputs, inputs, inputs, inputs, shaped(own(y, run), (0, NY, LANES))
        none_kept = np.empty((1, 1, 1, 1))[1:]
        record = (
            own(truth, run),
            rows,
            turns,
            own(until, run),
            limits,
            options,
            bounds,
            own(scores, run),
            own(per_run, run),
            none_kept,
        )
        run_filter(source, belief, first, (own(memory[1], run), own(memory[2], run)), record)
