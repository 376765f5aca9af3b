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
from harness.identification.filtered_model import Candidates
from harness.identification.judgement import DriveJudgement, judged_on
from harness.identification.whiteness import Whiteness
from harness.models.signals import SIGNALS


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
    def drive(self) -> Drive:
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


def judge(problem: Problem, fit: Fit, held_out: tuple[Drive, ...] = ()) -> list[Judged]:
    """Judge the fit on the fitted and on the held-out recordings."""
    innovations, found = problem.innovations, []
    for drives, kept_aside in ((problem.drives, False), (held_out, True)):
        before, after = (judged_on(innovations, drives, Candidates.of(s)) for s in (innovations.spec, fit.spec))
        found += [Judged(kept_aside, *pair) for pair in zip(before, after, strict=True)]
    return found


def parameter_file(fit: Fit, source: str) -> str:
    """Return the text of a parameter set with what was found, which studies load by its path."""
    return set_text(fit.spec, source, {e.name: _comment(e) for e in fit.estimates})


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
