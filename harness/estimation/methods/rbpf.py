"""Rao-Blackwellised particle filter: particles of the unknown parameters, each with an extended Kalman filter.

Given the parameters, the states are nearly normal, and the EKF has their distribution; a particle need only stand for
the parameters (Doucet, de Freitas, Murphy and Russell 2000; Schön, Gustafsson and Nordlund 2005). A step runs the EKF
of every particle and weighs the particle by the likelihood of its innovation. Where the effective sample size has
fallen below a share of the particles, a lane redraws them.

Points of a constant could not move any more once they were drawn, and between two of them would be nothing. So a
particle keeps a share of the parameters' spread to itself, the kernel, which its EKF estimates within. A normal
distribution is split exactly: ``N(m, P)`` is the mixture of ``N(m + d, P - D)`` over ``d`` from ``N(0, D)``, with ``D``
the share of ``P`` that goes with the parameters. That is how particles begin, and how one that is redrawn several times
becomes different ones (kernels in place of points: Liu and West 2001; filters in place of points: Kotecha and Djuric
2003). A walk widens the kernels.

With ``weighed = false`` nothing is learnt: the particles are points and keep the weights of the prior. That is the
consider filter (Schmidt 1966) without its linearisation in the parameters.

Memory, in rows of lanes, with N particles: two words of the random generator, whether there are particles yet, their
weights ``(N)``, means ``(N, nx)`` and covariances ``(N, nx, nx)``. Before the first step the means hold what the first
parameters are drawn by.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from pydantic import BaseModel, ConfigDict, Field
from scipy.special import ndtri

from harness.common.arrays import Floats
from harness.engine.kernel_names import (
    LANES,
    NX,
    NY,
    State,
    any_of,
    cholesky,
    exp,
    gather,
    get,
    log,
    maximum,
    next_words,
    normal_pair,
    put,
    select,
    splat,
    sqrt,
)
from harness.engine.simd.random import WORDS, generator_words
from harness.estimation.methods._input_errors import correct
from harness.estimation.methods._linearised import linear_workspace, predict, spare_info
from harness.estimation.methods._mixture import conclude, moments, normalise, tell
from harness.estimation.methods._resampling import SCHEMES, redraw
from harness.estimation.methods._weighing import finite

HEAD = 3  # rows before the weights
SYSTEMATIC = SCHEMES.index("systematic")


class Settings(BaseModel):
    """Number of particles, and how they are redrawn."""

    model_config = ConfigDict(extra="forbid")

    particles: int = Field(32, ge=2, le=1000, description="number of particles; the cost grows with it")
    threshold: float = Field(
        0.5, ge=0, le=1, description="redraw where the effective sample size is below this share of the particles"
    )
    kernel: float = Field(
        0.3, ge=0, lt=1, description="share of a parameter's standard deviation that a particle keeps to itself"
    )
    weighed: bool = Field(
        True, description="whether measurements weigh the particles; if not, parameters are considered, not estimated"
    )


MONTE_CARLO = True


def tuning(settings: Settings, nx: int, ny: int) -> list[float]:
    """Return threshold and kernel (0 where nothing is weighed), and whether particles are weighed."""
    return [settings.threshold * settings.weighed, settings.kernel * settings.weighed, float(settings.weighed)]


def first_memory(settings: Settings, nx: int, ny: int, seeds: Sequence[np.random.SeedSequence]) -> Floats:
    """Return the memory before the first step: the generator's words, and by what the first parameters are drawn.

    Of each parameter one standard normal number from every part of the prior that is as likely as the others, in random
    order (McKay, Beckman and Conover 1979): so few particles are spread over the prior as they should be.
    """
    count = settings.particles
    memory = np.zeros((HEAD + count * (1 + nx + nx * nx), LANES))
    memory[:WORDS] = generator_words(seeds)
    drawn = parts(memory, nx)[1]
    for lane, seed in enumerate(seeds):
        rng = np.random.default_rng(seed)
        order = rng.permuted(np.tile(np.arange(count), (nx, 1)), axis=1).T
        drawn[:, :, lane] = ndtri((order + rng.uniform(size=(count, nx))) / count)
    return memory


def workspace():
    """Return the scratch arrays of a run."""
    return (
        linear_workspace(),
        spare_info(),
        State(np.zeros((NX, LANES)), np.zeros((NX, NX, LANES)), np.zeros((1, LANES))),
        np.zeros((2, NY, NY, LANES)),
        np.zeros((2, NY, LANES)),
        np.zeros((3, NX, NX, LANES)),
        np.zeros((2, LANES)),
    )


def parts(memory, nx):
    """Return weights ``(N, lanes)``, means ``(N, nx, lanes)`` and covariances ``(N, nx nx, lanes)`` as views."""
    lanes = memory.shape[1]
    count = (memory.shape[0] - HEAD) // (1 + nx + nx * nx)
    end = HEAD + count
    behind = end + count * nx
    covariances = memory[behind:].reshape((count, nx * nx, lanes))
    return memory[HEAD:end], memory[end:behind].reshape((count, nx, lanes)), covariances


def step(before, u_before, u, y, belief, work, after, info):
    """Redraw where needed, run the filter of every particle, weigh the particles and sum them up."""
    linear, said, start, factor, rows, squares, flags = work
    _, x_prior, P_prior, predicted, H, scratch = linear
    weights, means, covariances = parts(before.memory, NX)
    new_weights, new_means, new_covariances = parts(after.memory, NX)
    count, n = weights.shape[0], NX - belief.priors.shape[0]
    fresh = any_of(get(before.memory, 2) == 0.0)  # the runs of a batch begin together
    moved, s0, s1 = choose(fresh, before.memory, belief.tuning[0], new_weights, new_means[0], flags)
    for j in range(count):
        if fresh:
            begin(before, start)
            split(means[j], n, belief.tuning[1], before.covariance, flags, squares, start)
        else:
            take(means, covariances, get(new_weights, j), j, moved, start)
        if moved:
            s0, s1 = draw(NX - n, squares[2, 0], get(flags, 0) > 0.0, s0, s1)
            split(squares[2, 0], n, belief.tuning[1], before.covariance, flags, squares, start)
        chance = select(get(flags, 0) > 0.0, 1.0 / count, get(weights, j))
        predict(start, u_before, u, belief, linear)
        here = State(new_means[j], new_covariances[j].reshape((NX, NX, LANES)), after.memory)
        correct(x_prior, P_prior, predicted, H, y, belief, here, scratch, said)
        tell(j == 0, chance, predicted, said, rows, info)
        likelihood = get(said.log_likelihood, 0)
        sound = finite(here.mean) & (likelihood == likelihood)
        put(select(sound, log(chance) + likelihood, -np.inf), new_weights, j)
    log_likelihood = weigh_particles(weights, flags, belief.tuning[2] > 0.5, new_weights)
    conclude(y, log_likelihood, rows, factor, info)
    mixed = new_covariances.reshape((count, NX, NX, LANES))
    moments(new_weights, new_means, mixed, NX, after.mean, after.covariance)
    put(s0, after.memory, 0)
    put(s1, after.memory, 1)
    put(splat(1.0), after.memory, 2)
    put(splat(0.0), info.repairs, 0)


def choose(fresh, memory, threshold, ancestors, scratch, flags):
    """Say which lanes begin with even weights, and write the ancestor of every particle.

    Args:
        fresh: Whether there are no particles yet.
        memory: Before the step.
        threshold: Share of the particles below which the effective sample size asks for others.
        ancestors: Written ``(N, LANES)`` where a lane is redrawn.
        scratch: ``(>= 1, LANES)``.
        flags: Written: 0, whether the weights of a lane are even; 1, the sum of its weights.

    Returns:
        Whether any lane is redrawn, and the words of the generator.
    """
    weights = parts(memory, NX)[0]
    count = weights.shape[0]
    s0, s1 = get(memory, 0), get(memory, 1)
    put(splat(1.0), flags, 0)
    if fresh:
        return False, s0, s1
    total, squares = splat(0.0), splat(0.0)
    for j in range(count):
        weight = get(weights, j)
        total, squares = total + weight, squares + weight * weight
    few = total * total < threshold * count * squares
    put(select(few, 1.0, 0.0), flags, 0)
    put(total, flags, 1)
    moved = any_of(few)
    if moved:
        points = np.empty((count, LANES))
        s0, s1 = redraw(SYSTEMATIC, flags[0:1], weights, flags[1:2], points, ancestors, s0, s1)
    return moved, s0, s1


def begin(before, start):
    """Write the state that a run begins with."""
    for a in range(NX):
        put(get(before.mean, a), start.mean, a)
        for b in range(NX):
            put(get(before.covariance, a, b), start.covariance, a, b)


def take(means, covariances, ancestors, j, moved, start):
    """Write the state of the ancestor of particle ``j``; where no lane is redrawn, it is the particle itself."""
    for a in range(NX):
        put(gather(means, ancestors, a) if moved else get(means, j, a), start.mean, a)
        for b in range(a + 1):
            at = a * NX + b
            value = gather(covariances, ancestors, at) if moved else get(covariances, j, at)
            put(value, start.covariance, a, b)
            put(value, start.covariance, b, a)


def draw(count, z, redrawn, s0, s1):
    """Write standard normal numbers ``(>= count + 1, LANES)``; the generator moves on in lanes that are redrawn."""
    t0, t1 = s0, s1
    for p in range(0, count, 2):
        word, t0, t1 = next_words(t0, t1)
        first, second = normal_pair(word)
        put(first, z, p)
        if p + 1 < count:
            put(second, z, p + 1)
    return select(redrawn, t0, s0), select(redrawn, t1, s1)


def split(drawn, n, kernel, whole, flags, squares, start):
    """Move a normal distribution along its parameters, and take off its covariance what it was moved by.

    With ``G G' = P_:z P_zz^-1 P_z:``, the part of the covariance that goes with the parameters ``z``, the mean is
    moved by ``c G e``, ``e`` being standard normal, and ``c^2 G G'`` taken off. ``c`` leaves each parameter
    the kernel's share of its standard deviation over all particles, in the mean over the parameters; where there is no
    more left, nothing is moved.

    Args:
        drawn: ``e``, in the first rows.
        n: Number of states that are no parameters.
        kernel: Standard deviation that is to be left of a parameter, over that of all particles.
        whole: Covariance over all particles ``(nx, nx, LANES)``.
        flags: Row 0: which lanes are split.
        squares: Scratch: 0 covariance of the parameters, then ``G``; 1 the factor of the former.
        start: Changed.
    """
    parameters, x, P = NX - n, start.mean, start.covariance
    for p in range(parameters):
        for q in range(parameters):
            put(get(P, n + p, n + q), squares, 0, p, q)
    cholesky(squares[0], squares[1], parameters)
    kept = splat(0.0)
    for p in range(parameters):
        kept = kept + (kernel * kernel / parameters) * get(whole, n + p, n + p) / get(P, n + p, n + p)
    share = maximum(select(get(flags, 0) > 0.0, 1.0 - select(kept == kept, kept, 1.0), 0.0), 0.0)
    for p in range(parameters):
        pivot = get(squares, 1, p, p)
        for a in range(NX):
            value = get(P, a, n + p)
            for q in range(p):
                value = value - get(squares, 1, p, q) * get(squares, 0, q, a)
            put(select(pivot > 0.0, value / pivot, 0.0), squares, 0, p, a)
        for a in range(NX):
            put(get(x, a) + sqrt(share) * get(squares, 0, p, a) * get(drawn, p), x, a)
    for a in range(NX):
        for b in range(a + 1):
            value = get(P, a, b)
            for p in range(parameters):
                value = value - share * get(squares, 0, p, a) * get(squares, 0, p, b)
            if kernel == 0.0 and a >= n:
                value = select(share > 0.0, 0.0, value)
            put(value, P, a, b)
            put(value, P, b, a)


def weigh_particles(weights, flags, weighed, joint):
    """Turn logarithms of weight times likelihood into weights; return the log-likelihood of the sample.

    Args:
        weights: Before the measurement ``(N, LANES)``.
        flags: Row 0: where they were even.
        weighed: Whether the measurement counts; if not, only broken particles lose their weight.
        joint: Overwritten ``(N, LANES)``.
    """
    count = weights.shape[0]
    best, total = splat(-np.inf), splat(0.0)
    for j in range(count):
        best = maximum(best, get(joint, j))
    for j in range(count):
        value = exp(get(joint, j) - best)
        total = total + value
        if not weighed:
            chance = select(get(flags, 0) > 0.0, 1.0 / count, get(weights, j))
            value = select(get(joint, j) > -np.inf, chance, 0.0)
        put(value, joint, j)
    normalise(joint)
    return best + log(total)
