"""``trace.json``, the drives over time, and both models as parameter files."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from harness.common.arrays import Floats
from harness.common.files import json_text, write_files
from harness.common.places import inside, remove
from harness.config.parameter_set import set_text
from harness.diagnosis.innovations.disturbance_inputs import place_of
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.diagnosis.residuals.dependence import DEGREE, Curve
from harness.diagnosis.residuals.localisation import Localisation
from harness.diagnosis.residuals.order_analysis import PeriodicDisturbance
from harness.diagnosis.residuals.unmodelled import UnmodelledDisturbance
from harness.diagnosis.result.answer import described
from harness.diagnosis.result.changes import record_of_changes, sizes_of
from harness.diagnosis.result.confounded import Direction
from harness.diagnosis.result.mixture import study_of
from harness.diagnosis.result.outcome import Outcome
from harness.diagnosis.result.posterior_record import ESTIMATE, record_of_confusable, record_of_posterior
from harness.diagnosis.result.study_gain import StudyGain
from harness.diagnosis.selection.acceptance import Candidate, Round
from harness.diagnosis.selection.validation import Judgement
from harness.identification.posterior_study import STUDY
from harness.identification.result import FILE, series_of
from harness.models.assembly.placement import load_effect, ports_of, split
from harness.models.assembly.plan import GroundPlan, planner
from harness.models.roles import VEHICLES
from harness.models.signals import SIGNALS

AMENDED = "amended.toml"

SCHEMA_VERSION = 2
"""Version of the keys of ``trace.json``: one more when a key is removed or changes its meaning."""


def record(outcome: Outcome) -> dict[str, Any]:
    """Return the content of ``trace.json`` in SI units; a part that cannot be made is ``None``."""
    makers = {**_search(outcome), **_gains(outcome)}
    parts = {
        key: outcome.failures.attempt(f"“{key}” of trace.json", make, lambda _: None) for key, make in makers.items()
    }
    head = {"schema_version": SCHEMA_VERSION, "verdict": outcome.verdict, "answer": outcome.answer}
    return {**head, **parts, "not_made": list(outcome.failures.sentences)}


def _search(outcome: Outcome) -> dict[str, Callable[[], Any]]:
    """Return what makes the parts of the record that say what was tried and found."""
    trace, outputs = outcome.trace, list(outcome.trace.fitting.augmented.model.outputs)
    return {
        "notes": lambda: list(outcome.notes),
        "cautions": lambda: list(outcome.cautions),
        "residual": lambda: _residual(outcome, outputs),
        "held_out": lambda: [j.drive.name for j in outcome.judged if j.held_out],
        "pinpoint": lambda: ranking_record(outcome.localisation, _plan(outcome)),
        "vehicle": lambda: _vehicle(_plan(outcome)),
        "candidates": lambda: [_candidate(c, n, outputs) for n, r in enumerate(trace.rounds, 1) for c in r.candidates],
        "added": lambda: [_added(h, outcome) for h in outcome.added if h.kind == "effect"],
        "parameters": lambda: [_added(h, outcome) for h in outcome.added if h.kind == "parameter"],
        "claimed": lambda: _claimed(outcome),
        "refused": lambda: _refused(outcome, outputs),
        "confounded": lambda: [_direction(d) for d in outcome.confounded],
        "refitted": lambda: _refitted(outcome),
        "estimates": lambda: [dict(zip(ESTIMATE, row, strict=True)) for row in outcome.estimates],
        "correlation": lambda: outcome.correlation.tolist(),
        "measured_ranges": lambda: _measured_ranges(trace.fitting.augmented),
        "discrepancy": lambda: _discrepancy(outcome),
        "baseline": lambda: record_of_changes(outcome),
        "asked": lambda: dict(outcome.asked),
        "after": lambda: None if outcome.expectation is None else outcome.expectation.record,
        "unnamed": lambda: unmodelled_record(outcome.localisation.unmodelled),
        "rounds": lambda: [_round(r, outputs) for r in trace.rounds],
        "posterior": lambda: record_of_posterior(outcome.posterior),
        "confusable": lambda: record_of_confusable(outcome.posterior, trace.fitting, trace.held_out.drives),
        "not_excited": lambda: [c.hypothesis.name for c in trace.rounds[0].candidates if not c.score.excited],
    }


def _claimed(outcome: Outcome) -> dict[str, Any]:
    """Return every addition with its probability and what may be there in its place."""
    claims = outcome.claims
    return {
        "if_one_is_right": claims.conditional,
        "at_bound": list(claims.at_bound),
        "additions": [
            {
                "name": h.name,
                "kind": h.kind,
                "probability": claims.probability([h]),
                "rivals": [
                    {
                        "name": None if r.hypothesis is None else r.hypothesis.name,
                        "kind": None if r.hypothesis is None else r.hypothesis.kind,
                        "probability": r.probability,
                    }
                    for r in claims.rivals(h)
                ],
            }
            for h in outcome.added
        ],
    }


def _direction(d: Direction) -> dict[str, Any]:
    """Return a direction in which the drives tell nothing; changes of what is positive are those of its logarithm."""
    changes = {d.parameter: d.change, **d.changes}
    return {
        "parameter": d.parameter,
        "changes": {
            name: {"change": change, "logarithmic": d.logarithmic[name], "unit": d.units[name]}
            for name, change in changes.items()
        },
        "named": list(d.named),
        "powers": d.powers,
        "words": str(d),
    }


def _refused(outcome: Outcome, outputs: list[str]) -> dict[str, Any] | None:
    """Return what was added and is worse than the nominal model; ``None`` if nothing was."""
    if outcome.refused is None:
        return None
    trace = outcome.refused.trace
    by_kind = {kind: [_added(h, outcome) for h in trace.added if h.kind == kind] for kind in ("effect", "parameter")}
    return {
        "added": by_kind["effect"],
        "parameters": by_kind["parameter"],
        "error": _before_and_after(outputs, trace.before.error, trace.after.error),
        "error_ratio": dict(zip(("value", "lower", "upper"), outcome.refused.growth.ratio, strict=True)),
    }


def _gains(outcome: Outcome) -> dict[str, Callable[[], Any]]:
    """Return what makes the parts of the record that say how much better the final model is."""
    trace, outputs = outcome.trace, list(outcome.trace.fitting.augmented.model.outputs)
    return {
        "error": lambda: _before_and_after(outputs, trace.before.error, outcome.after.error),
        "excess": lambda: {"before": trace.before.normalised_excess_mse, "after": outcome.after.normalised_excess_mse},
        "log_likelihood": lambda: {
            "train": {"before": trace.nominal.log_likelihood, "after": trace.final.log_likelihood},
            "test": {"before": trace.before.log_likelihood, "after": trace.after.log_likelihood},
        },
        "estimators": lambda: {e.kind: _before_and_after(outputs, e.before, e.after) for e in outcome.estimators},
        "worth": lambda: _study_gain(outcome.study_gain) if isinstance(outcome.study_gain, StudyGain) else None,
    }


def _discrepancy(outcome: Outcome) -> dict[str, Any]:
    """Return how wrong the final model is anyway, in SI units; nothing where the drives need no discrepancy."""
    trace = outcome.trace
    sizes = sizes_of(trace.fitting.augmented, trace.final.point, trace.discrepancy)
    return {"parameters": sizes, "hinging": list(trace.hinging)}


def _measured_ranges(augmented: AugmentedModel) -> dict[str, Any]:
    """Return to what parameters were held, in SI units."""
    held = {name: augmented.bounds(name) for name in augmented.ranges if name in augmented.names}
    return {name: {"lower": low, "upper": high} for name, (low, high) in held.items()}


def _plan(outcome: Outcome) -> GroundPlan | None:
    augmented = outcome.trace.fitting.augmented
    return planner(augmented.nominal, VEHICLES.load(augmented.spec.vehicle)).plan(augmented.spec.values)


def _vehicle(plan: GroundPlan | None) -> dict[str, Any] | None:
    """Return where things are on the straight vehicle, in m ahead of the CoG of its first body."""
    if plan is None:
        return None
    ends = {
        body: {
            "back": plan.cogs[body] + o.back,
            "front": plan.cogs[body] + o.front,
            "width": o.width,
            "stated": o.stated,
        }
        for body, o in plan.outlines.items()
    }
    return {
        "bodies": ends,
        "axles": {axle: {"x": plan.along(axle), "y": at.y} for axle, at in plan.axles.items()},
        "coupling": plan.coupling[0] if plan.coupling else None,
    }


def _before_and_after(outputs: Sequence[str], before: Floats, after: Floats) -> dict[str, Any]:
    return {
        name: {"unit": SIGNALS[name].unit, "before": b, "after": a}
        for name, b, a in zip(outputs, before, after, strict=True)
    }


def _round(r: Round, outputs: list[str]) -> dict[str, Any]:
    return {
        "held_out_excess_by_output": _by_output(r.before, outputs),
        "added": r.added.hypothesis.name if r.added else None,
        "reason": r.reason,
    }


def _study_gain(study_gain: StudyGain) -> dict[str, Any]:
    """Return the median errors of a study over all its levels, in SI units, with the ratio and its interval."""
    targets = study_gain.nominal.targets
    gains = [study_gain.gain(e, t) for e in range(len(study_gain.nominal.estimators)) for t in range(len(targets))]
    by_estimator: dict[str, Any] = {}
    for g in gains:
        t = targets[g.target]
        by_estimator.setdefault(g.estimator, {})[t.name] = {
            "unit": SIGNALS[t.name].unit,
            "before": g.before / t.scale,
            "after": g.after / t.scale,
            "ratio": g.ratio.value,
            "ratio_interval_95": [g.ratio.lower, g.ratio.upper],
            "lost": {"before": g.lost[0], "after": g.lost[1]},
        }
    return {"study": str(study_gain.study), "moments": study_gain.change_times, "estimators": by_estimator}


def _residual(outcome: Outcome, outputs: list[str]) -> dict[str, Any]:
    return {
        j.drive.name: {
            name: {
                "unit": SIGNALS[name].unit,
                "rmse": j.free_error[1, a],
                "variance_of_whitened_innovations": j.whiteness[a].variance,
                "ljung_box_p": j.whiteness[a].ljung_box,
                "cumulative_periodogram_p": j.whiteness[a].periodogram,
            }
            for a, name in enumerate(outputs)
        }
        for j in outcome.judged
    }


def _candidate(c: Candidate, number: int, outputs: list[str]) -> dict[str, Any]:
    h = c.hypothesis
    return {
        "round": number,
        "name": h.name,
        "kind": h.kind,
        "log_likelihood_gain": c.score.gain,
        "bic_gain": c.bic,
        "fitted": c.fitted is not None,
        "held_out_log_likelihood": c.held_out.log_likelihood if c.held_out else None,
        "held_out_excess": c.held_out.normalised_excess_mse if c.held_out else None,
        "held_out_excess_by_output": _by_output(c.held_out, outputs) if c.held_out else None,
        "detectable": c.detectable,
    }


def _by_output(judged: Judgement, outputs: list[str]) -> dict[str, float]:
    return dict(zip(outputs, judged.normalised_excess_mses, strict=True))


def _refitted(outcome: Outcome) -> dict[str, dict[str, Any]]:
    stated = outcome.trace.fitting.augmented.spec.values
    return {
        v.name: {"value": v.value, "std": v.std, "unit": v.unit, "stated": stated[v.name]} for v in outcome.refitted
    }


def _added(h: Hypothesis, outcome: Outcome) -> dict[str, Any]:
    entry: dict[str, Any] = {
        "effect": split(h.name)[0],
        "place": split(h.name)[1],
        "parameters": {v.name: {"value": v.value, "std": v.std, "unit": v.unit} for v in outcome.values[h.name]},
    }
    if h.kind == "effect":
        entry["port"] = list(ports_of(load_effect(h.name)))
        entry["equation"] = equation(h, outcome)
    elif h.name != ALL_PARAMETERS:
        entry["stated"] = outcome.trace.fitting.augmented.spec.values[h.name]
    return entry


def equation(h: Hypothesis, outcome: Outcome) -> dict[str, dict[str, str]]:
    """Return the ports that an effect changes, each before and after, as text over the model's names."""
    spec = outcome.trace.fitting.augmented.spec
    before = spec.model().ports
    after = replace(spec, effects=(*spec.effects, h.name)).model().ports
    return {
        port: {"before": str(before[port]), "after": str(after[port])}
        for port in after
        if port in before and before[port] != after[port]
    }


def write_outcome(outcome: Outcome, folder: Path) -> list[Path]:
    """Write ``trace.json``, ``drives.npz`` and both models as parameter files, and return their paths.

    Raises:
        UserError: If the folder cannot be written to.
    """
    content = record(outcome)
    written = write_files(folder, {"trace.json": json_text(content)})
    if outcome.refused is not None:
        for name in (AMENDED, STUDY):  # of an earlier trace into the same folder
            remove(inside(folder, name))
    model = outcome.trace.fitting.augmented.model
    written += outcome.failures.attempt(
        FILE, lambda: write_files(folder, {FILE: series_of(outcome.judged, model)}), lambda _: []
    )
    written += outcome.failures.attempt(
        "nominal.toml and amended.toml", lambda: write_files(folder, _models(outcome)), lambda _: []
    )
    return written + outcome.failures.attempt(
        STUDY, lambda: write_files(folder, study_of(outcome, AMENDED, content["confusable"])), lambda _: []
    )


def _models(outcome: Outcome) -> dict[str, str]:
    names = ", ".join(d.name for d in outcome.trace.fitting.drives)
    comments = {
        v.name: f"{v.unit} +- {v.std:.3g}" for rows in outcome.values.values() for v in rows if math.isfinite(v.std)
    }
    nominal = {
        "nominal.toml": set_text(outcome.nominal, f"the nominal model refitted by harness trace on {names}", {}),
    }
    if outcome.refused is not None:  # a model that is worse than the nominal one is not offered
        return nominal
    return {**nominal, AMENDED: set_text(outcome.amended, f"harness trace on {names}", comments)}


def ranking_record(localisation: Localisation, plan: GroundPlan | None) -> list[dict[str, Any]]:
    """Return ``pinpoint`` of ``trace.json``: every input, the one that explains most first, and where it acts."""
    if localisation.nominal is None or localisation.final is None:
        return []
    gain_after = {s.disturbance_input.name: s.gain for s in localisation.final.ranked_inputs}
    return [
        {
            "channel": s.disturbance_input.name,
            "kind": s.disturbance_input.kind,
            "ports": list(s.disturbance_input.ports),
            "unit": s.disturbance_input.unit,
            "log_likelihood_gain": s.gain,
            "time_constant": s.time_constant,
            "deviation": s.deviation,
            "log_likelihood_gain_after": gain_after[s.disturbance_input.name],
            "ahead_of_first_cog": None if plan is None else place_of(plan, s.disturbance_input),
        }
        for s in localisation.nominal.ranked_inputs
    ]


def unmodelled_record(disturbance: UnmodelledDisturbance | None) -> dict[str, Any] | None:
    """Return ``unnamed`` of ``trace.json``."""
    if disturbance is None:
        return None
    return {
        "curves": [_curve(c) for c in disturbance.curves],
        "turning": [_periodic(t) for t in disturbance.periodic],
        "parameters": disturbance.shift,
        "held_out_log_likelihood_gain": disturbance.held_out_gain,
        "excess": disturbance.judgement.normalised_excess_mse,
        "driven_by": "the motion of the model itself and the recorded inputs",
    }


def _periodic(t: PeriodicDisturbance) -> dict[str, Any]:
    return {
        "channel": t.disturbance_input.name,
        "ports": list(t.disturbance_input.ports),
        "unit": t.disturbance_input.unit,
        "words": described(t),
        "wavelength": t.wavelength,
        "amplitude": t.amplitude,
        "speed": t.speed,
        "grows_with_speed_to_the": t.growth,
        "log_likelihood_gain": t.gain,
    }


def _curve(c: Curve) -> dict[str, Any]:
    return {
        "channel": c.disturbance_input.name,
        "ports": list(c.disturbance_input.ports),
        "unit": c.disturbance_input.unit,
        "driver": c.regressor.name,
        "driver_unit": c.regressor.unit,
        "driver_within": c.regressor.within,
        "words": described(c),
        "degree": DEGREE,
        "knots": c.basis.knots.tolist(),
        "coefficients": c.weights.tolist(),
        "stability": c.stability,
        "predicted_log_likelihood_gain": c.predicted,
    }
