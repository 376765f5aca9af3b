"""The first runs of a unit as somebody sees them who knows the vehicle: its parameters and noise in the belief."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.config.bounds import loading_parameters, settled
from harness.engine.simd.lanes import LANES
from harness.simulation.simulate import first_state
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case


@dataclass(frozen=True)
class KnownRuns:
    """Runs of a unit, as many as there are lanes, and what is to know of them.

    Attributes:
        runs: How many there are; further lanes repeat the last.
        truth: Signals of the plant ``(samples, signals, LANES)``.
        measurements: ``(samples, ny, LANES)``.
        inputs: What estimators know of them ``(samples, nu, LANES)``.
        constants: Of the belief's model with the vehicle's parameters, but for those among the states.
        walk, noise: Variances of process ``(LANES, nx)`` and measurements ``(LANES, ny)``: the vehicle's, and the
            belief's where the vehicle has none.
        mean: First state ``(nx, LANES)``.
        first: Its variances ``(LANES, nx)``.
        scored: Samples that count ``(samples, LANES)``.
    """

    runs: int
    truth: Floats
    measurements: Floats
    inputs: Floats
    constants: Floats
    walk: Floats
    noise: Floats
    mean: Floats
    first: Floats
    scored: np.ndarray

    @classmethod
    def of_unit(cls, evaluator: StudyEvaluator, unit: Unit) -> KnownRuns:
        """Return the first runs of a unit."""
        study, compiled = evaluator.study, evaluator.compiled
        repeats = range(study.designs[unit.design].repeats)
        cases = [Case(s, r) for s in range(unit.first, unit.stop) for r in repeats][:LANES]
        batch, plant = evaluator.simulate(unit, cases), evaluator.parameters(unit, cases, "plant")
        believed, model = evaluator.parameters(unit, cases, "belief"), compiled.belief
        values = _true_values(evaluator, plant.values, believed.values).T
        states, outputs = model.model.states, tuple(study.belief.model().outputs)
        there = study.plant.model()
        walk = _of_plant(states, there.states, plant.process_noise, believed.process_noise)
        noise = _of_plant(outputs, tuple(there.outputs), plant.measurement_noise, believed.measurement_noise)
        sample = np.arange(len(batch.truth))[:, None]
        since = max(1, round(study.score_after / study.plant.step))
        mean = np.reshape(first_state(model.model, values, compiled.drives[unit.drive].profile), (model.nx, -1))
        return cls(
            runs=len(cases),
            truth=batch.truth,
            measurements=compiled.measured(batch.measurements),
            inputs=compiled.known(unit.drive, batch),
            constants=model.constants(values),
            walk=walk,
            noise=noise,
            mean=np.ascontiguousarray(np.broadcast_to(mean, (model.nx, LANES)), dtype=float),
            first=compiled.first_variance(np.ascontiguousarray(walk.T)).T,
            scored=(sample >= since) & (sample < batch.left_at),
        )

    def rmse(self, squares: Floats) -> Floats:
        """Return the root of the mean over runs and samples scored of squares ``(samples, LANES, targets)``."""
        with np.errstate(invalid="ignore"):
            mean = np.where(self.scored[:, :, None], squares, 0.0).sum(axis=0) / self.scored.sum(axis=0)[:, None]
        return np.asarray(np.sqrt(mean[: self.runs].mean(axis=0)))


def _true_values(evaluator: StudyEvaluator, plant: Floats, believed: Floats) -> Floats:
    """Return the belief's parameters with the vehicle's values, but for those that are among the states."""
    study = evaluator.study
    uncertain = {s.name: s.believed for s in study.belief.parameter_states}
    loads = {n: v for n, v in uncertain.items() if n in loading_parameters(study.belief.vehicle)}
    kept = {*uncertain, *(settled(study.belief.vehicle, study.belief.values, loads) if loads else ())}
    names, found = study.plant.model().parameter_names, believed.copy()
    for i, name in enumerate(study.belief.model().parameter_names):
        if name in names and name not in kept:
            found[:, i] = plant[:, names.index(name)]
    return found


def _of_plant(names: tuple[str, ...], there: tuple[str, ...], plant: Floats, believed: Floats) -> Floats:
    """Return variances ``(runs, names)`` of the vehicle, and the belief's where the vehicle has none of that name."""
    columns = [plant[:, there.index(n)] if n in there else believed[:, i] for i, n in enumerate(names)]
    return np.stack(columns, axis=1)
