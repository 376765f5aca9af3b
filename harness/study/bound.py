"""How good could anyone be? The posterior Cramer-Rao bound along the runs of a study (Tichavsky et al. 1998).

Along each simulated run the belief's equations, with the parameters of the vehicle, are linearised at the true states;
process and measurement noise are the vehicle's, the random walk of an unknown input is the belief's. What the recursion
of the information leaves uncertain of a target is the smallest mean square error of any estimator that knows the
vehicle. The theorem takes the expectation of the slopes over runs; here each run has its own recursion, and the mean is
taken of the squares: the same on a linear model, and a little more on any other.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import told_as_damaged, write_files
from harness.config.bounds import loading_parameters, settled
from harness.engine.simd.lanes import LANES
from harness.estimation.information import smallest_covariance
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case

FILE = "bound.json"

Bounds = dict[str, dict[str, list[float | None]]]
"""Smallest RMSE in SI units by design, target and band; ``None`` where there is none."""


def write(evaluator: StudyEvaluator, folder: Path) -> None:
    """Compute the bounds of a study and write them beside its scores, where they are not there yet."""
    kept = _stored(folder)
    if kept.get("study_hash") != evaluator.study.hash:
        content = {"study_hash": evaluator.study.hash, "rmse": of_study(evaluator)}
        write_files(folder, {FILE: json.dumps(content, indent=1) + "\n"})


def read(folder: Path, study_hash: str) -> Bounds:
    """Return the bounds in a result folder; none if nothing was written or it is of another study.

    Raises:
        UserError: If the file is damaged.
    """
    kept = _stored(folder)
    return kept["rmse"] if kept.get("study_hash") == study_hash else {}


def _stored(folder: Path) -> dict[str, Any]:
    path = folder / FILE
    if not path.is_file():
        return {}
    with told_as_damaged(path, "JSON text", "delete it: 'harness run' computes it again"):
        found: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(found, dict) or not isinstance(found.get("rmse"), dict):
            raise ValueError("holds no table 'rmse'")
        return found


def of_study(evaluator: StudyEvaluator) -> Bounds:
    """Return the median over the drives of the smallest RMSE, for each band of the designs by level."""
    study, found = evaluator.study, {}
    for index, design in enumerate(study.designs):
        if design.sampling != "sobol":
            continue
        per_band = []
        for band in range(design.bands):
            units = [Unit(index, band, drive, 0, design.samples) for drive in range(len(study.drives))]
            per_band.append(np.median([smallest_rmse(evaluator, unit) for unit in units], axis=0))
        table = np.array(per_band).T
        found[design.name] = {
            t: [float(v) if np.isfinite(v) else None for v in row] for t, row in zip(study.targets, table, strict=False)
        }
    return found


def smallest_rmse(evaluator: StudyEvaluator, unit: Unit) -> Floats:
    """Return the smallest RMSE of each target over the first runs of a unit, at most as many as there are lanes, SI.

    Raises:
        UserError: If the truth of a state of the belief is not known.
    """
    study, compiled = evaluator.study, evaluator.compiled
    repeats = range(study.designs[unit.design].repeats)
    cases = [Case(s, r) for s in range(unit.first, unit.stop) for r in repeats][:LANES]
    batch, plant = evaluator.simulate(unit, cases), evaluator.parameters(unit, cases, "plant")
    believed = evaluator.parameters(unit, cases, "belief")
    states = compiled.belief.model.states
    lacking = [s for s in states if s not in compiled.truth_names]
    if lacking:
        raise UserError(f"{study.path}: report.bound: the plant has no state '{lacking[0]}', so there is no bound")
    truth = np.ascontiguousarray(batch.truth[:, [compiled.truth_names.index(s) for s in states]])
    constants = compiled.belief.constants(_true_values(evaluator, plant.values, believed.values).T)
    inputs = compiled.known(unit.drive, batch)
    transitions, slopes, of_targets = _linearised(evaluator, truth, inputs, constants)
    walk = _of_plant(states, study.plant.model().states, plant.process_noise, believed.process_noise)
    outputs = tuple(study.belief.model().outputs)
    noise = _of_plant(outputs, tuple(study.plant.model().outputs), plant.measurement_noise, believed.measurement_noise)
    first = compiled.first_variance(np.ascontiguousarray(walk.T)).T
    diagonal = [v[:, :, None] * np.eye(v.shape[1]) for v in (walk, noise, first)]
    covariance = smallest_covariance(transitions, slopes, *diagonal)
    variance = np.einsum("klti,klij,kltj->klt", of_targets, covariance, of_targets)
    since = max(1, round(study.score_after / study.plant.step))
    sample = np.arange(len(variance))[:, None]
    scored = (sample >= since) & (sample < batch.left_at)
    with np.errstate(invalid="ignore"):
        mean = np.where(scored[:, :, None], variance, 0.0).sum(axis=0) / scored.sum(axis=0)[:, None]
    return np.asarray(np.sqrt(mean[: len(cases)].mean(axis=0)))


def _linearised(
    evaluator: StudyEvaluator, truth: Floats, inputs: Floats, constants: Floats
) -> tuple[Floats, Floats, Floats]:
    """Return the slopes of next state, outputs and targets at every sample ``(samples, LANES, ..., nx)``."""
    model, targets = evaluator.compiled.belief, len(evaluator.study.targets)
    samples, nx, ny, signals = len(truth), model.nx, model.ny, len(evaluator.compiled.signals)
    a, h, s = (
        np.empty((samples, LANES, nx, nx)),
        np.empty((samples, LANES, ny, nx)),
        np.empty((samples, LANES, targets, nx)),
    )
    ahead, w, y = np.empty((nx, LANES)), np.empty((model.nw, LANES)), np.empty((ny, LANES))
    A, H, S = np.empty((nx, nx, LANES)), np.empty((ny, nx, LANES)), np.empty((signals, nx, LANES))
    for k in range(samples):
        model.kernels.next_jacobian(truth[k], inputs[k], constants, ahead, A, w)
        model.kernels.output_jacobian(truth[k], inputs[k], constants, y, H)
        model.kernels.signals_jacobian(truth[k], inputs[k], constants, S)
        a[k], h[k], s[k] = (np.moveaxis(each, -1, 0) for each in (A, H, S[:targets]))
    return a[:-1], h, s


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
