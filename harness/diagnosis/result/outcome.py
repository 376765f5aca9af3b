"""A trace judged: its verdict, what was found where, and the amended model.

Cautions come before the answer: fits that ended at a bound, models that cannot be driven.
"""

from __future__ import annotations

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.failures import RAISED, Failures
from harness.config import ModelSpec
from harness.diagnosis.criteria import BIC_NEEDED, STRONG, WHITE
from harness.diagnosis.fitting import FittedHypothesis
from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.residuals.localisation import NOWHERE, Localisation, localised
from harness.diagnosis.residuals.random_process import RandomProcess
from harness.diagnosis.result.answer import Change, Value, answer
from harness.diagnosis.result.claims import (
    Claims,
    Refused,
    Verdict,
    claims_of,
    final_judgement,
    final_posterior,
    refusal,
    strays,
    without_additions,
)
from harness.diagnosis.result.confounded import Direction, confounded
from harness.diagnosis.result.estimator_gain import EstimatorErrors, fitted_model
from harness.diagnosis.result.expectation import ExpectationMet
from harness.diagnosis.result.shown_effects import EffectsShown
from harness.diagnosis.result.study_gain import StudyGain
from harness.diagnosis.selection.acceptance import ends_at_bound, strayed
from harness.diagnosis.selection.baseline import Baseline
from harness.diagnosis.selection.candidate_fits import Say
from harness.diagnosis.selection.forward_selection import Trace
from harness.diagnosis.selection.posterior import Posterior
from harness.diagnosis.selection.validation import Judgement
from harness.identification.result import Judged, judged_on
from harness.identification.uncertainty import at_bound
from harness.models.assembly.placement import split
from harness.models.quantities import print_unit, words
from harness.reporting import style


def cautions(trace: Trace) -> tuple[str, ...]:
    """Return the sentences."""
    sentences = [*_bounds("the refitted nominal model", trace.nominal)]
    if trace.added:
        sentences += _bounds("the final model", trace.final)
    driveable, stated = trace.fitting.driveable, trace.fitting.first().values[:, 0]
    models = {"stated": stated, "refitted nominal": trace.nominal.point.values[:, 0]}
    if trace.added:
        models["final"] = trace.final.point.values[:, 0]
    for name, values in models.items():
        speed = driveable.unstable_from(values)
        if math.isfinite(speed):
            text = style.with_unit(speed, "m/s")
            sentences.append(f"The {name} model is unstable straight ahead at {text}, which was driven.")
    return tuple(dict.fromkeys(sentences))


def _bounds(what: str, fitted: FittedHypothesis) -> list[str]:
    sentences = []
    for c in fitted.coordinates:
        value = fitted.point.value(c)
        if c.drives or not (side := at_bound(c.coordinate(value), c.lower, c.upper)):
            continue
        which, unit = "lower" if side < 0 else "upper", print_unit(c.unit)
        sentences.append(
            f"The fit of {what} ends at the {which} bound of the {words(c.name)}, {style.with_unit(value, unit)}; the "
            "true value may lie beyond it, or something else is wrong."
        )
    return sentences


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
        amended: The final model, for studies; effects with change times hold those of the first fitted drive.
        localisation: Where the model lacks something, and the unmodelled disturbance that is left.
        estimators: Estimators on the held-out drives with the nominal and the amended model, where asked for.
        study_gain: A study with the amended plant against both beliefs, where asked for; why it could not be run, in
        words.
        notes: Irregularities of the recordings, with the evidence.
        failures: What could not be made after the search.
        refitted: What the final model has for the parameters that are fitted in any case.
        refused: Additions that the final model lacks because they are worse than none, if there were any.
        confounded: Directions in which the drives do not tell what was added or refitted from something else.
        baseline: The vehicle as earlier drives showed it, if there are any; then everything added is a change since.
        changes: What changed since, parameter by parameter.
        asked: Model, parameters and recordings, so that the same can be traced again with further ones.
        expectation: What was expected of planned drives against what came, where they are among these.
    """

    trace: Trace
    verdict: Verdict
    answer: str
    values: dict[str, tuple[Value, ...]]
    judged: tuple[Judged, ...]
    nominal: ModelSpec
    amended: ModelSpec
    localisation: Localisation
    estimators: tuple[EstimatorErrors, ...] = ()
    study_gain: StudyGain | str | None = None
    notes: tuple[str, ...] = ()
    failures: Failures = RAISED
    refitted: tuple[Value, ...] = ()
    refused: Refused | None = None
    confounded: tuple[Direction, ...] = ()
    baseline: Baseline | None = None
    changes: tuple[Change, ...] = ()
    asked: Mapping[str, Any] = field(default_factory=dict)
    expectation: ExpectationMet | EffectsShown | None = None

    @property
    def cautions(self) -> tuple[str, ...]:
        """Parameters that a fit took to a bound or far from what is stated, and models that cannot be driven."""
        if self.baseline is None:
            return cautions(self.trace)
        nominal = {p.name for p in self.baseline.augmented.nominal.parameters}
        factors = strayed(self.baseline.fitted, nominal)
        effective = (
            "The model of the baseline predicts, but with values that are hardly those of the vehicle (as factors on "
            f"what is stated: {factors}); sizes of changes are those of this model."
        )
        return (*((effective,) if factors else ()), *cautions(self.trace))

    @functools.cached_property
    def _uncertainty(self) -> tuple[list[int], Floats, Floats]:
        errors, correlation = self.trace.fitting.uncertainty(self.trace.final)
        moved = self.trace.final.coordinates[: len(errors)]
        rows = [i for i, c in enumerate(moved) if not c.drives and c.name in self.amended.values]
        return rows, errors[rows], correlation[np.ix_(rows, rows)]

    @property
    def estimates(self) -> list[tuple[str, float, float]]:
        """All that was fitted of the amended model but what each drive has of its own: name, value, standard error."""
        rows, errors, _ = self._uncertainty
        names = [self.trace.final.coordinates[i].name for i in rows]
        return [(n, self.amended.values[n], float(e)) for n, e in zip(names, errors, strict=True)]

    @property
    def correlation(self) -> Floats:
        """Correlation of the estimates ``(n, n)``."""
        return self._uncertainty[2]

    @property
    def posterior(self) -> Posterior | None:
        """How likely each model is, and that none of them is right."""
        return final_posterior(self.trace, self.localisation)

    @property
    def claims(self) -> Claims:
        """What is claimed."""
        parameters = self.trace.fitting.augmented.model.parameters
        bounds = ends_at_bound(parameters, self.trace.final, self.trace.added)
        return Claims(self.verdict, self.trace.added, self.posterior, bounds, self.refused, self.confounded)

    @property
    def added(self) -> tuple[Hypothesis, ...]:
        """Everything that was added, a random process last."""
        process = self.localisation.random_process
        return self.trace.added if process is None else (*self.trace.added, *process.hypotheses)

    @property
    def bic_needed(self) -> float:
        """Gain in BIC that an addition needs: where a vehicle differs from its model in many ways, strong evidence."""
        return STRONG if self.trace.discrepancy and self.baseline is None else BIC_NEEDED

    @property
    def after(self) -> Judgement:
        """The final model on the held-out drives: with what has no name, if that helps there."""
        return final_judgement(self.trace, self.localisation)


def outcome_of(trace: Trace, say: Say = lambda _: None, failures: Failures = RAISED) -> Outcome:
    """Return the verdict on a trace with all that the report and ``trace.json`` need.

    Args:
        trace: What was found.
        say: Receives what is being done, in words.
        failures: Takes what cannot be computed; by default it is raised.
    """
    say("looking for where something is missing")
    refused = failures.attempt("the comparison of the simulation errors", lambda: refusal(trace), lambda _: None)
    values: dict[str, tuple[Value, ...]] = {}
    if refused is not None:
        searched, trace = trace, without_additions(refused)
        values = _values(searched, failures.attempt("the standard errors", lambda: _errors(searched), lambda _: {}))
    amended = _amended(trace)
    errors = failures.attempt("the standard errors", lambda: _errors(trace), lambda _: {})
    values |= _values(trace, errors)
    judged = failures.attempt("the tests of the innovations", lambda: _judged(trace), lambda _: ())
    # Innovations that could not be tested do not count as white.
    coloured = not judged or any(w.p_value < WHITE for j in judged if j.held_out for w in j.whiteness)
    localisation = failures.attempt(
        "the search for where something is missing",
        lambda: localised(trace, amended, coloured or strays(trace), failures, refused is None),
        lambda _: NOWHERE,
    )
    if localisation.random_process is not None:
        amended = localisation.random_process.spec
        values |= _of_process(localisation.random_process)
    claims = claims_of(trace, localisation, coloured, refused)
    directions = failures.attempt(
        "the directions that the drives do not tell apart",
        lambda: confounded(trace, claims.all_rivals),
        lambda _: (),
    )
    claims = replace(claims, confounded=directions)
    nominal = fitted_model(trace, with_effects(trace, ()), trace.nominal.point)
    sentences = failures.attempt(
        "the answer in sentences",
        lambda: answer(trace, claims, localisation, values),
        lambda _: f"The verdict is: {claims.verdict}.",
    )
    refitted = tuple(_value(trace, errors, name) for name in trace.free if name in nominal.values)
    return Outcome(
        trace,
        claims.verdict,
        sentences,
        values,
        judged,
        nominal,
        amended,
        localisation,
        failures=failures,
        refitted=refitted,
        refused=refused,
        confounded=directions,
    )


def _values(trace: Trace, errors: Mapping[tuple[str, int], float]) -> dict[str, tuple[Value, ...]]:
    """Return the parameters of every addition with their standard errors, NaN where there is none."""
    drives = trace.fitting.drives
    return {
        h.name: (
            *(_value(trace, errors, name) for name in h.shared),
            *(_value(trace, errors, name, i, f"@{d.name}") for name in h.change_times for i, d in enumerate(drives)),
        )
        for h in trace.added
    }


def _value(trace: Trace, errors: Mapping[tuple[str, int], float], name: str, drive: int = 0, suffix: str = "") -> Value:
    """Return a parameter of the final model with its standard error, NaN where there is none."""
    model = trace.fitting.augmented
    row = model.row(name)
    value = float(trace.final.point.values[row, drive])
    return Value(f"{name}{suffix}", model.model.parameters[row].unit, value, errors.get((name, drive), math.nan))


def _of_process(process: RandomProcess) -> dict[str, tuple[Value, ...]]:
    units, values = {p.name: p.unit for p in process.spec.model().parameters}, process.spec.values
    return {
        h.name: tuple(Value(n, units[n], values[n], process.errors[n]) for n in h.shared) for h in process.hypotheses
    }


def _errors(trace: Trace) -> dict[tuple[str, int], float]:
    """Return the standard errors of the final model by parameter and first drive in which it acts."""
    errors = trace.fitting.standard_errors(trace.final)
    moved = trace.final.coordinates
    return {(c.name, c.drives[0] if c.drives else 0): float(e) for c, e in zip(moved, errors, strict=True)}


def _judged(trace: Trace) -> tuple[Judged, ...]:
    """Return every drive against the nominal model and the final one."""
    fitting = trace.fitting
    fitted = (
        judged_on(fitting.augmented, fitting.drives, fitting.candidates([f.point]))
        for f in (trace.nominal, trace.final)
    )
    return tuple(
        Judged(held_out, before, after)
        for held_out, both in ((False, fitted), (True, (trace.before.drives, trace.after.drives)))
        for before, after in zip(*both, strict=True)
    )


def _amended(trace: Trace) -> ModelSpec:
    """Return the final model with its effects at the places where they are in force."""
    return fitted_model(trace, with_effects(trace, trace.effects), trace.final.point)


def with_effects(trace: Trace, added: Sequence[Hypothesis]) -> ModelSpec:
    """Return the nominal model with what it has from earlier drives, its random processes, and some additions.

    Noise that was fitted with a discrepancy is that of a filter that holds it. An effect that acts everywhere has its
    parameters at each place, so it stands for itself at some.
    """
    spec = trace.fitting.augmented.spec
    names = dict.fromkeys(h.name for h in (*trace.known, *trace.discrepancy, *added) if h.kind == "effect")
    kept = [n for n in names if "@" not in n or split(n)[0] not in names]
    return replace(spec, effects=(*spec.effects, *kept))
