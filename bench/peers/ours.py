"""This project's filters on the problem of the peers."""

from __future__ import annotations

from collections.abc import Callable
from typing import cast

import numpy as np

from bench.peers.problem import UNIT, Problem
from harness.common.arrays import Floats
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.simulation.simulate import in_lanes


def filtering(given: Problem) -> Callable[[], object]:
    """Return what runs the filter over the whole batch, scores included, on one core."""
    evaluator = given.evaluator
    work = []
    for group in given.groups():
        batch, believed = (
            evaluator.simulate(UNIT, group, len(given.inputs)),
            evaluator.held(UNIT, group, "belief"),
        )
        work.append((group, batch, believed))
    return lambda: [evaluator.estimate(0, UNIT, group, batch, believed) for group, batch, believed in work]


def simulating(given: Problem) -> Callable[[], object]:
    """Return what simulates the whole batch with noise, on one core."""
    samples = len(given.inputs)
    return lambda: [given.evaluator.simulate(UNIT, group, samples) for group in given.groups()]


def means(given: Problem) -> Floats:
    """Return the means of the first run ``(steps, nx)``."""
    group = given.groups()[0]
    evaluator = given.evaluator
    estimator = cast(CompiledEstimator, evaluator.compiled.estimators[0])
    belief, state = estimator.begin(evaluator.believed_by(0, UNIT, group, evaluator.held(UNIT, group, "belief")))
    kept = np.empty((given.steps, len(given.mean)))
    for k in range(1, len(given.inputs)):
        before, now = in_lanes(given.inputs[k - 1]), in_lanes(given.inputs[k])
        state, _ = estimator.step(state, before, now, in_lanes(given.measurements[k, :, 0]), belief)
        kept[k - 1] = state.mean[:, 0]
    return kept
