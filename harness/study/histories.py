"""The runs that a study wants drawn over time, run once more with everything kept."""

from __future__ import annotations

import numpy as np
import xarray as xr

from harness.config import HistorySpec
from harness.runner.contract import Batch
from harness.runner.scores import Scores
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case


def histories(evaluator: StudyEvaluator) -> list[xr.Dataset]:
    """Return the runs a study wants drawn over time.

    Where the plant lacks a signal its truth is NaN; so is an estimate from its divergence on, and everything from
    where the plant leaves its range.
    """
    return [_history(evaluator, wanted) for wanted in evaluator.study.history]


def _history(evaluator: StudyEvaluator, wanted: HistorySpec) -> xr.Dataset:
    study, compiled = evaluator.study, evaluator.compiled
    names = [d.name for d in study.drives]
    design = next(i for i, d in enumerate(study.designs) if d.name == wanted.design)
    unit = Unit(design, wanted.band, names.index(wanted.drive), wanted.sample, wanted.sample + 1)
    case = [Case(wanted.sample, wanted.repeat)]
    batch, believed = evaluator.simulate(unit, case), evaluator.held(unit, case, "belief")
    runs = [evaluator.estimate(e, unit, case, batch, believed, keep=True) for e in range(len(compiled.estimators))]
    shown = list(dict.fromkeys([*study.targets, *study.belief.unknown_inputs, *wanted.signals]))
    truth, kept, gone = _over_time(evaluator, shown, batch, runs)
    drive = compiled.drives[unit.drive]
    dataset = xr.Dataset(
        {
            "truth": (("time", "target"), truth),
            "estimate": (("time", "estimator", "target"), kept[:, :, 0]),
            "std": (("time", "estimator", "target"), kept[:, :, 1]),
        },
        coords={
            "time": drive.profile.time,
            "estimator": [e.name for e in study.estimators],
            "target": shown,
        },
    )
    measurements = compiled.measured(batch.measurements)
    for i, output in enumerate(compiled.belief.model.outputs):
        if output in shown:  # sensors name an output after what it measures
            values = np.where(gone, np.nan, measurements[:, i, 0])
            dataset[f"measured_{output}"] = ("time", values, {"variance": believed.measurement_noise[i, 0]})
    stated = [e.has_covariance for e in compiled.estimators]
    dataset["std"] = dataset["std"].where(xr.DataArray(stated, dims="estimator"))
    for i, name in enumerate(evaluator.study.plant.model().inputs):
        dataset[f"input_{name}"] = ("time", drive.plant[:, i, 0])
    rmse = {
        e.name: {t: float(r.rmse[i, 0]) for i, t in enumerate(study.targets)}
        for e, r in zip(study.estimators, runs, strict=True)
    }
    dataset.attrs = {
        "name": wanted.name,
        "design": wanted.design,
        "band_label": study.designs[design].band_labels[wanted.band],
        "drive": wanted.drive,
        "repeat": wanted.repeat,
        "rmse": rmse,
    }
    return dataset


def _over_time(
    evaluator: StudyEvaluator, shown: list[str], batch: Batch, runs: list[Scores]
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return truth ``(samples, shown)``, estimates and deviations ``(samples, estimator, 2, shown)``, and what is gone.

    The last is true from the sample on at which the plant leaves its range.
    """
    compiled = evaluator.compiled
    truth = np.full((len(batch.truth), len(shown)), np.nan)
    for i, name in enumerate(shown):
        if name in compiled.truth_names:
            truth[:, i] = batch.truth[:, compiled.truth_names.index(name), 0]
    places = [compiled.signals.index(name) for name in shown]
    kept = np.stack([r.kept[:, :, places, 0] for r in runs if r.kept is not None], axis=1)
    sample = np.arange(len(kept))[:, None]
    gone = sample[:, 0] >= batch.left_at[0]
    kept[(sample >= [r.diverged_at[0] for r in runs]) | gone[:, None]] = np.nan
    truth[gone] = np.nan
    return truth, kept, gone
