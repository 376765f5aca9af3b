"""A run that was computed again as a Dataset over time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from harness.common.arrays import Floats
from harness.models.signals import signal_attributes
from harness.runner.contract import Batch, Held
from harness.runner.scores import Scores
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator


@dataclass(frozen=True)
class OverTime:
    """What one estimator held in a run.

    Attributes:
        scores: Of the run; ``kept`` are the signals of the study.
        mean: ``(samples, nx)``; this and what follows is ``None`` where it was not asked for.
        covariance: ``(samples, nx, nx)``.
        innovation: ``(samples, ny)``; NaN at the first sample, as is what follows.
        spread: Variance of the innovation that is stated ``(samples, ny)``.
        facts: NIS, and number of measurements in it, ``(samples, 2)``.
    """

    scores: Scores
    mean: Floats | None = None
    covariance: Floats | None = None
    innovation: Floats | None = None
    spread: Floats | None = None
    facts: Floats | None = None


def dataset(
    evaluator: StudyEvaluator, unit: Unit, batch: Batch, believed: Held, runs: Mapping[int, OverTime]
) -> xr.Dataset:
    """Return truth and estimates of a run over time, in SI units.

    Args:
        evaluator: Of the study.
        unit: The run.
        batch: As simulated; the first lane counts.
        believed: What the belief held.
        runs: What each estimator held, by its index in the study.

    Returns:
        Dataset over ``time`` (s), ``estimator``, ``target`` (the signals of the study, then the other states of the
        belief) and ``output``: ``truth (time, target)``; ``estimate`` and ``std (time, estimator, target)``;
        ``measured_<output>`` and ``input_<name>`` over time; and where they were kept ``innovation`` and
        ``innovation_std (time, estimator, output)``, ``nis`` and ``nees (time, estimator)``. NaN is what the plant does
        not have, what an estimator does not give, an estimate from its divergence on, and everything from where the
        plant leaves its range. The coordinate ``target_unit`` has the unit of each target.
    """
    compiled, study = evaluator.compiled, evaluator.study
    states = [s for s in compiled.belief.model.states if s not in compiled.belief.model.within]
    whole = any(run.mean is not None for run in runs.values())
    shown = list(dict.fromkeys([*compiled.signals, *(states if whole else [])]))
    samples, ended = len(batch.truth), np.arange(len(batch.truth))
    gone = ended >= batch.left_at[0]
    truth = np.full((samples, len(shown)), np.nan)
    for i, name in enumerate(shown):
        if name in compiled.truth_names:
            truth[:, i] = np.where(gone, np.nan, batch.truth[:, compiled.truth_names.index(name), 0])
    drive, outputs = compiled.drives[unit.drive], list(compiled.belief.model.outputs)
    names = [study.estimators[e].name for e in runs]
    columns: dict[str, Any] = {"truth": (("time", "target"), truth)}
    columns |= _estimates(shown, evaluator, gone, runs)
    measured = compiled.measured(batch.measurements)
    for i, name in enumerate(outputs):
        about = {"units": signal_attributes(name)["units"], "variance": believed.measurement_noise[i, 0]}
        columns[f"measured_{name}"] = ("time", np.where(gone, np.nan, measured[:, i, 0]), about)
    for i, name in enumerate(evaluator.study.plant.model().inputs):
        columns[f"input_{name}"] = ("time", drive.plant[:samples, i, 0], {"units": signal_attributes(name)["units"]})
    if whole:
        columns |= _innovations(evaluator, batch, gone, runs)
    return xr.Dataset(
        columns,
        coords={
            "time": ("time", drive.profile.time[:samples], {"units": "s", "long_name": "time"}),
            "estimator": names,
            "target": shown,
            "target_unit": ("target", [signal_attributes(n)["units"] or "1" for n in shown]),
            "output": outputs,
        },
    )


def _estimates(
    shown: list[str], evaluator: StudyEvaluator, gone: np.ndarray, runs: Mapping[int, OverTime]
) -> dict[str, Any]:
    """Return estimates with their standard deviations, those of the study's signals as they were scored."""
    compiled = evaluator.compiled
    estimates = np.full((2, len(gone), len(runs), len(shown)), np.nan)
    states = compiled.belief.model.states
    for column, (e, run) in enumerate(runs.items()):
        estimator = compiled.estimators[e]
        assert run.scores.kept is not None
        for i, name in enumerate(shown):
            if name in compiled.signals:
                estimates[:, :, column, i] = run.scores.kept[:, :, compiled.signals.index(name), 0].T
            elif run.mean is not None and run.covariance is not None and estimator.gives.all():
                at = states.index(name)
                variance = run.covariance[:, at, at]
                estimates[:, :, column, i] = run.mean[:, at], np.sqrt(np.where(variance < 0.0, 0.0, variance))
        estimates[:, _ended(gone, run), column] = np.nan
        if not estimator.has_covariance:
            estimates[1, :, column] = np.nan
    return {n: (("time", "estimator", "target"), v) for n, v in zip(("estimate", "std"), estimates, strict=True)}


def _innovations(
    evaluator: StudyEvaluator, batch: Batch, gone: np.ndarray, runs: Mapping[int, OverTime]
) -> dict[str, Any]:
    """Return innovations, NIS and NEES, of estimators that state a covariance."""
    compiled, outputs = evaluator.compiled, len(evaluator.compiled.belief.model.outputs)
    innovation, spread = np.full((2, len(gone), len(runs), outputs), np.nan)
    nis, nees = np.full((2, len(gone), len(runs)), np.nan)
    rows = [compiled.truth_names.index(s) for s in compiled.belief.model.states if s in compiled.truth_names]
    comparable = len(rows) == compiled.belief.nx
    for column, (e, run) in enumerate(runs.items()):
        if run.innovation is None or not compiled.estimators[e].has_covariance:
            continue
        assert run.mean is not None
        assert run.covariance is not None
        assert run.spread is not None
        assert run.facts is not None
        innovation[:, column], spread[:, column] = run.innovation, np.sqrt(np.maximum(run.spread, 0.0))
        nis[:, column] = np.where(run.facts[:, 1] > 0, run.facts[:, 0], np.nan)
        ended = _ended(gone, run)
        if comparable:
            nees[~ended, column] = _nees(run.mean[~ended] - batch.truth[~ended][:, rows, 0], run.covariance[~ended])
        for each in (innovation, spread, nis):
            each[ended, column] = np.nan
    whole, each_run = ("time", "estimator", "output"), ("time", "estimator")
    return {
        "innovation": (whole, innovation),
        "innovation_std": (whole, spread),
        "nis": (each_run, nis, {"units": "1", "expected": outputs}),
        "nees": (each_run, nees, {"units": "1", "expected": compiled.belief.nx}),
    }


def _ended(gone: np.ndarray, run: OverTime) -> np.ndarray:
    """Return where there is nothing more of an estimator."""
    ended: np.ndarray = gone | (np.arange(len(gone)) >= run.scores.diverged_at[0])
    return ended


def _nees(errors: Floats, covariances: Floats) -> Floats:
    """Return errors squared, weighed with their covariance, at every sample; NaN where that has no inverse."""
    scale = np.sqrt(np.maximum(np.einsum("kii->ki", covariances), 1e-300))
    with np.errstate(over="ignore", invalid="ignore"):
        unit, whole = covariances / scale[:, :, None] / scale[:, None, :], errors / scale
    lost = ~(np.isfinite(unit).all(axis=(1, 2)) & np.isfinite(whole).all(axis=1))
    unit[lost], whole[lost] = np.eye(unit.shape[1]), np.nan
    try:
        solved = np.linalg.solve(unit, whole[:, :, None])[:, :, 0]
    except np.linalg.LinAlgError:
        solved = np.einsum("kij,kj->ki", np.linalg.pinv(unit, hermitian=True), whole)
    nees: Floats = np.einsum("ki,ki->k", whole, solved)
    return np.where(nees >= 0.0, nees, np.nan)


def table(data: xr.Dataset) -> pd.DataFrame:
    """Return a run as a table over time, SI units, for a file that other programs read.

    Columns: ``time``, ``input_<name>``, ``measured_<output>``, ``truth_<target>``, and behind the name of each
    estimator ``estimate_<target>``, ``std_<target>``, ``innovation_<output>``, ``innovation_std_<output>``, ``nis``
    and ``nees``, as far as they are there.
    """
    columns: dict[str, Floats] = {"time": data["time"].values}
    columns |= {str(n): data[n].values for n in data if str(n).startswith(("input_", "measured_"))}
    columns |= {f"truth_{t}": data["truth"].sel(target=t).values for t in data["target"].values}
    for estimator in data["estimator"].values:
        own = data.sel(estimator=estimator)
        for name in ("estimate", "std", "innovation", "innovation_std"):
            if name in own:
                other = own[name].dims[1]
                columns |= {f"{estimator} {name}_{k}": own[name].sel({other: k}).values for k in own[other].values}
        columns |= {f"{estimator} {name}": own[name].values for name in ("nis", "nees") if name in own}
    return pd.DataFrame({name: values for name, values in columns.items() if not np.isnan(values).all()})
