"""Time of the parts of a particle filter alone, over many particles of the mass study's belief."""

from __future__ import annotations

import time
from typing import Any, cast

import numpy as np

from bench.engine import PARTICLES, mass_study
from bench.floor.counting import counted, counts
from bench.timing import quickest
from harness.engine.compile import load_source, paste
from harness.engine.kernel_names import get, next_state, output, put, splat
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.methods._drawing import normals
from harness.estimation.methods._weighing import sum_up, weigh
from harness.estimation.methods.particle import take
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case


def propagate(cloud, u, constants, ahead, w):
    """Compute the next state of every particle."""
    for n in range(cloud.shape[0]):
        next_state(cloud[n], u, constants, ahead[n], w)


def draw(numbers, count, words):
    """Draw the process noise of every particle."""
    s0, s1 = get(words, 0), get(words, 1)
    for n in range(count):
        s0, s1 = normals(numbers, n % 2 == 1, s0, s1)
    put(s0, words, 0)
    put(s1, words, 1)


def likelihood(cloud, u, constants, weights, outputs, products):
    """Weigh every particle by a measurement."""
    for n in range(cloud.shape[0]):
        output(cloud[n], u, constants, outputs[0])
        put(weigh(n == 0, get(weights, n), splat(1.0), outputs, products), weights, n)


def summed(cloud, log_weights, weights, mean):
    """Take weights and mean of the particles."""
    sum_up(cloud, log_weights, weights, splat(0.0), mean)


def redrawn(cloud, ancestors, x):
    """Fetch every particle from its ancestor."""
    for n in range(cloud.shape[0]):
        take(cloud, ancestors, n, x)


def parts(rounds: int = 20) -> tuple[dict[str, float], dict[str, dict[str, float]]]:
    """Return what the parts of a particle filter take; ancestors are fetched only where particles are redrawn.

    Returns:
        ns per particle and run by part, on one core, and operations on all lanes per particle by part and kind.
    """
    evaluator = StudyEvaluator(mass_study("particle"))
    compiled, unit, cases = evaluator.compiled.belief, Unit(0, 4, 3, 0, 1), [Case(0, r) for r in range(LANES)]
    believed = evaluator.believed_by(0, unit, cases, evaluator.held(unit, cases, "belief"))
    belief, first = cast(CompiledEstimator, evaluator.compiled.estimators[0]).begin(believed)
    kernels = load_source("parts", paste(compiled, "parts", [propagate, draw, likelihood, summed, redrawn]))
    inputs = evaluator.compiled.known(unit.drive, evaluator.simulate(unit, cases, 3))[2]
    rng, nx, ny = np.random.default_rng(0), compiled.nx, compiled.ny
    cloud = first.mean + 1e-3 * rng.normal(size=(PARTICLES, nx, LANES))
    ahead, w, x, mean = np.empty_like(cloud), np.empty((compiled.nw, LANES)), *np.empty((2, nx, LANES))
    numbers, words = np.empty((nx + 1, LANES)), rng.uniform(1.0, 2.0, size=(2, LANES))
    outputs, products = np.zeros((5, ny, LANES)), np.zeros((ny, ny, LANES))
    log_weights, weights = np.zeros((2, PARTICLES, LANES))
    ancestors = np.sort(rng.integers(0, PARTICLES, size=(PARTICLES, LANES)), axis=0).astype(float)
    c = belief.constants
    work: dict[str, tuple[Any, tuple[Any, ...]]] = {
        "the model": (kernels.propagate, (cloud, inputs, c, ahead, w)),
        "noise": (kernels.draw, (numbers, PARTICLES, words)),
        "likelihood": (kernels.likelihood, (cloud, inputs, c, log_weights, outputs, products)),
        "weights and mean": (kernels.summed, (cloud, log_weights, weights, mean)),
        "ancestors, where redrawn": (kernels.redrawn, (cloud, ancestors, x)),
    }
    calls = {name: lambda function=function, given=given: function(*given) for name, (function, given) in work.items()}
    times = {name: 1e9 * t / PARTICLES / LANES for name, t in quickest(calls, rounds, time.thread_time).items()}
    return times, {name: _per_particle(function, given) for name, (function, given) in work.items()}


def _per_particle(function: Any, given: tuple[Any, ...]) -> dict[str, float]:
    counts.clear()
    counted(function)(*given)
    return {kind: number / PARTICLES for kind, number in counts.items()}
