"""Time per step and run of the simulation and of every estimator of the mass study, and two workers against one."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import joblib
import numpy as np

from bench.timing import quickest
from harness.config import StudySpec, load_study
from harness.engine.simd.lanes import LANES
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case

ROOT = Path(__file__).resolve().parents[1]
TARGETS = {"simulation with noise": 0.11, "ekf": 0.19, "ukf": 0.65, "st_cdkf": 0.70, "narx": 0.10}
"""Microseconds per step and run on one core."""

PARTICLES = 1000
PARTICLE_TARGET = 24.0
"""Nanoseconds per particle and step on one core."""

WORKERS_TARGET = 1.92
"""How many times as fast two workers are as one."""

LARGEST_BATCH = 2**24
"""Bytes; the arrays of a measurement are smaller."""


def mass_study(*kinds: str) -> StudySpec:
    """Return the mass study, with these estimators alone if any are given."""
    study = load_study(ROOT / "studies" / "mass.toml")
    chosen = tuple(e for e in study.estimators if not kinds or e.kind in kinds)
    return dataclasses.replace(study, estimators=chosen, history=())


def tiled(array: Any, runs: int, axis: int = -1) -> Any:
    """Return an array with its runs repeated up to so many."""
    return np.take(array, np.arange(runs) % array.shape[axis], axis=axis)


def step_times(samples: int = 2000, rounds: int = 15) -> dict[str, float]:
    """Return microseconds per step and run of every estimator of the mass study, scores included, on one core.

    Args:
        samples: Steps of each measurement.
        rounds: Measurements of each, of which the quickest counts.
    """
    return _step_times(mass_study(), samples, rounds)


def particle_time(samples: int = 200, rounds: int = 8) -> float:
    """Return nanoseconds per particle and step of the particle filter with its usual settings and many particles."""
    study = mass_study("particle")
    settings = study.estimators[0].settings | {"particles": PARTICLES, "roughening": 0.0}
    estimators = (dataclasses.replace(study.estimators[0], settings=settings),)
    return 1e3 * _step_times(dataclasses.replace(study, estimators=estimators), samples, rounds)["particle"] / PARTICLES


def _step_times(study: StudySpec, samples: int, rounds: int) -> dict[str, float]:
    keep_pages()
    evaluator = StudyEvaluator(study)
    unit, cases = Unit(0, 4, 3, 0, 1), [Case(0, r) for r in range(LANES)]
    batch, believed = evaluator.simulate(unit, cases, samples), evaluator.held(unit, cases, "belief")
    work: dict[str, Callable[[], object]] = {"simulation with noise": lambda: evaluator.simulate(unit, cases, samples)}
    for i, kind in enumerate(e.kind for e in study.estimators):
        work[kind] = lambda i=i: evaluator.estimate(i, unit, cases, batch, believed)
    return {name: 1e6 * t / samples / LANES for name, t in quickest(work, rounds, time.thread_time).items()}


def keep_pages() -> None:
    """Make the allocator keep the memory of arrays that are freed.

    It gives large ones back to the system until the first of their size has been freed. What is measured in a process
    would depend on what the process did before: pages fetched anew take as long as the simulation that writes to them.
    A study keeps its pages (0.3 % of its time is the system's).
    """
    np.zeros(LARGEST_BATCH // 8)


def workers(rounds: int = 3) -> float:
    """Return how many times faster two worker threads are than one on the mass study's units."""
    evaluator = StudyEvaluator(mass_study("ekf", "ukf"))
    for i in range(evaluator.kernels):
        evaluator.warm_up(i)
    units = [Unit(0, band, drive, 0, 1) for band in (0, 6) for drive in range(6)]

    def run(jobs: int) -> None:
        joblib.Parallel(n_jobs=jobs, backend="threading")(joblib.delayed(evaluator.evaluate)(u) for u in units)

    best = quickest({"1": lambda: run(1), "2": lambda: run(2)}, rounds)
    return best["1"] / best["2"]
