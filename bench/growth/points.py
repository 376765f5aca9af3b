"""One point of a curve: what work of some size takes, in a process of its own.

All but a study's runs are eight runs of a chain of trailers (``road_train``), so that one size changes at a time.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import joblib
import numpy as np

from bench.growth.road_train import VALUES, road_train
from bench.scale import STUDY
from bench.short_runs import session
from bench.timing import quickest
from harness.common.process import peak_memory_mib
from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation.contract import Estimator
from harness.simulation.simulate import Simulator, in_lanes

STEP, SAMPLES, STATES, ROUNDS = 0.01, 200, 10, 5
TASKS = 16
"""Pieces of work that workers share."""

Point = tuple[float, float]
"""s, and the most that the process held in MiB."""


def study(runs: int) -> Point:
    """Measure a study of so many short runs, from its start to its end: processor time of two threads."""
    folder = Path(tempfile.mkdtemp())
    try:
        (folder / "scale.toml").write_text(STUDY.format(samples=runs // 20), encoding="utf-8")
        done = session(folder, jobs=2)
    finally:
        shutil.rmtree(folder)
    return done.processor, float(done.memory)


def filtered(kind: str = "ekf", **size: Any) -> Point:
    """Measure an estimator on one core; ``size`` goes to ``_work``."""
    seconds = quickest({kind: _work(kind, **size)}, ROUNDS, time.thread_time)[kind]
    return seconds, float(peak_memory_mib() or 0)


def shared(workers: int) -> Point:
    """Measure so many threads at the same pieces of work, by the clock."""
    work = _work("ukf", samples=20_000)  # long enough beside the start of the threads

    def together() -> None:
        joblib.Parallel(n_jobs=workers, backend="threading")(joblib.delayed(work)() for _ in range(TASKS))

    return quickest({"": together}, ROUNDS)[""], float(peak_memory_mib() or 0)


def _work(
    kind: str, states: int = STATES, samples: int = SAMPLES, settings: dict[str, Any] | None = None
) -> Callable[[], object]:
    """Return what runs an estimator over eight runs of a chain of trailers."""
    compiled = compile_model(road_train(states), STEP, signals=("rate_0",))
    constants = compiled.constants(in_lanes(compiled.parameter_vector(VALUES)))
    inputs = np.empty((samples, 2, LANES))
    inputs[:, 0], inputs[:, 1] = 0.02 * np.sin(0.02 * np.arange(samples))[:, None], 15.0
    variance_x, variance_y = np.full((states, LANES), 1e-8), np.full((2, LANES), 1e-5)
    noise = np.random.default_rng(0).normal(size=(samples, states + 2, LANES))
    batch = Simulator(compiled).run(inputs, constants, variance_x, variance_y, noise, np.zeros((states, LANES)))
    estimator = Estimator(kind, compiled, settings)
    belief = estimator.belief(constants, variance_x, variance_y)
    first, until = estimator.init(np.zeros(states), np.full(states, 1e-6)), np.full(LANES, 1.0 * samples)
    return partial(estimator.run, inputs, batch.measurements, batch.truth, compiled.signal_names, until, belief, first)


CURVES: dict[str, tuple[str, Callable[[int], Point], tuple[int, ...]]] = {
    "runs of a study": ("processor s", study, (100, 1_000, 10_000, 100_000, 1_000_000)),
    "samples of a drive, EKF": ("s", lambda n: filtered(samples=n), (1_000, 4_000, 16_000, 64_000, 256_000)),
    "states, EKF": ("s", lambda n: filtered(states=n), (4, 8, 16, 24, 40)),
    "states, UKF": ("s", lambda n: filtered("ukf", states=n), (4, 8, 16, 24, 40)),
    "particles": (
        "s",
        lambda n: filtered("particle", settings={"particles": n}, samples=50),
        (100, 400, 1_600, 6_400, 25_600),
    ),
    "workers": ("s by the clock", shared, (1, 2, 4, 8, 16, 32)),
}
"""By what grows: what is measured, how one point is, and at which sizes."""
