"""Ensemble Kalman filter with perturbed observations (Evensen 1994; Burgers, van Leeuwen and Evensen 1998).

The distribution is an ensemble of states of equal weight. Each member is sent through the model with process noise of
its own; the covariances of states and outputs over the ensemble give the gain, with which each member is corrected by
the measurement plus noise of its own, drawn as the sensor's is and centred over the ensemble. So the ensemble has the
spread that the Kalman filter states, and no member loses its weight. Few members correlate by chance and so state too
small a spread; ``inflation`` widens it before each correction (Anderson and Anderson 1999).

Memory, in rows of lanes, with N members: two words of the random generator, whether there are members yet, then the
members ``(N, nx)``, their outputs ``(N, ny)`` and the noise they are corrected with ``(N, ny)``.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.common.arrays import Floats
from harness.engine.kernel_names import (
    LANES,
    NW,
    NX,
    NY,
    any_of,
    cholesky,
    get,
    log,
    maximum,
    next_state,
    next_words,
    normal_pair,
    output,
    put,
    select,
    splat,
    sqrt,
)
from harness.engine.simd.random import WORDS, generator_words
from harness.estimation.methods._drawing import draw_first, normals
from harness.estimation.methods._input_errors import output_noise, state_noise

HEAD = 3  # rows before the members


class Settings(BaseModel):
    """Number of members, and how much wider they are made than they are."""

    model_config = ConfigDict(extra="forbid")

    members: int = Field(64, ge=2, le=100_000, description="number of members; the cost grows with it")
    inflation: float = Field(
        1.0, ge=1, le=2, description="factor on the distance of members from their mean before each correction"
    )


MONTE_CARLO = True


def tuning(settings: Settings, nx: int, ny: int) -> list[float]:
    """Return the inflation."""
    return [settings.inflation]


def first_memory(settings: Settings, nx: int, ny: int, seeds: Sequence[np.random.SeedSequence]) -> Floats:
    """Return the memory before the first step: the generator's words, and no members yet."""
    memory = np.zeros((HEAD + settings.members * (nx + 2 * ny), LANES))
    memory[:WORDS] = generator_words(seeds)
    return memory


def workspace():
    """Return the scratch arrays of a run."""
    return (
        np.empty((NW, LANES)),
        np.empty((4, NX + 1, LANES)),
        np.zeros((NX, NX, LANES)),
        np.empty((2, NY, LANES)),
        np.zeros((2, NY, NY, LANES)),
        np.empty((NY, NX, LANES)),
    )


def parts(memory):
    """Return members ``(N, nx, LANES)``, their outputs and the noise they are corrected with as views of the memory."""
    count = (memory.shape[0] - HEAD) // (NX + 2 * NY)
    end = HEAD + count * NX
    behind = end + count * NY
    noise = memory[behind:].reshape((count, NY, LANES))
    return memory[HEAD:end].reshape((count, NX, LANES)), memory[end:behind].reshape((count, NY, LANES)), noise


def step(before, u_before, u, y, belief, work, after, info):
    """Send every member through the model, and correct each with the gain of the ensemble."""
    w, rows, factor, sums, products, gain = work
    x, z, deviation, drawn = rows[0], rows[1], rows[2], rows[3]
    source, _, _ = parts(before.memory)
    members, outputs, noise = parts(after.memory)
    count = members.shape[0]
    s0, s1 = get(before.memory, 0), get(before.memory, 1)
    fresh = any_of(get(before.memory, 2) == 0.0)  # the runs of a batch begin together
    repaired = cholesky(before.covariance, factor, NX) if fresh else splat(0.0)
    q = state_noise(belief)
    for i in range(NX):
        put(sqrt(get(q, i)), deviation, i)
    for n in range(count):
        if fresh:
            s0, s1 = draw_first(before.mean, factor, drawn, x, s0, s1)
        else:
            for i in range(NX):
                put(get(source, n, i), x, i)
        next_state(x, u_before, belief.constants, members[n], w)
        s0, s1 = normals(z, n % 2 == 1, s0, s1)
        for i in range(NX):
            put(get(members, n, i) + get(deviation, i) * get(z, i), members, n, i)
    average(members, after.mean)
    if belief.tuning[0] > 1.0:
        widen(members, after.mean, belief.tuning[0])
    for n in range(count):
        output(members[n], u, belief.constants, outputs[n])
    r = output_noise(belief)
    s0, s1 = draw_measurement_noise(r, noise, s0, s1)
    average(outputs, sums[0])
    covariances(members, after.mean, outputs, sums[0], r, gain, info)
    failed = describe_ensemble(y, sums, products, info)
    apply_gain(y, members, outputs, noise, products[1], gain)
    average(members, after.mean)
    put(s0, after.memory, 0)
    put(s1, after.memory, 1)
    put(splat(1.0), after.memory, 2)
    put(maximum(repaired, failed), info.repairs, 0)


def average(rows, mean):
    """Write the mean of the rows ``(N, n, LANES)`` to ``mean``."""
    share = 1.0 / rows.shape[0]
    for i in range(rows.shape[1]):
        total = splat(0.0)
        for n in range(rows.shape[0]):
            total = total + get(rows, n, i)
        put(total * share, mean, i)


def widen(members, mean, factor):
    """Move members away from their mean."""
    for n in range(members.shape[0]):
        for i in range(NX):
            put(get(mean, i) + factor * (get(members, n, i) - get(mean, i)), members, n, i)


def draw_measurement_noise(r, noise, s0, s1):
    """Write noise of the sensors' variances for every member, less its mean over the ensemble."""
    count = noise.shape[0]
    for a in range(NY):
        deviation, total = sqrt(get(r, a)), splat(0.0)
        for n in range(0, count, 2):
            word, s0, s1 = next_words(s0, s1)
            first, second = normal_pair(word)
            put(deviation * first, noise, n, a)
            total = total + deviation * first
            if n + 1 < count:
                put(deviation * second, noise, n + 1, a)
                total = total + deviation * second
        for n in range(count):
            put(get(noise, n, a) - total * (1.0 / count), noise, n, a)
    return s0, s1


def covariances(members, mean, outputs, centre, r, cross, info):
    """Write the covariance of outputs and states ``(ny, nx, LANES)``, and that of the innovation."""
    count = members.shape[0]
    share = 1.0 / (count - 1)
    for a in range(NY):
        for i in range(NX):
            total = splat(0.0)
            for n in range(count):
                total = total + (get(outputs, n, a) - get(centre, a)) * (get(members, n, i) - get(mean, i))
            put(total * share, cross, a, i)
        for b in range(a + 1):
            total = splat(0.0)
            for n in range(count):
                total = total + (get(outputs, n, a) - get(centre, a)) * (get(outputs, n, b) - get(centre, b))
            value = total * share + get(r, a) if a == b else total * share
            put(value, info.innovation_covariance, a, b)
            put(value, info.innovation_covariance, b, a)


def describe_ensemble(y, sums, products, info):
    """Write innovation, NIS and likelihood; factor the innovation covariance with missing measurements apart."""
    seen, likelihood, nis = splat(0.0), splat(0.0), splat(0.0)
    for a in range(NY):
        measured = get(y, a) == get(y, a)
        put(get(y, a) - get(sums, 0, a), info.innovation, a)
        seen = seen + select(measured, 1.0, 0.0)
        for b in range(a + 1):
            value = select(
                measured & (get(y, b) == get(y, b)), get(info.innovation_covariance, a, b), 1.0 if a == b else 0.0
            )
            put(value, products, 0, a, b)
            put(value, products, 0, b, a)
    failed = cholesky(products[0], products[1], NY)
    for a in range(NY):
        measured = get(y, a) == get(y, a)
        rest = select(measured, get(info.innovation, a), 0.0)
        for b in range(a):
            rest = rest - get(products, 1, a, b) * get(sums, 1, b)
        rest = rest / get(products, 1, a, a)
        put(rest, sums, 1, a)
        nis = nis + rest * rest
        part = 0.5 * (rest * rest + 1.8378770664093453) + log(get(products, 1, a, a))
        likelihood = likelihood - select(measured, part, 0.0)
    put(nis, info.nis, 0)
    put(likelihood, info.log_likelihood, 0)
    put(seen, info.seen, 0)
    return failed


def apply_gain(y, members, outputs, noise, factor, cross):
    """Turn the covariances into the gain by the factor of the innovation covariance, and correct every member."""
    for i in range(NX):
        for a in range(NY):  # forward, then backward substitution: a column of the gain per state
            value = select(get(y, a) == get(y, a), get(cross, a, i), 0.0)
            for b in range(a):
                value = value - get(factor, a, b) * get(cross, b, i)
            put(value / get(factor, a, a), cross, a, i)
        for a in range(NY - 1, -1, -1):
            value = get(cross, a, i)
            for b in range(a + 1, NY):
                value = value - get(factor, b, a) * get(cross, b, i)
            put(value / get(factor, a, a), cross, a, i)
    for n in range(members.shape[0]):
        for a in range(NY):
            rest = get(y, a) + get(noise, n, a) - get(outputs, n, a)
            rest = select(get(y, a) == get(y, a), rest, 0.0)
            for i in range(NX):
                put(get(members, n, i) + get(cross, a, i) * rest, members, n, i)


def write_covariance(state, work):
    """Write the covariance of the members."""
    members = parts(state.memory)[0]
    share = 1.0 / (members.shape[0] - 1)
    for i in range(NX):
        for j in range(i + 1):
            total = splat(0.0)
            for n in range(members.shape[0]):
                total = total + (get(members, n, i) - get(state.mean, i)) * (get(members, n, j) - get(state.mean, j))
            put(total * share, state.covariance, i, j)
            put(total * share, state.covariance, j, i)
