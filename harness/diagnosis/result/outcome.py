"""A trace judged: its verdict, what was found where, and the amended model."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from harness.config import ModelSpec
from harness.diagnosis.fitting.fit import Fitted
from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.residuals.localisation import NOWHERE, Where, where
from harness.diagnosis.residuals.random_process import EXPLAINED, Wandering
from harness.diagnosis.result.answer import answer
from harness.diagnosis.result.estimator_gain import Estimated
from harness.diagnosis.result.fitted_model import fitted_model
from harness.diagnosis.result.study_gain import Worth
from harness.diagnosis.result.verdict import Verdict, final_judgement, strays, verdict_of
from harness.diagnosis.selection.candidate_fits import Say
from harness.diagnosis.selection.forward_selection import Trace
from harness.diagnosis.selection.validation import Judgement
from harness.identification.result import Judged
from harness.identification.whiteness import whiteness
from harness.reporting.failures import RAISED, Failures


@dataclass(frozen=True)
class Value:
    """A parameter as found: value and standard error in SI units."""

    name: str
    unit: str
    value: float
    std: float


@dataclass(frozen=True)
class Outcome:
    """A trace, judged.

    Attributes:
        trace: What was found.
        verdict: As ``trace.json`` has it.
        answer: The result in sentences.
        values: What each addition holds, by its name.
        judged: Every drive against the nominal model and the final one.
        nominal: The nominal model, refitted, for studies.
        amended: The final model, for studies; effects with moments hold those of the first fitted drive.
        where: Where the model lacks something, and what is left without a name.
        estimators: Estimators on the held-out drives with the nominal and the amended model, where asked for.
        worth: A study with the amended plant against both beliefs, where asked for; why it could not be run, in words.
        notes: What is odd about the recordings, with the evidence.
        failures: What could not be made after the search.
    """

    trace: Trace
    verdict: Verdict
    answer: str
    values: dict[str, tuple[Value, ...]]
    judged: tuple[Judged, ...]
    nominal: ModelSpec
    amended: ModelSpec
    where: Where
    estimators: tuple[Estimated, ...] = ()
    worth: Worth | str | None = None
    notes: tuple[str, ...] = ()
    failures: Failures = RAISED

    @property
    def added(self) -> tuple[Hypothesis, ...]:
        """Everything that was added, a random process last."""
        process = self.where.wandering
        return self.trace.added if process is None else (*self.trace.added, process.hypothesis)

    @property
    def after(self) -> Judgement:
        """The final model on the held-out drives: with what has no name, if that helps there."""
        return final_judgement(self.trace, self.where)


def outcome_of(trace: Trace, say: Say = lambda _: None, failures: Failures = RAISED) -> Outcome:
    """Return the verdict on a trace with all that the report and ``trace.json`` need.

    Args:
        trace: What was found.
        say: Is told what is being done.
        failures: Takes what cannot be computed; by default it is raised.
    """
    say("looking for where something is missing")
    amended = _amended(trace)
    errors = failures.attempt("the standard errors", lambda: _errors(trace, trace.final), lambda _: {})
    values = _values(trace, errors)
    judged = failures.attempt("the tests of the innovations", lambda: _judged(trace), lambda _: ())
    # Innovations that could not be tested are not taken for white.
    coloured = not judged or any(
        min(w.ljung_box, w.periodogram) < EXPLAINED for j in judged if j.held_out for w in j.whiteness
    )
    found = failures.attempt(
        "the search for where something is missing",
        lambda: where(trace, amended, coloured or strays(trace), failures),
        lambda _: NOWHERE,
    )
    if found.wandering is not None:
        amended = found.wandering.spec
        values[found.wandering.hypothesis.name] = _of_process(found.wandering)
    verdict = verdict_of(trace, found, coloured)
    nominal = fitted_model(trace, trace.fitting.whole.spec, trace.nominal.point)
    said = failures.attempt(
        "the answer in sentences", lambda: answer(trace, verdict, found), lambda _: f"The verdict is: {verdict}."
    )
    return Outcome(trace, verdict, said, values, judged, nominal, amended, found, failures=failures)


def _values(trace: Trace, errors: Mapping[tuple[str, int], float]) -> dict[str, tuple[Value, ...]]:
    """Return the parameters of every addition with their standard errors, NaN where there is none."""
    model, found = trace.fitting.whole, {}
    for h in trace.added:
        rows = []
        for name in (*h.shared, *h.moments):
            row = model.row(name)
            for i in range(len(trace.fitting.drives)) if name in h.moments else (0,):
                label = f"{name}@{trace.fitting.drives[i].name}" if name in h.moments else name
                value = float(trace.final.point.values[row, i])
                rows.append(Value(label, model.model.parameters[row].unit, value, errors.get((name, i), math.nan)))
        found[h.name] = tuple(rows)
    return found


def _of_process(process: Wandering) -> tuple[Value, ...]:
    units = {p.name: p.unit for p in process.spec.model().parameters}
    return tuple(Value(n, units[n], process.spec.values[n], e) for n, e in process.errors.items())


def _errors(trace: Trace, fitted: Fitted) -> dict[tuple[str, int], float]:
    """Return standard errors by parameter and first drive in which it acts."""
    fitting, n = trace.fitting, len(fitted.coordinates)
    information = np.diag([c.prior**-2 for c in fitted.coordinates]) if n else np.zeros((0, 0))
    for i, kept in enumerate(fitting.passes(fitted.point)):
        X = fitting.columns(fitted.coordinates, fitted.point, i, kept).reshape(-1, n)
        information = information + X.T @ X
    scale = np.sqrt(np.maximum(np.diagonal(information), 1e-300))
    covariance = np.linalg.pinv(information / np.outer(scale, scale), rcond=1e-11, hermitian=True)
    spread = np.sqrt(np.maximum(np.diagonal(covariance), 0.0)) / scale
    found = {}
    for c, s in zip(fitted.coordinates, spread, strict=True):
        z = c.coordinate(float(fitted.point.values[c.row, c.drives[0]]))
        found[c.parameter.name, c.drives[0]] = float(s * c.slope(z))
    return found


def _judged(trace: Trace) -> tuple[Judged, ...]:
    found = []
    for drives, held, points in (
        (trace.fitting.drives, False, (trace.nominal.point, trace.final.point)),
        (trace.held_out.drives, True, (trace.before.point, trace.after.point)),
    ):
        for i, drive in enumerate(drives):
            whole = trace.fitting.whole
            free = np.array([whole.free_run(drive, p.values[:, i]).outputs for p in points])
            runs = [whole.run(drive, p.values[:, i], trace.fitting.noise_at(p)) for p in points]
            with np.errstate(invalid="ignore"):
                errors = np.array([np.sqrt(np.nanmean((drive.measurements - f) ** 2, axis=0)) for f in free])
            found.append(
                Judged(
                    drive,
                    held,
                    free,
                    errors,
                    np.array([np.sqrt(np.nanmean(r.whitened[1:] ** 2, axis=0)) for r in runs]),
                    np.array([r.log_likelihood for r in runs]),
                    tuple(whiteness(column) for column in runs[1].whitened[1:].T),
                )
            )
    return tuple(found)


def _amended(trace: Trace) -> ModelSpec:
    """Return the final model with its effects at the places where they are in force."""
    spec = trace.fitting.whole.spec
    effects = (*spec.effects, *dict.fromkeys(h.name for h in trace.effects))
    return fitted_model(trace, replace(spec, effects=effects), trace.final.point)
