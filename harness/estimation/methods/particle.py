"""Bootstrap particle filter (Gordon, Salmond and Smith 1993; Sun 2015, 2.46 to 2.62; Lex 2015, 5.9).

A run is a lane, the particles are a loop. They are propagated through the model with process noise drawn for each,
and weighted by the likelihood of the measurement; weights are logarithms, so that none is lost by underflow. Where
the effective sample size has fallen below a share of the particles, a lane draws new ones before it goes on; a lane
that has not keeps its own. Because that is done at the beginning of a step, the estimate is the mean of the
weighted particles, which scatters less than that of the redrawn ones (5.9 in Lex).

Memory, in rows of lanes, with N particles: two words of the random generator, the sum of the weights (0 before the
first step), the sum of their squares, the logarithm by which log-weights are too large, then the particles
``(N, nx)``, their log-weights ``(N)`` and their weights ``(N)``, the largest of which is 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Literal

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
    gather,
    get,
    log,
    maximum,
    minimum,
    next_state,
    output,
    put,
    select,
    splat,
    sqrt,
)
from harness.engine.simd.random import WORDS, generator_words
from harness.estimation.methods._drawing import draw_first, normals
from harness.estimation.methods._input_errors import output_noise, state_noise
from harness.estimation.methods._resampling import SCHEMES, redraw
from harness.estimation.methods._weighing import (
    describe,
    drop_broken,
    finite,
    measure,
    sum_up,
    weigh,
)

HEAD = 5  # rows before the particles


class Settings(BaseModel):
    """Number of particles and how they are redrawn."""

    model_config = ConfigDict(extra="forbid")

    particles: int = Field(128, ge=2, le=1_000_000, description="number of particles; the cost grows with it")
    resampling: Literal["systematic", "stratified", "multinomial", "residual"] = Field(
        "systematic", description="how particles are redrawn; multinomial is the exhaustive search of Simon and Lex"
    )
    threshold: float = Field(
        0.5, ge=0, le=1, description="particles are redrawn below this effective sample size over their number"
    )
    roughening: float = Field(
        0.0, ge=0, le=10, description="jitter of redrawn particles over their range (Gordon et al. 1993: 0.2); 0: none"
    )


MONTE_CARLO = True


def tuning(settings: Settings, nx: int, ny: int) -> list[float]:
    """Return the scheme's number, the threshold and the roughening per unit of range, ``K N^(-1/nx)``."""
    jitter = settings.roughening * settings.particles ** (-1.0 / nx)
    return [float(SCHEMES.index(settings.resampling)), settings.threshold, jitter]


def first_memory(settings: Settings, nx: int, ny: int, seeds: Sequence[np.random.SeedSequence]) -> Floats:
    """Return the memory before the first step: the generator's words, and no particles yet."""
    memory = np.zeros((HEAD + settings.particles * (nx + 2), LANES))
    memory[:WORDS] = generator_words(seeds)
    return memory


def workspace():
    """Return the scratch arrays of a run."""
    return (
        np.empty((NW, LANES)),
        np.empty((4, NX + 1, LANES)),
        np.zeros((NX, NX, LANES)),
        np.empty((5, NY, LANES)),
        np.zeros((2, NY, NY, LANES)),
        np.empty((1, LANES)),
    )


def parts(memory):
    """Return particles ``(N, nx, LANES)``, log-weights and weights ``(N, LANES)`` as views of the memory."""
    count = (memory.shape[0] - 5) // (NX + 2)
    end = 5 + count * NX
    return memory[5:end].reshape((count, NX, LANES)), memory[end : end + count], memory[end + count :]


def take(source, ancestors, n, x):
    """Write the ancestor of particle ``n``, each lane its own."""
    rows = get(ancestors, n)
    for i in range(NX):
        put(gather(source, rows, i), x, i)


def spread_noise(process_noise, cloud, redrawn, share, deviation):
    """Write the standard deviation of what a particle is moved by besides the model: process noise and roughening.

    Roughening is a share of the range that each state has in the cloud, in redrawn lanes; zero asks for none. Both
    are normal and independent, so one number is drawn for the two.
    """
    for i in range(NX):
        variance = get(process_noise, i)
        if share > 0.0:
            low, high = get(cloud, 0, i), get(cloud, 0, i)
            for n in range(1, cloud.shape[0]):
                value = get(cloud, n, i)
                low, high = minimum(low, value), maximum(high, value)
            jitter = get(redrawn, 0) * share * (high - low)
            variance = variance + jitter * jitter
        put(sqrt(variance), deviation, i)


def step(before, u_before, u, y, belief, work, after, info):
    """Redraw where needed, propagate, weigh by the measurement (2.58 to 2.62) and sum up."""
    w, rows, factor, outputs, products, redrawn = work
    x, z, deviation, drawn = rows[0], rows[1], rows[2], rows[3]
    constants, first_mean = belief.constants, before.mean
    source, log_before, weights_before = parts(before.memory)
    cloud, log_weights, weights = parts(after.memory)
    count = cloud.shape[0]
    s0, s1 = get(before.memory, 0), get(before.memory, 1)
    total, squares, offset = get(before.memory, 2), get(before.memory, 3), get(before.memory, 4)
    alive = total == total
    fresh = any_of(total == 0.0)  # the runs of a batch begin together
    repaired = splat(0.0)
    put(select(total * total < belief.tuning[1] * count * squares, 1.0, 0.0), redrawn, 0)
    moved = any_of(get(redrawn, 0) > 0.0)
    if fresh:
        repaired = cholesky(before.covariance, factor, NX)
        put(1.0, redrawn, 0)
    elif moved:
        scheme = int(belief.tuning[0])
        s0, s1 = redraw(scheme, redrawn, weights_before, before.memory[2:3], log_weights, weights, s0, s1)
    share = belief.tuning[2] if moved and not fresh else 0.0
    spread_noise(state_noise(belief), source, redrawn, share, deviation)
    equal = get(redrawn, 0) > 0.0
    total = select(equal, 1.0 * count, total)
    even = -np.log(1.0 * count)
    noise = output_noise(belief)
    constant = measure(y, noise, outputs, products[0])
    best = splat(-np.inf)
    for n in range(count):
        if fresh:
            s0, s1 = draw_first(first_mean, factor, drawn, x, s0, s1)
        elif moved:
            take(source, weights, n, x)
        next_state(x if fresh or moved else source[n], u_before, constants, cloud[n], w)
        s0, s1 = normals(z, n % 2 == 1, s0, s1)
        for i in range(NX):
            put(get(cloud, n, i) + get(deviation, i) * get(z, i), cloud, n, i)
        output(cloud[n], u, constants, outputs[0])
        value = select(equal, even, get(log_before, n) - offset)
        value = weigh(n == 0, value, select(equal, 1.0, get(weights_before, n)), outputs, products[0])
        put(value, log_weights, n)
        best = maximum(best, value)
    failed = describe(y, noise, total, outputs, products[0], products[1], info)
    total, squares = sum_up(cloud, log_weights, weights, best, after.mean)
    if any_of(alive & ~finite(after.mean)):
        best = drop_broken(cloud, log_weights)
        total, squares = sum_up(cloud, log_weights, weights, best, after.mean)
    offset = best + log(total)
    put(s0, after.memory, 0)
    put(s1, after.memory, 1)
    put(total, after.memory, 2)
    put(squares, after.memory, 3)
    put(offset, after.memory, 4)
    put(select(get(info.seen, 0) > 0.0, offset + constant, 0.0), info.log_likelihood, 0)
    put(maximum(repaired, failed), info.repairs, 0)


def write_covariance(state, work):
    """Write the covariance of the weighted particles."""
    cloud, _, weights = parts(state.memory)
    away = work[1][0]
    for i in range(NX):
        for j in range(NX):
            put(0.0, state.covariance, i, j)
    for n in range(cloud.shape[0]):
        for i in range(NX):
            put(get(cloud, n, i) - get(state.mean, i), away, i)
        weight = get(weights, n)
        for i in range(NX):
            weighted = weight * get(away, i)
            for j in range(i + 1):
                put(get(state.covariance, i, j) + weighted * get(away, j), state.covariance, i, j)
    inverse = 1.0 / get(state.memory, 2)
    for i in range(NX):
        for j in range(i + 1):
            value = get(state.covariance, i, j) * inverse
            put(value, state.covariance, i, j)
            put(value, state.covariance, j, i)
