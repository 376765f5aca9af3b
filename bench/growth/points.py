"""One point of a curve: what work of some size takes, in a process of its own.

All but a study's runs are eight runs of a chain of trailers (``road_train``), so that one size changes at a time. Its
tractor is Pacejka's linear single track (2012, 1.3.2). A trailer turns about its hitch: with the distance ``l``
from hitch to axle, yaw inertia ``J`` about the hitch and cornering stiffness ``C``, the moment ``-l C alpha`` of its
tyres gives ``w' = (C l^2 / (J v)) (w_rolling - w)``. With ``w_rolling = (v sin(theta) - h w_ahead cos(theta)) / l`` its
wheels would roll without slip, its hitch ``h`` behind the axle ahead (the general n-trailer of Altafini 2001). What a
trailer does to the body ahead is left out: the equations of a body read those of the one ahead only, as in a chain of
light trailers.
"""

from __future__ import annotations

import shutil
import tempfile
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path
from types import ModuleType
from typing import Any

import joblib
import numpy as np
import sympy as sp

from bench.scale import STUDY
from bench.short_runs import session
from bench.timing import quickest
from harness.common.process import peak_memory_mib
from harness.engine.compile import compile_model
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.models.assembly.assemble import StateSpaceModel, assemble
from harness.models.contracts import Parameter
from harness.models.signals import Signal
from harness.runner.contract import Held, InputSeries, Signals
from harness.runner.scores import Scoring
from harness.simulation.simulate import CompiledSimulator, in_lanes

STEP, SAMPLES, STATES, ROUNDS = 0.01, 200, 10, 5
TASKS = 16
"""Pieces of work that workers share."""

Point = tuple[float, float]
"""s, and the most that the process held in MiB."""

PARAMETERS = (
    Parameter("tractor_mass", "m", "kg", 2e3, 3e4, "mass of the tractor"),
    Parameter("tractor_yaw_inertia", "J_1", "kg*m^2", 2e3, 3e5, "yaw inertia of the tractor"),
    Parameter("stiffness", "C", "N/rad", 1e4, 1e6, "cornering stiffness of each axle"),
    Parameter("wheelbase", "L", "m", 1.0, 8.0, "wheelbase of the tractor, its CoG in the middle"),
    Parameter("hitch", "h", "m", 0.0, 3.0, "hitch behind the axle ahead"),
    Parameter("length", "l", "m", 1.0, 12.0, "hitch to axle of a trailer"),
    Parameter("inertia", "J", "kg*m^2", 2e3, 3e5, "yaw inertia of a trailer about its hitch"),
)
VALUES = {
    "tractor_mass": 8e3, "tractor_yaw_inertia": 2e4, "stiffness": 2e5, "wheelbase": 3.6, "hitch": 0.5, "length": 5.0,
    "inertia": 8e4,
}  # fmt: skip


def road_train(states: int) -> StateSpaceModel:
    """Return a tractor with as many trailers as make that many states.

    Args:
        states: Even, at least 4: lateral velocity and yaw rate of the tractor, angle and yaw rate of each trailer.
    """
    bodies = range(1, states // 2)
    angles, rates = [f"angle_{i}" for i in bodies], [f"rate_{i}" for i in bodies]

    def equations(v: Any) -> None:
        speed, delta = v.input("speed"), v.input("steering_angle")
        m, stiffness, half = v.p("tractor_mass"), v.p("stiffness"), v.p("wheelbase") / 2
        v_y, ahead = v.state("lateral_velocity"), v.state("rate_0")
        front = stiffness * (delta - (v_y + half * ahead) / speed)
        rear = -stiffness * (v_y - half * ahead) / speed
        v.derivative("lateral_velocity", (front + rear) / m - speed * ahead)
        v.derivative("rate_0", half * (front - rear) / v.p("tractor_yaw_inertia"))
        length, hitch = v.p("length"), v.p("hitch")
        for angle, rate in zip(angles, rates, strict=True):
            theta, own = v.state(angle), v.state(rate)
            rolling = (speed * sp.sin(theta) - hitch * ahead * sp.cos(theta)) / length
            v.derivative(angle, ahead - own)
            v.derivative(rate, stiffness * length**2 / (v.p("inertia") * speed) * (rolling - own))
            ahead = own

    names = ("lateral_velocity", "rate_0", *(n for pair in zip(angles, rates, strict=True) for n in pair))
    vehicle, sensors = ModuleType(f"road_train_{states}"), ModuleType("road_train_sensors")
    vehicle.__dict__.update(
        STATES=names,
        INPUTS=("steering_angle", "speed"),
        PARAMETERS=PARAMETERS,
        AXLES={},
        VALID={},
        SIGNALS=tuple(Signal(n, n, "1", "1", "", "a state of the chain") for n in (*names[1:], "steering_angle")),
        equations=equations,
    )
    sensors.__dict__.update(OUTPUTS={"rate_0": "rate_0", "angle_1": "angle_1"})
    return assemble(vehicle, sensors=sensors)


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
    inputs = np.empty((samples, 2, LANES))
    inputs[:, 0], inputs[:, 1] = 0.02 * np.sin(0.02 * np.arange(samples))[:, None], 15.0
    held = Held(
        in_lanes(compiled.parameter_vector(VALUES)),
        np.full((states, LANES), 1e-8),
        np.full((2, LANES), 1e-5),
        np.zeros((states, LANES)),
        np.full((states, LANES), 1e-6),
    )
    noise = np.random.default_rng(0).normal(size=(samples, states + 2, LANES))
    simulator, signals = CompiledSimulator(compiled.model, STEP), compiled.signal_names
    batch = simulator.run(InputSeries(inputs), held, noise, Signals(signals))
    record = Scoring(batch.truth, signals, np.full(LANES, 1.0 * samples))
    return partial(
        CompiledEstimator(kind, compiled, settings).run, InputSeries(inputs), batch.measurements, held, record
    )


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
