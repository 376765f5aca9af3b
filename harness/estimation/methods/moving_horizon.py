"""Moving-horizon estimation: the likeliest states over a window of samples, by Gauss-Newton iterations.

At each sample it minimises over the states of the last ``window`` samples (Rao, Rawlings and Mayne 2003)

    |x_0 - a|^2 in P_a^-1  +  sum |x_j - f(x_j-1)|^2 in Q^-1  +  sum |y_j - h(x_j)|^2 in R^-1.

The arrival cost, mean ``a`` and covariance ``P_a`` of the state in which the window begins, moves on by one step of an
extended Kalman filter that is linearised where the window's states were found. A Gauss-Newton iteration is a Kalman
filter and a smoother on the equations linearised about the states found last (Bell 1994), so nothing is inverted, and
process noise may be zero. The smoother is that of Bryson and Frazier, written as costates of the problem: with ``l``
behind sample ``j``, ``x_j = x_filtered - P_filtered l``, and ahead of it ``F' (l - H' R^-1 (y - h(x_j)))``.

The covariance is that of the filter at the last sample. Innovation and likelihood are those of its first iteration,
which has not seen the sample. Errors of the inputs count as independent noise.

Memory, in rows of lanes, with a window of L samples: how many samples are in it, ``a (nx)`` and ``P_a (nx, nx)`` of
this window, then the same of the next one; of each sample the inputs before and at it, measurements, variances of both
noises and the state found.
"""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.engine.compile import CompiledModel
from harness.engine.kernel_names import (
    LANES,
    NU,
    NW,
    NX,
    NY,
    SEEN_STATES,
    get,
    next_covariance,
    next_jacobian,
    output_jacobian,
    put,
    scalar_updates,
    select,
    splat,
)
from harness.estimation.methods._input_errors import output_noise, state_noise
from harness.estimation.methods._linearised import spare_info


class Settings(BaseModel):
    """Length of the window, and how often its equations are linearised anew."""

    model_config = ConfigDict(extra="forbid")

    window: int = Field(20, ge=1, le=1000, description="number of samples in the window; the cost grows with it")
    iterations: int = Field(2, ge=1, le=50, description="Gauss-Newton iterations per sample")


# no KALMAN_TYPE: what is linearised anew is not what a gain at one sample could leave alone


def tuning(settings: Settings, nx: int, ny: int) -> list[float]:
    """Return length of the window and number of iterations."""
    return [float(settings.window), float(settings.iterations)]


def memory_size(settings: Settings, compiled: CompiledModel) -> int:
    """Return the number of rows of memory; see above."""
    nx, nu, ny = compiled.nx, compiled.nu, compiled.ny
    return 1 + 2 * (nx + nx * nx) + (settings.window + 1) * (2 * nu + 2 * ny + 2 * nx)


def workspace():
    """Return the scratch arrays of a run."""
    return (
        np.empty((NW, LANES)),
        np.empty((3, NX, LANES)),
        np.empty((2, NX, NX, LANES)),
        np.empty((3, NY, LANES)),
        np.empty((NY, NX, LANES)),
        np.empty((2 * NX, LANES)),
        spare_info(),
    )


def parts(memory, nx, nu, ny):
    """Return arrival ``(2, nx + nx nx, lanes)``, of this window and the next, and the samples ``(L + 1, rows, lanes)``.

    Row 0 of the samples is the state in which the window begins. In a sample are, from the columns of ``columns`` on,
    inputs before and at it, measurements, their variances, process noise and the state found.
    """
    lanes, arrival, rows = memory.shape[1], nx + nx * nx, 2 * (nu + ny + nx)
    behind = 1 + 2 * arrival
    count = (memory.shape[0] - behind) // rows
    return memory[1:behind].reshape((2, arrival, lanes)), memory[behind:].reshape((count, rows, lanes))


def columns(nx, nu, ny):
    """Return where in a sample measurements, their variances, process noise and state begin."""
    return 2 * nu, 2 * nu + ny, 2 * (nu + ny), 2 * (nu + ny) + nx


def step(before, u_before, u, y, belief, work, after, info):
    """Move the window on, find its states, and state the last of them."""
    limit, iterations = int(belief.tuning[0]), int(belief.tuning[1])
    arrivals, samples = parts(after.memory, NX, NU, NY)
    Y, R, Q, _ = columns(NX, NU, NY)
    held = int(before.memory[0, 0])
    last = move_window(before, held, limit, after.memory)
    put(splat(1.0 * last), after.memory, 0)
    r, q = output_noise(belief), state_noise(belief)
    for i in range(NU):
        put(get(u_before, i), samples, last, i)
        put(get(u, i), samples, last, NU + i)
    for a in range(NY):
        put(get(y, a), samples, last, Y + a)
        put(get(r, a), samples, last, R + a)
    for i in range(NX):
        put(get(q, i), samples, last, Q + i)
    filtered = np.empty((last + 1, NX, LANES))
    covariances = np.empty((last + 1, NX, NX, LANES))
    for n in range(iterations):
        filter_window(n == 0, arrivals[0], samples[: last + 1], belief.constants, work, filtered, covariances, info)
        smooth_window(samples[: last + 1], belief.constants, work, filtered, covariances)
    begins = 1 if last == limit else 0
    for i in range(NX):
        put(get(filtered, begins, i), arrivals, 1, i)
        put(get(filtered, last, i), after.mean, i)
        for j in range(NX):
            put(get(covariances, begins, i, j), arrivals, 1, NX + i * NX + j)
            put(get(covariances, last, i, j), after.covariance, i, j)
    put(splat(0.0), info.repairs, 0)


def move_window(before, held, limit, memory):
    """Write arrival cost and samples of the window that ends with the sample to come; return its place in it.

    Args:
        before: What the run begins with, or the memory that the sample before left.
        held: Number of samples in the window so far.
        limit: Largest number.
        memory: Written.
    """
    arrivals, samples = parts(memory, NX, NU, NY)
    old_arrivals, old_samples = parts(before.memory, NX, NU, NY)
    first_state = columns(NX, NU, NY)[3]
    if held == 0:
        for i in range(NX):
            put(get(before.mean, i), arrivals, 0, i)
            put(get(before.mean, i), samples, 0, first_state + i)
            for j in range(NX):
                put(get(before.covariance, i, j), arrivals, 0, NX + i * NX + j)
        return 1
    for i in range(arrivals.shape[1]):
        put(get(old_arrivals, 1, i), arrivals, 0, i)
    moved = 1 if held == limit else 0
    for k in range(held + 1 - moved):
        for i in range(samples.shape[1]):
            put(get(old_samples, k + moved, i), samples, k, i)
    return held + 1 - moved


def filter_window(fresh, arrival, samples, constants, work, filtered, covariances, info):
    """Run a Kalman filter over the window, on the equations linearised about the states found.

    Args:
        fresh: Whether the last sample's state is not found yet; it is then predicted, and ``info`` written.
        arrival: Mean and covariance that the window begins with ``(nx + nx nx, LANES)``.
        samples: ``(samples + 1, rows, LANES)``.
        constants: Of the model.
        work: From ``workspace``.
        filtered: Means, written ``(samples + 1, nx, LANES)``.
        covariances: Written ``(samples + 1, nx, nx, LANES)``.
        info: Written at the last sample.
    """
    w, lines, squares, outputs, H, scratch, said = work
    ahead, P, A = lines[0], squares[0], squares[1]
    Y, R, Q, X = columns(NX, NU, NY)
    last = samples.shape[0] - 1
    for i in range(NX):
        put(get(arrival, i), filtered, 0, i)
        for j in range(NX):
            put(get(arrival, NX + i * NX + j), covariances, 0, i, j)
    for k in range(1, last + 1):
        before, u_before = samples[k - 1, X : X + NX], samples[k, :NU]
        next_covariance(before, u_before, constants, covariances[k - 1], ahead, P, w)
        next_jacobian(before, u_before, constants, ahead, A, w)
        for i in range(NX):
            value = get(ahead, i)
            for j in range(NX):
                value = value + get(A, i, j) * (get(filtered, k - 1, j) - get(before, j))
            put(value, lines, 1, i)
            put(get(P, i, i) + get(samples, k, Q + i), P, i, i)
            if fresh and k == last:
                put(value, samples, k, X + i)
        here = samples[k, X : X + NX]
        linear_outputs(here, lines[1], samples[k, NU : 2 * NU], constants, H, outputs)
        written = info if fresh and k == last else said
        y, r = samples[k, Y : Y + NY], samples[k, R : R + NY]
        scalar_updates(lines[1], P, outputs[0], H, SEEN_STATES, y, r, filtered[k], covariances[k], scratch, written)


def linear_outputs(point, x, u, constants, H, outputs):
    """Write the outputs at ``x`` on the equations linearised at ``point``, to row 0, and their slopes."""
    output_jacobian(point, u, constants, outputs[0], H)
    for a in range(NY):
        value = get(outputs, 0, a)
        for c in range(SEEN_STATES.shape[1]):
            j = SEEN_STATES[a, c]
            if j < 0:
                break
            value = value + get(H, a, j) * (get(x, j) - get(point, j))
        put(value, outputs, 0, a)


def smooth_window(samples, constants, work, filtered, covariances):
    """Write the likeliest states of the window, on the equations linearised about the states found so far.

    The arguments are those of ``filter_window``.
    """
    w, lines, squares, outputs, H, _, _ = work
    ahead, state, costate, A = lines[0], lines[1], lines[2], squares[1]
    Y, R, _, X = columns(NX, NU, NY)
    last = samples.shape[0] - 1
    for i in range(NX):
        put(splat(0.0), costate, i)
    for k in range(last, -1, -1):
        for i in range(NX):
            value = get(filtered, k, i)
            for j in range(NX):
                value = value - get(covariances, k, i, j) * get(costate, j)
            put(value, state, i)
        if k > 0:
            here, before = samples[k, X : X + NX], samples[k - 1, X : X + NX]
            linear_outputs(here, state, samples[k, NU : 2 * NU], constants, H, outputs)
            for a in range(NY):
                remainder = (get(samples, k, Y + a) - get(outputs, 0, a)) / get(samples, k, R + a)
                remainder = select(remainder == remainder, remainder, 0.0)
                for j in range(NX):
                    put(get(costate, j) - get(H, a, j) * remainder, costate, j)
            next_jacobian(before, samples[k, :NU], constants, ahead, A, w)
            for i in range(NX):
                value = splat(0.0)
                for j in range(NX):
                    value = value + get(A, j, i) * get(costate, j)
                put(value, ahead, i)
            for i in range(NX):
                put(get(ahead, i), costate, i)
        for i in range(NX):
            put(get(state, i), samples, k, X + i)
