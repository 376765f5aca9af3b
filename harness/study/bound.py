"""How good could anyone be? The posterior Cramer-Rao bound along the runs of a study (Tichavsky et al. 1998).

Along each simulated run the belief's equations, with the parameters of the vehicle, are linearised at the true states;
process and measurement noise are the vehicle's, the random walk of an unknown input is the belief's. What the recursion
of the information leaves uncertain of a target is the smallest mean square error of any estimator that knows the
vehicle. The theorem takes the expectation of the slopes over runs; here each run has its own recursion, and the mean is
taken of the squares: the same on a linear model, and a little more on any other.

With it comes what a smoother reaches on these runs, which knows the vehicle and all measurements of a run: an
extended Kalman filter with the vehicle's parameters and noise runs forwards; backwards the innovations behind each
sample correct its estimate, in the form of Bierman (1977), which needs no inverse of a predicted covariance:
``l_k = A_k' (C_k+1' l_k+1 - H_k+1' S_k+1^-1 e_k+1)`` with ``C = I - K H``, and the smoothed state is ``x_k - P_k l_k``.
On a linear model it is the fixed-interval smoother of Rauch, Tung and Striebel.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import write_files
from harness.config.bounds import loading_parameters, settled_load
from harness.engine.simd.lanes import LANES
from harness.estimation.information import smallest_covariance
from harness.simulation.simulate import first_state
from harness.study.bound_file import FILE, Bounds, content_of
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case


@dataclass(frozen=True)
class KnownRuns:
    """The first runs of a unit as somebody sees them who knows the vehicle: its parameters and noise in the belief.

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
        batch, plant = evaluator.simulate(unit, cases), evaluator.held(unit, cases, "plant")
        believed, model = evaluator.held(unit, cases, "belief"), compiled.belief
        values = _true_values(evaluator, plant.values.T, believed.values.T).T
        states, outputs = model.model.states, tuple(study.belief.model().outputs)
        there = study.plant.model()
        walk = _of_plant(states, there.states, plant.process_noise.T, believed.process_noise.T)
        noise = _of_plant(outputs, tuple(there.outputs), plant.measurement_noise.T, believed.measurement_noise.T)
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


def write(evaluator: StudyEvaluator, folder: Path) -> None:
    """Compute the bounds of a study and write them next to its scores, where they are not there yet."""
    kept = content_of(folder)
    if kept.get("study_hash") != evaluator.study.hash or "smoothed" not in kept:
        content = {
            "study_hash": evaluator.study.hash,
            "rmse": of_study(evaluator, smallest_rmse),
            "smoothed": of_study(evaluator, smoothed_rmse),
        }
        write_files(folder, {FILE: json.dumps(content, indent=1) + "\n"})


def of_study(evaluator: StudyEvaluator, rmse_of: Callable[[StudyEvaluator, Unit], Floats]) -> Bounds:
    """Return the median over the drives of an RMSE, for each band of the designs by level.

    Args:
        evaluator: Of the study.
        rmse_of: Returns the RMSE of each target over a unit, SI.
    """
    study, bounds = evaluator.study, {}
    for index, design in enumerate(study.designs):
        if design.sampling != "sobol":
            continue
        per_band = []
        for band in range(design.bands):
            units = [Unit(index, band, drive, 0, design.samples) for drive in range(len(study.drives))]
            per_band.append(np.median([rmse_of(evaluator, unit) for unit in units], axis=0))
        table = np.array(per_band).T
        bounds[design.name] = {
            t: [float(v) if np.isfinite(v) else None for v in row] for t, row in zip(study.targets, table, strict=False)
        }
    return bounds


def smallest_rmse(evaluator: StudyEvaluator, unit: Unit) -> Floats:
    """Return the smallest RMSE of each target over the first runs of a unit, at most as many as there are lanes, SI.

    Raises:
        UserError: If the truth of a state of the belief is not known.
    """
    runs = KnownRuns.of_unit(evaluator, unit)
    states, names = evaluator.compiled.belief.model.states, evaluator.compiled.truth_names
    lacking = [s for s in states if s not in names]
    if lacking:
        raise UserError(
            f"{evaluator.study.path}: report.bound: the plant has no state '{lacking[0]}', so there is no bound"
        )
    truth = np.ascontiguousarray(runs.truth[:, [names.index(s) for s in states]])
    transitions, slopes, of_targets = _linearised(evaluator, truth, runs.inputs, runs.constants)
    diagonal = [v[:, :, None] * np.eye(v.shape[1]) for v in (runs.walk, runs.noise, runs.first)]
    covariance = smallest_covariance(transitions, slopes, *diagonal)
    return runs.rmse(np.einsum("klti,klij,kltj->klt", of_targets, covariance, of_targets))


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


def smoothed_rmse(evaluator: StudyEvaluator, unit: Unit) -> Floats:
    """Return the RMSE of each target over the first runs of a unit, at most as many as there are lanes, SI."""
    runs, compiled = KnownRuns.of_unit(evaluator, unit), evaluator.compiled
    targets = evaluator.study.targets
    states = smoothed(evaluator, runs)
    s = np.empty((len(compiled.signals), LANES))
    rows = [compiled.truth_names.index(t) if t in compiled.truth_names else None for t in targets]
    squares = np.empty((len(states), LANES, len(targets)))
    for k, x in enumerate(states):
        compiled.belief.kernels.signals(x, runs.inputs[k], runs.constants, s)
        for t, row in enumerate(rows):
            squares[k, :, t] = np.nan if row is None else (s[t] - runs.truth[k, row]) ** 2
    return runs.rmse(squares)


def smoothed(evaluator: StudyEvaluator, runs: KnownRuns) -> Floats:
    """Return the smoothed states ``(samples, nx, LANES)``; what a run measured behind its range does not count."""
    model = evaluator.compiled.belief
    samples, nx, ny = len(runs.inputs), model.nx, model.ny
    A, H = np.empty((nx, nx, LANES)), np.empty((ny, nx, LANES))
    w, y, ahead = np.empty((model.nw, LANES)), np.empty((ny, LANES)), np.empty((nx, LANES))
    Q, R = (v[:, :, None] * np.eye(v.shape[1]) for v in (runs.walk, runs.noise))
    x, P = runs.mean, runs.first[:, :, None] * np.eye(nx)
    means, covariances = np.empty((samples, nx, LANES)), np.empty((samples, LANES, nx, nx))
    back, pull = np.empty((samples, LANES, nx, nx)), np.empty((samples, LANES, nx))
    means[0], covariances[0] = x, P
    last = np.where(runs.scored.any(axis=0), samples - np.argmax(runs.scored[::-1], axis=0), 0)
    for k in range(1, samples):
        model.kernels.next_jacobian(x, runs.inputs[k - 1], runs.constants, ahead, A, w)
        F = np.moveaxis(A, -1, 0)
        P = F @ P @ F.swapaxes(-1, -2) + Q
        model.kernels.output_jacobian(ahead, runs.inputs[k], runs.constants, y, H)
        rest = (runs.measurements[k] - y).T
        seen = np.isfinite(rest) & (k < last)[:, None]
        slopes, rest = np.moveaxis(H, -1, 0) * seen[:, :, None], np.where(seen, rest, 0.0)
        S = slopes @ P @ slopes.swapaxes(-1, -2) + R
        weighed = np.linalg.solve(S, np.concatenate([slopes, rest[:, :, None]], axis=-1))  # S^-1 H and S^-1 e
        K = P @ weighed[:, :, :nx].swapaxes(-1, -2)
        remainder = np.eye(nx) - K @ slopes
        x = np.ascontiguousarray(ahead + np.einsum("lia,la->il", K, rest))
        P = remainder @ P @ remainder.swapaxes(-1, -2) + K @ R @ K.swapaxes(-1, -2)
        means[k], covariances[k] = x, P
        back[k] = F.swapaxes(-1, -2) @ remainder.swapaxes(-1, -2)
        pull[k] = np.einsum("lji,laj,la->li", F, slopes, weighed[:, :, nx])
    behind = np.zeros((LANES, nx))
    for k in range(samples - 1, 0, -1):
        means[k] -= np.einsum("lij,lj->il", covariances[k], behind)
        behind = np.einsum("lij,lj->li", back[k], behind) - pull[k]
    means[0] -= np.einsum("lij,lj->il", covariances[0], behind)
    return means


def _true_values(evaluator: StudyEvaluator, plant: Floats, believed: Floats) -> Floats:
    """Return the belief's parameters with the vehicle's values, but for those that are among the states."""
    study = evaluator.study
    uncertain = {s.name: s.believed for s in study.belief.parameter_states}
    loads = {n: v for n, v in uncertain.items() if n in loading_parameters(study.belief.vehicle)}
    kept = {*uncertain, *(settled_load(study.belief.vehicle, study.belief.values, loads) if loads else ())}
    names, values = study.plant.model().parameter_names, believed.copy()
    for i, name in enumerate(study.belief.model().parameter_names):
        if name in names and name not in kept:
            values[:, i] = plant[:, names.index(name)]
    return values


def _of_plant(names: tuple[str, ...], there: tuple[str, ...], plant: Floats, believed: Floats) -> Floats:
    """Return variances ``(runs, names)`` of the vehicle, and the belief's where the vehicle has none of that name."""
    columns = [plant[:, there.index(n)] if n in there else believed[:, i] for i, n in enumerate(names)]
    return np.stack(columns, axis=1)
