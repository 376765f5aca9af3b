"""A fit judged on recordings, and the files that keep it: parameter set, ``identify.json``, drives over time."""

from __future__ import annotations

import json
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.files import write_files
from harness.common.series import packed
from harness.common.statistics import grows
from harness.config.parameter_set import set_text
from harness.identification.axles import axle_estimates
from harness.identification.candidates import Candidates, Each, for_each
from harness.identification.contract import Estimate, Fit, Problem
from harness.identification.data import DriveData
from harness.identification.filtered_model import FilteredModel, FilterRun
from harness.identification.free_run import blocks, found_start
from harness.identification.posterior_study import STUDY, posterior_study
from harness.identification.whiteness import Whiteness, whiteness
from harness.models.assembly.model import StateSpaceModel
from harness.models.quantities import listed, words
from harness.models.signals import SIGNALS


@dataclass(frozen=True)
class DriveJudgement:
    """One model on one recording.

    Attributes:
        drive: The recording.
        simulated: Outputs of the free run over the inputs ``(samples, ny)``; NaN in the first block, behind which it
            begins in the state of the filter, and from where it left the range in which the equations hold.
        simulation_error: Root mean square of measurement minus that ``(ny,)``.
        one_step_error: Root mean square of the innovations ``(ny,)``.
        log_likelihood: Of the recording.
        whiteness: Of each output's whitened innovations.
    """

    drive: DriveData
    simulated: Floats
    simulation_error: Floats
    one_step_error: Floats
    log_likelihood: float
    whiteness: tuple[Whiteness, ...]

    @property
    def stays(self) -> bool:
        """Whether the free run stays in the range in which the equations hold."""
        return stays(self.simulated)


def stays(simulated: Floats) -> bool:
    """Whether a free run ``(samples, ny)`` stays in the range in which the equations hold."""
    return bool(np.isfinite(simulated[-1]).all())


def judged_on(model: FilteredModel, drives: Sequence[DriveData], points: Each) -> tuple[DriveJudgement, ...]:
    """Judge a model on every recording.

    Args:
        model: The filter.
        drives: The recordings.
        points: One candidate, or one for each recording.
    """
    each = for_each(points, drives)
    runs = model.runs(drives, each)

    def of_drive(i: int) -> DriveJudgement:
        start = found_start(model.model, drives[i], runs[i].state)
        return _judged(drives[i], model.free_run(drives[i], each[i].values[:, 0], start).outputs, runs[i])

    return tuple(model.share(of_drive, range(len(drives))))


def _judged(drive: DriveData, simulated: Floats, run: FilterRun) -> DriveJudgement:
    return DriveJudgement(
        drive,
        simulated,
        rms(drive.measurements - simulated),
        rms(run.innovation),
        run.log_likelihood,
        tuple(whiteness(column) for column in run.whitened[1:].T),
    )


def rms(errors: Floats) -> Floats:
    """Return the root mean square of each column; NaN only where nothing is left."""
    count = np.isfinite(errors).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(np.nansum(errors**2, axis=0) / count))


@dataclass(frozen=True)
class Judged:
    """One recording against the model before and after the fit.

    Attributes:
        held_out: Whether it was not fitted.
        before: The model before the fit.
        after: The model after it.
    """

    held_out: bool
    before: DriveJudgement
    after: DriveJudgement

    @property
    def drive(self) -> DriveData:
        """The recording."""
        return self.after.drive

    @property
    def free(self) -> Floats:
        """Simulated outputs over the inputs, before and after ``(2, samples, ny)``."""
        return np.array([self.before.simulated, self.after.simulated])

    @property
    def free_error(self) -> Floats:
        """Root mean square of measurement minus that ``(2, ny)``."""
        return np.array([self.before.simulation_error, self.after.simulation_error])

    @property
    def one_step_error(self) -> Floats:
        """Root mean square of the innovations before and after ``(2, ny)``."""
        return np.array([self.before.one_step_error, self.after.one_step_error])

    @property
    def log_likelihood(self) -> Floats:
        """Before and after ``(2,)``."""
        return np.array([self.before.log_likelihood, self.after.log_likelihood])

    @property
    def whiteness(self) -> tuple[Whiteness, ...]:
        """Of each output's whitened innovations after the fit."""
        return self.after.whiteness


def judge(problem: Problem, fit: Fit, held_out: tuple[DriveData, ...] = ()) -> list[Judged]:
    """Judge the fit on the fitted and on the held-out recordings."""
    innovations, judged = problem.innovations, []
    for drives, kept_aside in ((problem.drives, False), (held_out, True)):
        before, after = (judged_on(innovations, drives, Candidates.of(s)) for s in (innovations.spec, fit.spec))
        judged += [Judged(kept_aside, *pair) for pair in zip(before, after, strict=True)]
    return judged


def failure(judged: Sequence[Judged]) -> str:
    """Return in a sentence why a fit failed; empty if it did not.

    It failed if the simulation error of the drives that were kept aside is larger with it than before, or leaves the
    range in which the equations hold where it did not before. Where none was kept aside the fitted drives count.
    """
    kept = [j for j in judged if j.held_out]
    which, drives = ("kept aside", kept) if kept else ("fitted", list(judged))
    if not drives:
        return ""
    lost = [j.drive.name for j in drives if j.before.stays and not j.after.stays]
    if lost:
        return (
            f"The fit failed: with it the simulation leaves the range in which the equations hold on {', '.join(lost)}."
        )
    errors = [[j.drive.measurements - s for s in j.free] for j in drives]
    power = np.nanmean(np.concatenate([before for before, _ in errors]) ** 2, axis=0)
    growth = np.concatenate([_growth(j.drive, e, power) for j, e in zip(drives, errors, strict=True)])
    if not grows(growth):
        return ""
    factor = math.sqrt(1.0 + float(np.mean(growth[np.isfinite(growth)])))
    return (
        f"The fit failed: with it the simulation error of the drives that were {which} is {factor:.3g} times what it "
        "was before. Do not use its values."
    )


def _growth(drive: DriveData, errors: Sequence[Floats], power: Floats) -> Floats:
    """Return by how much the squared simulation error grows in blocks of a drive, over its mean, of all outputs."""
    with np.errstate(invalid="ignore", divide="ignore"):
        grown = (errors[1] ** 2 - errors[0] ** 2) / power
    parts = [p[np.isfinite(p)] for p in np.array_split(grown, blocks(drive))]
    return np.array([p.mean() if p.size else np.nan for p in parts])


def answer(fit: Fit, judged: Sequence[Judged] = ()) -> str:
    """Return the result in sentences; the first says so if the fit failed on the drives by which it is ``judged``."""
    planned = "" if fit.planned is None else fit.planned["words"]
    return " ".join(sentence for sentence in (failure(judged), _counted(fit), planned, _coloured(fit)) if sentence)


def _counted(fit: Fit) -> str:
    """Return how many parameters the recordings determine."""
    parameters = [e for e in fit.estimates if e.name in fit.spec.values]
    judged = [e for e in parameters if e.verdict is not None]
    if not judged:
        return f"{len(parameters)} parameters were fitted; the method states no uncertainty."
    counts = [
        (sum(e.verdict == verdict for e in judged), text)
        for verdict, text in (
            ("determined", "determined"),
            ("weakly determined", "only weakly"),
            ("confounded", "only in combination with others"),
            ("not determined", "not at all"),
            ("at its bound", "at a bound"),
        )
    ]
    phrases = ", ".join(f"{count} {text}" for count, text in counts if count)
    return f"Of {len(judged)} parameters the recordings leave {phrases}."


def _coloured(fit: Fit) -> str:
    """Return what coloured innovations do to the estimates; empty if nothing."""
    if not fit.coloured:
        return ""
    widest = max(e.widened for e in fit.estimates if e.name in fit.spec.values)
    return (
        f"The innovations of {listed([words(n) for n in fit.coloured])} are coloured: the model lacks something. The "
        f"intervals are up to {widest:.2g} times as wide for it, and hold only if that does not depend on the inputs. "
        "Try an effect, or harness trace."
    )


def parameter_file(fit: Fit, source: str, warning: str = "") -> str:
    """Return the text of a parameter set with what was found, which studies load by its path."""
    return set_text(fit.spec, source, {e.name: _comment(e) for e in fit.estimates}, warning=warning)


def _comment(estimate: Estimate) -> str:
    error = "" if not math.isfinite(estimate.error) else f" +- {estimate.error:.3g}"
    verdict = "" if estimate.verdict is None else f"; {estimate.verdict}"
    return f"{estimate.unit}{error}{verdict}"


def record(fit: Fit, judged: list[Judged]) -> dict[str, Any]:
    """Return the fit as ``identify.json`` holds it; numbers in SI units, what is not finite as ``null``."""
    outputs = list(fit.spec.model().outputs)
    return {
        "method": fit.method,
        "model": fit.spec.model().name,
        "converged": fit.converged,
        "failed": failure(judged) or None,
        "answer": answer(fit, judged),
        "coloured_outputs": list(fit.coloured),
        "objective": {"name": fit.objective, "before": _number(fit.before), "after": _number(fit.after)},
        "estimates": [
            {
                "name": e.name,
                "unit": e.unit,
                "start": _number(e.start),
                "value": _number(e.value),
                "standard_error": _number(e.error),
                "interval_95": [_number(e.lower), _number(e.upper)],
                "widened_by_colour": _number(e.widened),
                "verdict": e.verdict,
                "reason": e.reason,
            }
            for e in fit.estimates
        ],
        "axles": [
            {
                "name": a.name,
                "unit": a.unit,
                "start": _number(a.start),
                "value": _number(a.value),
                "standard_error": _number(a.error),
            }
            for a in axle_estimates(fit)
        ],
        "correlation": [[_number(c) for c in row] for row in fit.correlation],
        "drives": [
            {
                "name": j.drive.name,
                "held_out": j.held_out,
                "log_likelihood": _pair(j.log_likelihood),
                "outputs": {
                    name: {
                        "unit": SIGNALS[name].unit if name in SIGNALS else "",
                        "free_running_rmse": _pair(j.free_error[:, a]),
                        "one_step_rmse": _pair(j.one_step_error[:, a]),
                        "variance_of_whitened_innovations": _number(j.whiteness[a].variance),
                        "ljung_box_p": _number(j.whiteness[a].ljung_box),
                        "cumulative_periodogram_p": _number(j.whiteness[a].periodogram),
                    }
                    for a, name in enumerate(outputs)
                },
            }
            for j in judged
        ],
        "history": [_number(v) for v in fit.history],
        "notes": list(fit.notes),
        "asked": dict(fit.asked),
        "after": fit.planned,
        **fit.further,
    }


def _number(value: float) -> float | None:
    return float(value) if math.isfinite(value) else None


def _pair(values: Floats) -> dict[str, float | None]:
    return {"before": _number(values[0]), "after": _number(values[1])}


def write_outcome(folder: Path, fit: Fit, judged: list[Judged], source: str) -> list[Path]:
    """Write the parameter set and ``identify.json`` and return their paths.

    Raises:
        UserError: If the folder cannot be written to.
    """
    contents = {
        "parameters.toml": parameter_file(fit, source, failure(judged)),
        "identify.json": json.dumps(record(fit, judged), indent=2) + "\n",
    }
    fitted = [j.drive for j in judged if not j.held_out]
    errors = [(e.name, e.error) for e in fit.estimates if e.name in fit.spec.values]
    coloured = f"The innovations of {listed([words(n) for n in fit.coloured])} are coloured" if fit.coloured else ""
    if not failure(judged) and (text := posterior_study(fit.spec, "parameters.toml", errors, fitted, coloured)):
        contents[STUDY] = text
    return write_files(folder, contents)


FILE = "drives.npz"
"""Next to ``identify.json`` and ``trace.json``; ``harness.common.series`` reads it."""

MEASURED, BEFORE, AFTER = "measured", "before", "after"
"""Before the name of an output: as measured, and as the model before and after simulates it over the inputs."""


def series_of(judged: Sequence[Judged], model: StateSpaceModel) -> bytes:
    """Return ``drives.npz``: of each recording ``time``, each output as measured, before and after, ``x`` and ``y``.

    The path is dead reckoning by the recorded speed and yaw rate, in m from the start, and is there where both are.

    Args:
        judged: The recordings, each judged before and after.
        model: Whose inputs and outputs they have.
    """
    series = {}
    for j in judged:
        columns = {"time": j.drive.time}
        for a, name in enumerate(model.outputs):
            columns[f"{MEASURED} {name}"] = j.drive.measurements[:, a]
            columns[f"{BEFORE} {name}"], columns[f"{AFTER} {name}"] = j.free[:, :, a]
        series[j.drive.name] = columns | _path(j.drive, model)
    return packed(series)


def _path(drive: DriveData, model: StateSpaceModel) -> dict[str, Floats]:
    signals = {name: drive.inputs[:, i] for i, name in enumerate(model.inputs)}
    signals |= {name: drive.measurements[:, i] for i, name in enumerate(model.outputs)}
    speed = next((signals[n] for n in ("speed", "longitudinal_velocity") if n in signals), None)
    rate = next((v for n, v in signals.items() if n.startswith("yaw_rate")), None)
    if speed is None or rate is None:
        return {}
    speed, rate = _filled(speed), _filled(rate)
    if speed is None or rate is None:
        return {}
    step = np.diff(drive.time, prepend=drive.time[0])
    heading = np.cumsum(rate * step)
    return {"x": np.cumsum(speed * np.cos(heading) * step), "y": np.cumsum(speed * np.sin(heading) * step)}


def _filled(values: Floats) -> Floats | None:
    """Return values with gaps bridged by lines; ``None`` where there is nothing."""
    there = np.flatnonzero(np.isfinite(values))
    return np.interp(np.arange(len(values)), there, values[there]) if there.size else None
