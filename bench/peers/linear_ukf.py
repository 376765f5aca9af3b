"""Our UKF on a linear model of four states, for a published time of another language."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.models.assembly.assemble import Builder, assemble
from harness.models.signals import Signal
from harness.runner.contract import Held, InputSeries
from harness.runner.scores import Scoring
from harness.simulation.simulate import in_lanes
from harness.testing.small_models import module

STATES = ("place_1", "rate_1", "place_2", "rate_2")
STEP = 0.1
RUNS = LANES

PUBLISHED = 0.35
"""Microseconds per step that LowLevelParticleFilters.jl is reported to take with four states on static arrays."""


def _equations(v: Builder) -> None:
    x = [v.state(name) for name in STATES]
    push = v.input("push")
    for i in (0, 2):
        v.next_value(STATES[i], x[i] + STEP * x[i + 1])
        v.next_value(STATES[i + 1], x[i + 1] + STEP * (push - x[i] - 0.2 * x[i + 1]))


def filtering(samples: int) -> Callable[[], object]:
    """Return our UKF on two damped oscillators with a common input, two measured places, ``LANES`` runs."""
    signals = tuple(Signal(name, name, "", "", "", name) for name in (*STATES, "push"))
    vehicle = module(
        "two_oscillators",
        STATES=STATES, INPUTS=("push",), PARAMETERS=(), AXLES={}, VALID={}, SIGNALS=signals, equations=_equations,
    )  # fmt: skip
    model = assemble(vehicle, sensors=module("places", OUTPUTS={o: o for o in STATES[::2]}))
    compiled = compile_model(model, STEP)
    estimator = CompiledEstimator("ukf", compiled)
    rng = np.random.default_rng(0)
    inputs, measured = rng.normal(size=(samples, 1, LANES)), rng.normal(size=(samples, 2, LANES))
    noise = in_lanes(np.full(4, 1e-3)), in_lanes(np.ones(2))
    held = Held(np.zeros((0, LANES)), *noise, np.zeros((4, LANES)), np.ones((4, LANES)))
    record = Scoring(np.zeros((samples, 4, LANES)), STATES, np.full(LANES, float(samples)))
    return lambda: estimator.run(InputSeries(inputs), measured, held, record)
