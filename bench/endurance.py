"""Filters that run for a day: do their covariances stay symmetric and positive definite? ``python -m bench.endurance``.

The semitrailer of the mass study weaves, every hour anew, with noise; each Kalman-type filter goes on from the state in
which the hour before has left it, eight runs at a time. After every sample its covariance is factored; the smallest
pivot, as a share of its variance, says how far it is from being singular.
"""

from __future__ import annotations

import dataclasses
import time
from typing import cast

import numpy as np
from rich.console import Console
from rich.table import Table

from bench.engine import mass_study
from harness.common.arguments import Parser
from harness.common.arrays import Floats
from harness.engine.compile import load_source, paste
from harness.engine.kernel_names import (
    LANES,
    NX,
    NY,
    Info,
    State,
    cholesky,
    get,
    maximum,
    minimum,
    put,
    select,
    splat,
    sqrt,
)
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.estimation.contract import kernels_of, load_estimator
from harness.runner.contract import InputSeries
from harness.runner.filter_loop import step, workspace, write_covariance
from harness.runner.simulation_loop import outside
from harness.simulation.simulate import in_lanes
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case

KINDS = ("kf", "ekf", "ukf", "cdkf", "st_cdkf")
HOUR = 3600.0


def endure(u, y, belief, first, limits, worst):
    """Run a filter on from a state, which is overwritten by the last one.

    Args:
        u: Inputs ``(samples, nu, LANES)``.
        y: Measurements ``(samples, ny, LANES)``.
        belief: ``harness.engine.kernel_names.Belief``.
        first: ``harness.engine.kernel_names.State``.
        limits: Largest magnitude of each state ``(nx,)``.
        worst: Updated: largest difference of two mirrored entries over the root of their variances, smallest pivot over
            its variance, samples at which a pivot was too small, and samples with a state outside ``(4, LANES)``.
    """
    work = workspace()
    before = State(first.mean.copy(), first.covariance.copy(), first.memory.copy())
    after = State(np.empty((NX, LANES)), np.zeros((NX, NX, LANES)), np.empty(first.memory.shape))
    row = np.zeros((4, LANES))
    info = Info(np.zeros((NY, LANES)), np.zeros((NY, NY, LANES)), row[0:1], row[1:2], row[2:3], row[3:4])
    factor = np.zeros((NX, NX, LANES))
    for k in range(1, u.shape[0]):
        step(before, u[k - 1], u[k], y[k], belief, work, after, info)
        before, after = after, before
        write_covariance(before, work)
        repaired = cholesky(before.covariance, factor, NX)
        apart, pivot = get(worst, 0), get(worst, 1)
        for i in range(NX):
            variance = get(before.covariance, i, i)
            share = get(factor, i, i) * get(factor, i, i) / variance
            pivot = minimum(pivot, select(share == share, share, -1.0))
            for j in range(i):
                away = get(before.covariance, i, j) - get(before.covariance, j, i)
                away = select(away < 0.0, -away, away) / sqrt(variance * get(before.covariance, j, j))
                apart = maximum(apart, select(away == away, away, 1.0))
        put(apart, worst, 0)
        put(pivot, worst, 1)
        put(get(worst, 2) + select(repaired > 0.0, 1.0, 0.0), worst, 2)
        put(get(worst, 3) + select(outside(before.mean, limits) > 0.0, 1.0, 0.0), worst, 3)
    for i in range(NX):
        put(get(before.mean, i), first.mean, i)
        for j in range(NX):
            put(get(before.covariance, i, j), first.covariance, i, j)
    for i in range(first.memory.shape[0]):
        put(get(before.memory, i), first.memory, i)
    put(splat(0.0), row, 0)


@dataclasses.dataclass(frozen=True)
class Endured:
    """What a filter was like, worst of all runs.

    Attributes:
        asymmetry: Largest difference of two mirrored entries of a covariance over the root of their variances.
        pivot: Smallest pivot of a covariance over its variance; at or below 0 it is not positive definite.
        repairs: Samples at which a pivot was below what working precision holds.
        outside: Samples with a state that is no number or outside the vehicle's range of validity.
        seconds: That the filter took.
    """

    asymmetry: float
    pivot: float
    repairs: int
    outside: int
    seconds: float


def endurance(kinds: tuple[str, ...] = KINDS, hours: float = 24.0, part: float = HOUR) -> dict[str, Endured]:
    """Run filters for so many hours.

    Args:
        kinds: Estimators.
        hours: In all.
        part: s of each part, which has noise of its own; all of it where that is less.
    """
    part = min(part, hours * HOUR)
    study = mass_study(*kinds)
    wanted = next(d for d in study.drives if d.kind == "sine")
    drive = dataclasses.replace(wanted, options={**wanted.options, "duration": part})
    estimators = tuple(next(e for e in study.estimators if e.kind == kind) for kind in kinds)
    evaluator = StudyEvaluator(dataclasses.replace(study, drives=(drive,), estimators=estimators))
    compiled, plant = evaluator.compiled, evaluator.compiled.plant
    unit, cases = Unit(0, 0, 0, 0, 1), [Case(0, r) for r in range(LANES)]
    held, believed = evaluator.held(unit, cases, "plant"), evaluator.held(unit, cases, "belief")
    loops, states, beliefs = {}, {}, {}
    for i, kind in enumerate(kinds):
        source = paste(compiled.belief, f"endure_{kind}", [endure], kernels_of(load_estimator(kind)))
        loops[kind] = load_source(f"endure_{kind}", source).endure
        estimator = cast(CompiledEstimator, compiled.estimators[i])
        beliefs[kind], states[kind] = estimator.begin(evaluator.believed_by(i, unit, cases, believed))
    extremes = {kind: np.array([0.0, 1.0, 0.0, 0.0])[:, None] * np.ones(LANES) for kind in kinds}
    spent = dict.fromkeys(kinds, 0.0)
    limits = np.array([compiled.belief.model.valid.get(n, np.inf) for n in compiled.belief.model.states])
    rows = [plant.signal_names.index(n) for n in plant.model.states if n in plant.signal_names]
    assert len(rows) == plant.nx
    inputs = compiled.drives[0].plant
    for number in range(round(hours * HOUR / part)):
        noise = in_lanes(np.zeros((len(inputs), plant.nx + plant.ny)))
        noise[:] = np.random.default_rng([number, 0]).standard_normal(noise.shape)
        batch = compiled.simulator.run(InputSeries(inputs), held, noise, compiled.recorded)
        assert (batch.left_at == len(inputs)).all(), "the vehicle left its range: choose a calmer drive"
        held = dataclasses.replace(held, first=np.ascontiguousarray(batch.truth[-1, rows]))
        inputs_held, measurements = compiled.known(0, batch), compiled.measured(batch.measurements)
        for kind in kinds:
            begin = time.process_time()
            loops[kind](inputs_held, measurements, beliefs[kind], states[kind], limits, extremes[kind])
            spent[kind] += time.process_time() - begin
    return {k: _worst(extremes[k], spent[k]) for k in kinds}


def _worst(extremes: Floats, seconds: float) -> Endured:
    return Endured(
        float(extremes[0].max()),
        float(extremes[1].min()),
        int(extremes[2].max()),
        int(extremes[3].max()),
        round(seconds, 1),
    )


def main() -> None:
    """Run and print."""
    parser = Parser(description=__doc__)
    parser.add_argument("--hours", type=float, default=24.0)
    parser.add_argument("--kind", action="append", help=f"of {', '.join(KINDS)}; repeatable")
    given = parser.parse_args()
    table = Table(title=f"{given.hours:g} h at 100 Hz, eight runs of the semitrailer, worst of all samples and runs")
    for column in ("filter", "asymmetry", "smallest pivot", "too small", "outside", "processor s"):
        table.add_column(column, justify="left" if column == "filter" else "right")
    for kind in given.kind or KINDS:
        for name, e in endurance((kind,), given.hours).items():
            row = (name, f"{e.asymmetry:.1e}", f"{e.pivot:.1e}", str(e.repairs), str(e.outside), f"{e.seconds:.0f}")
            table.add_row(*row)
    Console().print(table)


if __name__ == "__main__":
    main()
