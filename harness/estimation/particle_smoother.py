"""Particle smoothers: the state of a finished run, given all of its measurements.

Both go backwards over the particles that the filter left at each sample and use the model's transition density
``p(x(t+1) | x(t)) = N(f(x(t), u(t)), Q)``:

* ``reweight``: the marginal smoother (Sun 2015, 2.74 to 3.2; Doucet, Godsill and Andrieu 2000) gives the particles
  new weights, in O(N^2) per sample;
* ``simulate_backward``: draws whole trajectories (Godsill, Doucet and West 2004), in O(N) each per sample.

Sun's (3.1) is (2.74) after redrawing, when all weights of the filter are equal; here they are what they are.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numba import njit

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.engine.compile import CompiledModel
from harness.engine.kernel_names import Belief, State
from harness.engine.simd.functions import exp, maximum
from harness.engine.simd.lanes import LANES, get, put, splat
from harness.estimation.compiled_estimator import CompiledEstimator

_jit = njit(error_model="numpy", nogil=True)


@dataclass(frozen=True)
class Clouds:
    """The particles of one run, from the first sample with a measurement on (the second of the drive).

    Attributes:
        particles: ``(samples, N, nx)``.
        weights: Normalised ``(samples, N)``.
        ahead: Where the model takes each particle by the next sample, without noise ``(samples - 1, N, nx)``.
        process_noise: Variances per step ``(nx,)``.
    """

    particles: Floats
    weights: Floats
    ahead: Floats
    process_noise: Floats

    @property
    def mean(self) -> Floats:
        """The filter's estimate ``(samples, nx)``."""
        return mean_of(self.particles, self.weights)


def mean_of(particles: Floats, weights: Floats) -> Floats:
    """Return the mean of weighted particles at each sample, ``(samples, nx)``."""
    return np.einsum("tn,tni->ti", weights, particles)


def run_filter(
    estimator: CompiledEstimator, inputs: Floats, measurements: Floats, belief: Belief, first: State, lanes: int = 1
) -> list[Clouds]:
    """Run a particle filter and keep its particles.

    Args:
        estimator: Of kind ``particle``.
        inputs: ``(samples, nu, LANES)``.
        measurements: ``(samples, ny, LANES)``; NaN where missing.
        belief: From ``estimator.belief``.
        first: From ``estimator.init``.
        lanes: Number of runs to keep, the first of the batch.

    Raises:
        UserError: If the estimator has no particles, a state has no process noise, or all weights of a run are zero.
    """
    if estimator.kind != "particle":
        raise UserError(f"a particle smoother needs the estimator 'particle', got '{estimator.kind}'")
    compiled, samples = estimator.compiled, len(measurements)
    for row, name in enumerate(compiled.model.states):
        if not np.all(belief.process_noise[row, :lanes] > 0):
            raise UserError(
                f"a particle smoother needs process noise on every state, '{name}' has none; give it a small variance"
            )
    nx = compiled.nx
    head, count = _layout(first.memory, nx)
    particles = np.empty((lanes, samples - 1, count, nx))
    weights, ahead = np.empty((lanes, samples - 1, count)), np.empty((lanes, samples - 2, count, nx))
    state = first
    for k in range(1, samples):
        state, _ = estimator.step(state, inputs[k - 1], inputs[k], measurements[k], belief)
        cloud = state.memory[head : head + count * nx].reshape(count, nx, LANES)
        raw = state.memory[head + count * (nx + 1) :]
        for lane in range(lanes):
            total = raw[:, lane].sum()
            if not np.isfinite(total):
                raise UserError(f"run {lane}: all weights are zero at sample {k}; the filter has diverged")
            particles[lane, k - 1], weights[lane, k - 1] = cloud[:, :, lane], raw[:, lane] / total
            if k < samples - 1:
                ahead[lane, k - 1] = propagate(
                    compiled, particles[lane, k - 1], inputs[k, :, lane], belief.constants[:, lane]
                )
    return [Clouds(particles[i], weights[i], ahead[i], belief.process_noise[:, i].copy()) for i in range(lanes)]


def _layout(memory: Floats, nx: int) -> tuple[int, int]:
    """Return the rows before the particles and the number of particles of the filter's memory."""
    from harness.estimation.methods.particle import HEAD

    return HEAD, (len(memory) - HEAD) // (nx + 2)


def propagate(compiled: CompiledModel, particles: Floats, u: Floats, c: Floats) -> Floats:
    """Return ``f(x, u)`` of particles ``(N, nx)`` for inputs ``(nu,)`` and constants ``(nc,)``."""
    blocks = _in_lanes(particles)
    ahead, w = np.empty_like(blocks), np.empty((compiled.nw, LANES))
    u_lanes, c_lanes = (np.ascontiguousarray(np.repeat(a[:, None], LANES, axis=1)) for a in (u, c))
    for block in range(len(blocks)):
        compiled.kernels.next_state(blocks[block], u_lanes, c_lanes, ahead[block], w)
    return ahead.transpose(0, 2, 1).reshape(-1, particles.shape[1])[: len(particles)]


def _in_lanes(table: Floats, fill: float | None = None) -> Floats:
    """Return ``(N, nx)`` as ``(blocks, nx, LANES)``; lanes left over repeat the last row or hold ``fill``."""
    blocks = -(-len(table) // LANES)
    padded = np.empty((blocks * LANES, table.shape[1]))
    padded[: len(table)] = table
    padded[len(table) :] = table[-1] if fill is None else fill
    return np.ascontiguousarray(padded.reshape(blocks, LANES, -1).transpose(0, 2, 1))


@dataclass(frozen=True)
class Transitions:
    """How the particles of one run moved, given measurements, from each sample to the next (Sun 2015, 2.77).

    Attributes:
        weights: Of the particles ``(samples, N)``.
        targets: Mean of the next state for each particle but the last sample's ``(samples - 1, N, nx)``.
        spread: Variance of the next state about these means, summed over particles and samples ``(nx,)``.
    """

    weights: Floats
    targets: Floats
    spread: Floats


def reweight(clouds: Clouds) -> Floats:
    """Return the smoothed weights of the filter's particles, ``(samples, N)`` (Sun 2015, 2.74, 2.75)."""
    return transitions(clouds).weights


def transitions(clouds: Clouds, smoothed: bool = True) -> Transitions:
    """Return the pairs of particles at neighbouring samples, weighted by ``p(x(t), x(t+1) | y)`` (Sun 2015, 2.77).

    The N^2 pairs of a sample enter through their sum, mean and variance over the particles at ``t + 1``, from which the
    expectation of any function that is quadratic in ``x(t+1)`` follows.

    Args:
        clouds: From ``run_filter``.
        smoothed: Whether all measurements count, or only those up to ``t + 1``.
    """
    steps, count, nx = clouds.ahead.shape
    weights, targets, spread = clouds.weights.copy(), np.empty((steps, count, nx)), np.zeros(nx)
    for t in range(steps - 1, -1, -1):
        _pair(
            _in_lanes(clouds.ahead[t]),
            _in_lanes(_log(clouds.weights[t])[:, None], -np.inf)[:, 0],
            clouds.particles[t + 1],
            weights[t + 1] if smoothed else clouds.weights[t + 1],
            0.5 / clouds.process_noise,
            weights[t],
            targets[t],
            spread,
        )
    return Transitions(weights, targets, spread)


def simulate_backward(clouds: Clouds, trajectories: int, rng: np.random.Generator) -> Floats:
    """Return trajectories drawn from the smoothing distribution, ``(samples, trajectories, nx)``, equally likely.

    Args:
        clouds: From ``run_filter``.
        trajectories: How many.
        rng: Random numbers.
    """
    samples = len(clouds.particles)
    drawn = np.empty((samples, trajectories, clouds.particles.shape[2]))
    last = rng.choice(clouds.weights.shape[1], trajectories, p=clouds.weights[-1])
    drawn[-1] = clouds.particles[-1, last]
    for t in range(samples - 2, -1, -1):
        chosen = np.empty(trajectories, dtype=np.int64)
        _choose(
            _in_lanes(clouds.ahead[t]),
            _in_lanes(_log(clouds.weights[t])[:, None], -np.inf)[:, 0],
            drawn[t + 1],
            0.5 / clouds.process_noise,
            rng.random(trajectories),
            chosen,
        )
        drawn[t] = clouds.particles[t, np.minimum(chosen, clouds.weights.shape[1] - 1)]
    return drawn


def _log(weights: Floats) -> Floats:
    with np.errstate(divide="ignore"):
        return np.log(weights)


@_jit
def _log_products(ahead, log_weights, target, half_precision, scratch):
    """Write ``log(w_j p(target | x_j))`` but for a constant, LANES particles at a time; return the largest."""
    best = splat(-np.inf)
    for block in range(ahead.shape[0]):
        value = get(log_weights, block)
        for i in range(ahead.shape[1]):
            away = target[i] - get(ahead, block, i)
            value = value - half_precision[i] * (away * away)
        put(value, scratch, block)
        best = maximum(best, value)
    row = np.empty((1, LANES))
    put(best, row, 0)
    return row.max()


@_jit
def _normalise(scratch, largest):
    """Turn logarithms into ``exp(value - largest)`` and return their sum."""
    total = splat(0.0)
    for block in range(scratch.shape[0]):
        value = exp(get(scratch, block) - largest)
        put(value, scratch, block)
        total = total + value
    row = np.empty((1, LANES))
    put(total, row, 0)
    return row.sum()


@_jit
def _pair(ahead, log_weights, targets, target_weights, half_precision, mass, means, spread):
    """Write sum and mean, and add the variance, of ``w_i w_j p(x_i | x_j) / sum_j w_j p(x_i | x_j)`` over ``i`` (2.74).

    Moments are taken about ``ahead``, so that no digits are lost.
    """
    blocks, nx = ahead.shape[0], ahead.shape[1]
    scratch, total = np.empty((blocks, LANES)), np.zeros((blocks, LANES))
    first, second = np.zeros((blocks, nx, LANES)), np.zeros((nx, LANES))
    for i in range(targets.shape[0]):
        if target_weights[i] > 0.0:
            largest = _log_products(ahead, log_weights, targets[i], half_precision, scratch)
            share = target_weights[i] / _normalise(scratch, largest)
            for block in range(blocks):
                weight = share * get(scratch, block)
                put(get(total, block) + weight, total, block)
                for d in range(nx):
                    away = targets[i, d] - get(ahead, block, d)
                    put(get(first, block, d) + weight * away, first, block, d)
                    put(get(second, d) + weight * (away * away), second, d)
    everything = total.sum()
    for d in range(nx):
        for lane in range(LANES):
            spread[d] += second[d, lane] / everything
    for j in range(mass.shape[0]):
        block, lane = j // LANES, j % LANES
        held = total[block, lane]
        mass[j] = held / everything
        for d in range(nx):
            away = first[block, d, lane] / held if held > 0.0 else 0.0
            means[j, d] = ahead[block, d, lane] + away
            spread[d] -= held * away * away / everything


@_jit
def _choose(ahead, log_weights, targets, half_precision, points, chosen):
    """Write for each target a particle drawn with probability ``w_j p(target | x_j)``."""
    scratch = np.empty((ahead.shape[0], LANES))
    for m in range(targets.shape[0]):
        largest = _log_products(ahead, log_weights, targets[m], half_precision, scratch)
        remainder = points[m] * _normalise(scratch, largest)
        flat = scratch.reshape(scratch.size)
        j = 0
        while j < flat.shape[0] - 1 and remainder >= flat[j]:
            remainder -= flat[j]
            j += 1
        chosen[m] = j
