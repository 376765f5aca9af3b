"""A fit judged on recordings, and the files that keep it: the parameter set and ``identify.json``."""

from __future__ import annotations

import json
import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.files import write_files
from harness.config.parameter_set import set_text
from harness.identification.contract import Estimate, Fit, Problem
from harness.identification.data import Drive
from harness.identification.innovations import Innovations, hold
from harness.identification.whiteness import Whiteness, whiteness
from harness.models.signals import SIGNALS


@dataclass(frozen=True)
class Judged:
    """One recording against the model before and after the fit.

    Attributes:
        drive: The recording.
        held_out: Whether it was kept from the fit.
        free: Outputs of the model alone over the inputs, before and after ``(2, samples, ny)``; NaN from where it left
            the range in which the equations hold.
        free_error: Root mean square of measurement minus that ``(2, ny)``.
        one_step_error: Root mean square of the innovations before and after ``(2, ny)``.
        log_likelihood: Before and after ``(2,)``.
        whiteness: Of each output's whitened innovations after the fit.
    """

    drive: Drive
    held_out: bool
    free: Floats
    free_error: Floats
    one_step_error: Floats
    log_likelihood: Floats
    whiteness: tuple[Whiteness, ...]


def judge(problem: Problem, fit: Fit, held_out: tuple[Drive, ...] = ()) -> list[Judged]:
    """Return what the fit is worth on the recordings it saw and on those it did not see."""
    innovations = problem.innovations
    return [
        _judged(innovations, fit, drive, held)
        for drives, held in ((problem.drives, False), (held_out, True))
        for drive in drives
    ]


def _judged(innovations: Innovations, fit: Fit, drive: Drive, held_out: bool) -> Judged:
    free, runs = [], []
    for held in (hold(innovations.spec), hold(fit.spec)):
        alone = innovations.free_run(drive, held)
        outputs = alone.outputs[:, :, 0].copy()
        outputs[int(alone.left_at[0]) :] = np.nan
        free.append(outputs)
        runs.append(innovations.run(drive, held))
    after = runs[1].whitened[1:]
    return Judged(
        drive=drive,
        held_out=held_out,
        free=np.array(free),
        free_error=np.array([rms(drive.measurements - f) for f in free]),
        one_step_error=np.array([rms(r.innovation) for r in runs]),
        log_likelihood=np.array([r.log_likelihood for r in runs]),
        whiteness=tuple(whiteness(column) for column in after.T),
    )


def rms(errors: Floats) -> Floats:
    """Return the root mean square of each column; NaN only where nothing is left."""
    count = np.isfinite(errors).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(np.nansum(errors**2, axis=0) / count))


def parameter_file(fit: Fit, source: str) -> str:
    """Return the text of a parameter set with what was found, which studies load by its path."""
    return set_text(fit.spec, source, {e.name: _comment(e) for e in fit.estimates})


def _comment(estimate: Estimate) -> str:
    error = "" if not math.isfinite(estimate.error) else f" +- {estimate.error:.3g}"
    verdict = "" if estimate.verdict is None else f"; {estimate.verdict}"
    return f"  # {estimate.unit}{error}{verdict}"


def record(fit: Fit, judged: list[Judged]) -> dict[str, Any]:
    """Return the fit as ``identify.json`` holds it; numbers in SI units, what is not finite as ``null``."""
    outputs = list(fit.spec.model().outputs)
    return {
        "method": fit.method,
        "model": fit.spec.model().name,
        "converged": fit.converged,
        "objective": {"name": fit.objective, "before": _number(fit.before), "after": _number(fit.after)},
        "estimates": [
            {
                "name": e.name,
                "unit": e.unit,
                "start": _number(e.start),
                "value": _number(e.value),
                "standard_error": _number(e.error),
                "interval_95": [_number(e.lower), _number(e.upper)],
                "verdict": e.verdict,
                "reason": e.reason,
            }
            for e in fit.estimates
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
        "parameters.toml": parameter_file(fit, source),
        "identify.json": json.dumps(record(fit, judged), indent=2) + "\n",
    }
    return write_files(folder, contents)
