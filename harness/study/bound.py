"""How good could anyone be? The posterior Cramer-Rao bound along the runs of a study (Tichavsky et al. 1998).

Beside it stands what a smoother reaches on these runs, which knows the vehicle and all measurements of a run.

Along each simulated run the belief's equations, with the parameters of the vehicle, are linearised at the true states;
process and measurement noise are the vehicle's, the random walk of an unknown input is the belief's. What the recursion
of the information leaves uncertain of a target is the smallest mean square error of any estimator that knows the
vehicle. The theorem takes the expectation of the slopes over runs; here each run has its own recursion, and the mean is
taken of the squares: the same on a linear model, and a little more on any other.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import write_files
from harness.engine.simd.lanes import LANES
from harness.estimation.information import smallest_covariance
from harness.study.bound_file import FILE, Bounds, content_of
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.known_runs import KnownRuns
from harness.study.smoothed import smoothed_rmse


def write(evaluator: StudyEvaluator, folder: Path) -> None:
    """Compute the bounds of a study and write them beside its scores, where they are not there yet."""
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
    study, found = evaluator.study, {}
    for index, design in enumerate(study.designs):
        if design.sampling != "sobol":
            continue
        per_band = []
        for band in range(design.bands):
            units = [Unit(index, band, drive, 0, design.samples) for drive in range(len(study.drives))]
            per_band.append(np.median([rmse_of(evaluator, unit) for unit in units], axis=0))
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
    known = KnownRuns.of_unit(evaluator, unit)
    states, names = evaluator.compiled.belief.model.states, evaluator.compiled.truth_names
    lacking = [s for s in states if s not in names]
    if lacking:
        raise UserError(
            f"{evaluator.study.path}: report.bound: the plant has no state '{lacking[0]}', so there is no bound"
        )
    truth = np.ascontiguousarray(known.truth[:, [names.index(s) for s in states]])
    transitions, slopes, of_targets = _linearised(evaluator, truth, known.inputs, known.constants)
    diagonal = [v[:, :, None] * np.eye(v.shape[1]) for v in (known.walk, known.noise, known.first)]
    covariance = smallest_covariance(transitions, slopes, *diagonal)
    return known.rmse(np.einsum("klti,klij,kltj->klt", of_targets, covariance, of_targets))


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
