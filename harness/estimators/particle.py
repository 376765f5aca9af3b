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
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field

from harness.kernel import (
    LANES,
    NW,
    NX,
    NY,
    any_of,
    cholesky,
    exp,
    get,
    log,
    mahalanobis,
    maximum,
    minimum,
    next_state,
    next_words,
    normal_pair,
    output,
    put,
    select,
    splat,
    sqrt,
    uniform,
)
from harness.lane_random import WORDS, generator_words

SCHEMES = ("systematic", "stratified", "multinomial", "residual")
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


HAS_COVARIANCE = True
KALMAN_TYPE = False
MONTE_CARLO = True


def tuning(settings: Settings, nx: int, ny: int) -> list[float]:
    """Return the scheme's number, the threshold and the roughening per unit of range, ``K N^(-1/nx)``."""
    jitter = settings.roughening * settings.particles ** (-1.0 / nx)
    return [float(SCHEMES.index(settings.resampling)), settings.threshold, jitter]


def first_memory(settings: Settings, nx: int, ny: int, seeds: Sequence[np.random.SeedSequence]) -> NDArray[np.float64]:
    """Return the memory before the first step: the generator's words, and no particles yet."""
    memory = np.zeros((HEAD + settings.particles * (nx + 2), LANES))
    memory[:WORDS] = generator_words(seeds)
    return memory


def workspace():
    """Return the scratch arrays of a run."""
    return (
        np.empty((NW, LANES)),
        np.empty((6, NX + 1, LANES)),
        np.zeros((NX, NX, LANES)),
        np.empty((17, NX + 2 - NX % 2, LANES)),
        np.empty((NX + 2 - NX % 2, NX + 2 - NX % 2, LANES)),
        np.empty((6, NY, LANES)),
        np.zeros((2, NY, NY, LANES)),
        np.empty((2, LANES)),
    )


def parts(memory):
    """Return particles ``(N, nx, LANES)``, log-weights and weights ``(N, LANES)`` as views of the memory."""
    count = (memory.shape[0] - 5) // (NX + 2)
    end = 5 + count * NX
    return memory[5:end].reshape((count, NX, LANES)), memory[end : end + count], memory[end + count :]


def ordered_points(scheme, points, s0, s1):
    """Write N increasing points in (0, 1) at which the cumulated weights are read off, by scheme.

    Systematic: one random offset for all of ``(k + u) / N``; stratified: an offset for each; multinomial: the order
    statistics of N uniform numbers, from exponential gaps, which is the exhaustive search without its N^2.
    """
    count = points.shape[0]
    word, s0, s1 = next_words(s0, s1)
    u = uniform(word)
    total = splat(0.0)
    for k in range(count):
        if scheme <= 1:
            put((k + u) * (1.0 / count), points, k)
        else:
            total = total - log(u)
            put(total, points, k)
        if scheme > 0:
            word, s0, s1 = next_words(s0, s1)
            u = uniform(word)
    if scheme > 1:
        inverse = 1.0 / (total - log(u))
        for k in range(count):
            put(get(points, k) * inverse, points, k)
    return s0, s1


def find_ancestors(weights, points, ancestors, lane, total, residual):
    """Write from which particle each redrawn one of a lane descends.

    With ``residual`` every particle first has ``floor(N w)`` children, and the points share out the rest.
    """
    count = weights.shape[0]
    share = count / total
    given, stretch = 0, 1.0 * count
    if residual:
        for n in range(count):
            for _ in range(int(share * weights[n, lane])):
                if given < count:
                    ancestors[given, lane] = n
                    given += 1
        # the first m of N ordered uniform numbers, over the next one, are m ordered uniform numbers
        if 0 < given < count:
            stretch = (count - given) / points[count - given, lane]
    n, cumulated = -1, 0.0
    for k in range(count - given):
        at = points[k, lane] * stretch
        while cumulated < at and n < count - 1:
            n += 1
            expected = share * weights[n, lane]
            cumulated += expected - int(expected) if residual else expected
        ancestors[given + k, lane] = n


def redraw(scheme, redrawn, weights, total, points, ancestors, s0, s1):
    """Choose the ancestors of all particles, each its own in lanes that are not redrawn.

    Args:
        scheme: 0 systematic, 1 stratified, 2 multinomial, 3 residual.
        redrawn: 1 for lanes to redraw, else 0 ``(1, LANES)``.
        weights: ``(N, LANES)``.
        total: Sum of the weights ``(1, LANES)``.
        points: Scratch ``(N, LANES)``.
        ancestors: Numbers of the particles, written ``(N, LANES)``.
        s0: First word of the generator.
        s1: Second word.

    Returns:
        The words of the generator; they do not move on in lanes that are not redrawn.
    """
    t0, t1 = ordered_points(scheme, points, s0, s1)
    for lane in range(LANES):
        if redrawn[0, lane] > 0.0:
            find_ancestors(weights, points, ancestors, lane, total[0, lane], scheme == 3)
        else:
            for n in range(weights.shape[0]):
                ancestors[n, lane] = n
    chosen = get(redrawn, 0) > 0.0
    return select(chosen, t0, s0), select(chosen, t1, s1)


def find_jitter(cloud, redrawn, share, jitter):
    """Write the standard deviation of the roughening: a share of the range that each state has in the cloud."""
    for i in range(NX):
        low, high = get(cloud, 0, i), get(cloud, 0, i)
        for n in range(1, cloud.shape[0]):
            value = get(cloud, n, i)
            low, high = minimum(low, value), maximum(high, value)
        put(get(redrawn, 0) * share * (high - low), jitter, i)


def normals(z, spare, s0, s1):
    """Write independent standard normal numbers, one for each state.

    They come in pairs. With an odd number of states every other call finds one left over, in the last row of ``z``.

    Args:
        z: Written, ``nx`` rows; ``(nx + 1, LANES)``.
        spare: Whether there is one left over by the call before.
        s0: First word of the generator.
        s1: Second word.
    """
    begin = 0
    if NX % 2 == 1 and spare:
        put(get(z, NX), z, 0)
        begin = 1
    for i in range(begin, NX, 2):
        word, s0, s1 = next_words(s0, s1)
        first, second = normal_pair(word)
        put(first, z, i)
        put(second, z, i + 1)
    return s0, s1


def moments(cloud, log_weights, weights, best, leader, mean, covariance, block, sums):
    """Write weights, mean and covariance of the particles; return the sums of the weights and of their squares.

    One pass: the sums of ``w``, ``w d`` and ``w d d'`` are those of the products of ``sqrt(w) (d, 1)`` with itself.
    The differences ``d`` are from the particle of the largest weight, so that no digits are lost.

    Args:
        cloud: Particles ``(N, nx, LANES)``.
        log_weights: ``(N, LANES)``.
        weights: Written ``(N, LANES)``.
        best: The largest log-weight.
        leader: The particle that has it ``(1, LANES)``.
        mean: Written ``(nx, LANES)``.
        covariance: Written ``(nx, nx, LANES)``.
        block: Scratch ``(17, even, LANES)``, where ``even`` is the even number above ``nx``.
        sums: Scratch ``(even, even, LANES)``.
    """
    count, even = cloud.shape[0], block.shape[1]
    centre = block[16]
    for i in range(even):
        for lane in range(LANES):
            centre[i, lane] = cloud[int(leader[0, lane]), i, lane] if i < NX else 0.0
        for s in range(16):
            put(0.0, block, s, i)
        for j in range(even):
            put(0.0, sums, i, j)
    squares = splat(0.0)
    for begin in range(0, count, 16):
        size = min(16, count - begin)
        for s in range(size):
            root = exp(0.5 * (get(log_weights, begin + s) - best))
            weight = root * root
            put(weight, weights, begin + s)
            squares = squares + weight * weight
            for i in range(NX):
                put(root * (get(cloud, begin + s, i) - get(centre, i)), block, s, i)
            put(root, block, s, NX)
        # two rows by two columns at a time: four products for four numbers fetched
        for i in range(0, even, 2):
            for j in range(0, i + 1, 2):
                a, b = get(sums, i, j), get(sums, i, j + 1)
                c, d = get(sums, i + 1, j), get(sums, i + 1, j + 1)
                for s in range(size):
                    above, below = get(block, s, i), get(block, s, i + 1)
                    left, right = get(block, s, j), get(block, s, j + 1)
                    a, b = a + above * left, b + above * right
                    c, d = c + below * left, d + below * right
                put(a, sums, i, j)
                put(b, sums, i, j + 1)
                put(c, sums, i + 1, j)
                put(d, sums, i + 1, j + 1)
    total = get(sums, NX, NX)
    inverse = 1.0 / total
    for i in range(NX):
        shift = get(sums, NX, i) * inverse
        put(get(centre, i) + shift, mean, i)
        for j in range(i + 1):
            value = (get(sums, i, j) - shift * get(sums, NX, j)) * inverse
            put(value, covariance, i, j)
            put(value, covariance, j, i)
    return total, squares


def finite(values):
    """Return the mask of lanes in which every entry is a finite number."""
    total = splat(0.0)
    for i in range(values.shape[0]):
        total = total + 0.0 * get(values, i)
    return total == 0.0


def drop_broken(cloud, log_weights, leader):
    """Take away the weight of particles that are not finite; return the largest log-weight left, and its particle."""
    best = splat(-np.inf)
    put(0.0, leader, 0)
    for n in range(cloud.shape[0]):
        good = finite(cloud[n])
        for i in range(NX):
            put(select(good, get(cloud, n, i), 0.0), cloud, n, i)
        value = get(log_weights, n)
        value = select(good & (value == value), value, -np.inf)
        put(value, log_weights, n)
        put(select(value > best, 1.0 * n, get(leader, 0)), leader, 0)
        best = maximum(best, value)
    return best


def describe(y, r, reference, first, second, total, innovation, scratch, factor, info):
    """Write innovation, its covariance and the NIS from the particles' predicted measurements.

    Args:
        y: Measurements.
        r: Their variances.
        reference: Outputs of the first particle, about which the sums were taken ``(ny, LANES)``.
        first: Weighted sum of the outputs less the reference ``(ny, LANES)``.
        second: The same of their products ``(ny, ny, LANES)``; overwritten.
        total: Sum of the weights before the measurement.
        innovation: Scratch ``(ny, LANES)``.
        scratch: Scratch ``(ny, LANES)``.
        factor: Scratch ``(ny, ny, LANES)``.
        info: Written but for likelihood and repairs.

    Returns:
        Lanes whose innovation covariance had to be repaired (1 or 0).
    """
    inverse = 1.0 / total
    seen = splat(0.0)
    for a in range(NY):
        seen_a = get(y, a) == get(y, a)
        rest = get(y, a) - get(reference, a) - get(first, a) * inverse
        put(rest, info.innovation, a)
        put(select(seen_a, rest, 0.0), innovation, a)
        seen = seen + select(seen_a, 1.0, 0.0)
        for b in range(a + 1):
            value = get(second, a, b) * inverse - get(first, a) * inverse * (get(first, b) * inverse)
            if a == b:
                value = value + get(r, a)
            put(value, info.innovation_covariance, a, b)
            put(value, info.innovation_covariance, b, a)
            # a missing measurement gets a unit variance of its own and an innovation of zero
            value = select(seen_a & (get(y, b) == get(y, b)), value, 1.0 if a == b else 0.0)
            put(value, second, a, b)
            put(value, second, b, a)
    repaired = cholesky(second, factor, NY)
    put(mahalanobis(factor, innovation, scratch, NY), info.nis, 0)
    put(seen, info.seen, 0)
    return repaired


def prepare(y, r, outputs, second):
    """Write measurements and half precisions, zero where missing, and zero sums; return the likelihood's constant."""
    constant = splat(0.0)
    for a in range(NY):
        seen = get(y, a) == get(y, a)
        variance = get(r, a)
        put(0.0, outputs, 2, a)
        put(select(seen, get(y, a), 0.0), outputs, 3, a)
        put(select(seen, 0.5 / variance, 0.0), outputs, 4, a)
        constant = constant - select(seen, 0.5 * (log(variance) + 1.8378770664093453), 0.0)
        for b in range(NY):
            put(0.0, second, a, b)
    return constant


def draw_first(mean, factor, drawn, x, s0, s1):
    """Draw one particle from the normal distribution that the run begins with."""
    s0, s1 = normals(drawn, False, s0, s1)
    for i in range(NX):
        value = get(mean, i)
        for k in range(i + 1):
            value = value + get(factor, i, k) * get(drawn, k)
        put(value, x, i)
    return s0, s1


def take_ancestors(source, ancestors, n, x):
    """Write the ancestor of particle ``n`` in each lane."""
    for lane in range(LANES):
        ancestor = int(ancestors[n, lane])
        for i in range(NX):
            x[i, lane] = source[ancestor, i, lane]


def roughen(jitter, redrawn, drawn, x, s0, s1):
    """Add jitter to a particle; lanes that are not redrawn draw nothing."""
    t0, t1 = normals(drawn, False, s0, s1)
    for i in range(NX):
        put(get(x, i) + get(jitter, i) * get(drawn, i), x, i)
    chosen = get(redrawn, 0) > 0.0
    return select(chosen, t0, s0), select(chosen, t1, s1)


def step(before, u_before, u, y, belief, work, after, info):
    """Redraw where needed, propagate, weigh by the measurement (2.58 to 2.62) and sum up."""
    w, rows, factor, block, sums, outputs, products, marks = work
    x, z, deviation, jitter, drawn, ahead = rows[0], rows[1], rows[2], rows[3], rows[4], rows[5]
    redrawn, leader = marks[0:1], marks[1:2]
    predicted, reference, first, measured, half = outputs[0], outputs[1], outputs[2], outputs[3], outputs[4]
    second = products[0]
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
    rough = moved and belief.tuning[2] > 0.0
    if fresh:
        repaired = cholesky(before.covariance, factor, NX)
        put(1.0, redrawn, 0)
    elif moved:
        scheme = int(belief.tuning[0])
        s0, s1 = redraw(scheme, redrawn, weights_before, before.memory[2:3], log_weights, weights, s0, s1)
        if rough:
            find_jitter(source, redrawn, belief.tuning[2], jitter)
    equal = get(redrawn, 0) > 0.0
    total = select(equal, 1.0 * count, total)
    even = -np.log(1.0 * count)
    constant = prepare(y, belief.measurement_noise, outputs, second)
    for i in range(NX):
        put(sqrt(get(belief.process_noise, i)), deviation, i)
    best = splat(-np.inf)
    put(0.0, leader, 0)
    for n in range(count):
        if fresh:
            s0, s1 = draw_first(first_mean, factor, drawn, x, s0, s1)
        elif moved:
            take_ancestors(source, weights, n, x)
            if rough:
                s0, s1 = roughen(jitter, redrawn, drawn, x, s0, s1)
        else:
            for i in range(NX):
                put(get(source, n, i), x, i)
        next_state(x, u_before, constants, ahead, w)
        s0, s1 = normals(z, n % 2 == 1, s0, s1)
        for i in range(NX):
            value = get(ahead, i) + get(deviation, i) * get(z, i)
            put(value, ahead, i)
            put(value, cloud, n, i)
        output(ahead, u, constants, predicted)
        value = select(equal, even, get(log_before, n) - offset)
        weight = select(equal, 1.0, get(weights_before, n))
        for a in range(NY):
            if n == 0:
                put(get(predicted, a), reference, a)
            rest = get(measured, a) - get(predicted, a)
            value = value - rest * rest * get(half, a)
            away = get(predicted, a) - get(reference, a)
            put(get(first, a) + weight * away, first, a)
            for b in range(a + 1):
                other = get(predicted, b) - get(reference, b)
                put(get(second, a, b) + weight * away * other, second, a, b)
        put(value, log_weights, n)
        put(select(value > best, 1.0 * n, get(leader, 0)), leader, 0)
        best = maximum(best, value)
    repaired = repaired + describe(
        y, belief.measurement_noise, reference, first, second, total, outputs[5], predicted, products[1], info
    )
    total, squares = moments(cloud, log_weights, weights, best, leader, after.mean, after.covariance, block, sums)
    if any_of(alive & ~finite(after.mean)):
        best = drop_broken(cloud, log_weights, leader)
        total, squares = moments(cloud, log_weights, weights, best, leader, after.mean, after.covariance, block, sums)
    offset = best + log(total)
    put(s0, after.memory, 0)
    put(s1, after.memory, 1)
    put(total, after.memory, 2)
    put(squares, after.memory, 3)
    put(offset, after.memory, 4)
    put(select(get(info.seen, 0) > 0.0, offset + constant, 0.0), info.log_likelihood, 0)
    put(repaired, info.repairs, 0)
