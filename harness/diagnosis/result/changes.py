"""Changes of a vehicle since a baseline: their sizes, the verdict, the answer in sentences and the record."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

from harness.diagnosis.criteria import EXCESS, PRIORS
from harness.diagnosis.fitting import ParameterPoint
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis, called, random_processes
from harness.diagnosis.result.answer import Change, in_words
from harness.diagnosis.result.claims import Verdict
from harness.diagnosis.result.outcome import Outcome
from harness.diagnosis.selection.acceptance import ends_at_bound
from harness.diagnosis.selection.baseline import Baseline
from harness.models.assembly.placement import split, suffix
from harness.models.quantities import listed, print_unit, words
from harness.reporting import style


def changes_of(outcome: Outcome, baseline: Baseline) -> tuple[Change, ...]:
    """Return what changed since a baseline, the likeliest first, and of those the one that is most plainly not none."""
    stated, augmented = baseline.augmented.stated(), baseline.augmented
    values = outcome.trace.final.point.values[:, 0]
    there = {n for h in baseline.added for n in h.amplitudes} | set(augmented.spec.values)
    changes = [
        Change(
            h,
            v.name,
            v.unit,
            before,
            v.value,
            math.hypot(
                v.std,
                baseline.error_of(v.name),
                baseline.scatter_of(h, v.name, values),
                PRIORS.likeness * (v.value - before),
            ),
            v.name not in there,
        )
        for h in outcome.trace.added
        for v in outcome.values[h.name]
        if v.name in h.amplitudes
        for before in [float(stated[augmented.row(v.name)])]
    ]
    likely = {} if outcome.posterior is None else outcome.posterior.inclusion()
    plain = {h: max((abs(c.now - c.before) / c.std for c in changes if c.hypothesis == h), default=0.0) for h in likely}
    order = sorted(outcome.trace.added, key=lambda h: (-round(likely.get(h, 0.0), 2), -plain.get(h, 0.0)))
    return tuple(sorted(changes, key=lambda c: order.index(c.hypothesis)))


def since(outcome: Outcome, baseline: Baseline) -> Outcome:
    """Return an outcome that says what changed since a baseline."""
    changes = changes_of(outcome, baseline)
    verdict = _verdict(outcome, baseline)
    errors = {c.name: c.std for c in changes}
    values = {
        name: tuple(replace(v, std=errors.get(v.name, v.std)) for v in own) for name, own in outcome.values.items()
    }
    return replace(
        outcome,
        values=values,
        baseline=baseline,
        changes=changes,
        verdict=verdict,
        answer=_answer(outcome, baseline, changes, verdict),
    )


def _verdict(outcome: Outcome, baseline: Baseline) -> Verdict:
    """Return whether nothing changed, what changed was named, or something changed that has no name here.

    Something has no name if the error on the held-out drives, of the model as the baseline had it as well as of the
    refitted one, is beyond what its discrepancy allows and what was so in the baseline; or if what was named ended at a
    bound of what is possible and so stands for something else.
    """
    trace = outcome.trace
    bounds = ends_at_bound(trace.fitting.augmented.model.parameters, trace.final, trace.added)
    if trace.cut_short or bounds:
        return "unresolved"
    if trace.added:
        return "amended"
    as_it_was = trace.held_out.judge((), trace.fitting.first())
    unexplained = min(trace.after.unexplained, as_it_was.unexplained)
    return "adequate" if unexplained <= max(EXCESS, baseline.judged.unexplained) else "unresolved"


def _answer(outcome: Outcome, baseline: Baseline, changes: tuple[Change, ...], verdict: Verdict) -> str:
    name = f"the baseline ({listed(list(baseline.names))})"
    if outcome.trace.cut_short:
        return f"The search broke off before everything was tried, so it is not known what changed since {name}."
    if not outcome.trace.added:
        if verdict == "adequate":
            return _nothing_named(outcome, name)
        near = f" Nearest comes {near}, less plainly than is asked for a name." if (near := _nearest(outcome)) else ""
        return f"Something has changed since {name} that no hypothesis of the library explains.{near}"
    order = dict.fromkeys([*(c.hypothesis for c in changes), *outcome.trace.added])
    phrases = [_phrase(h, [c for c in changes if c.hypothesis == h], outcome) for h in order]
    if verdict == "unresolved":
        return (
            f"Something has changed since {name} that no hypothesis of the library explains. Nearest comes "
            f"{'; '.join(phrases)}, which ends at a bound of what is possible and so stands for something else."
        )
    return f"Since {name}: {'; '.join(phrases)}.{_instead(outcome)}"


def _nothing_named(outcome: Outcome, name: str) -> str:
    """Return the answer where no change is named: the drives do not show one, or not as plainly as is asked."""
    rivals, near = _rivals(outcome), _nearest(outcome)
    if not near:
        open_ = f" They do not exclude {listed(rivals)}." if rivals else ""
        return f"Nothing has changed since {name} that these drives can show.{open_}"
    return f"Since {name} {near} may have changed, but less plainly than is asked for a name."


def _nearest(outcome: Outcome) -> str:
    """Return what may have changed with its probability, where that nothing did is outside the 90 % set; else empty."""
    posterior, claims, rivals = outcome.posterior, outcome.claims, _rivals(outcome)
    if posterior is None or not rivals or any(not m.added for m in posterior.confusable()):
        return ""
    some = claims.given_right * sum(m.probability for m in posterior.models if m.added)
    condition = ", if one of these explanations is right" if claims.conditional else ""
    return f"{' or '.join(rivals)} ({in_words(some)}{condition})"


def _phrase(h: Hypothesis, changes: list[Change], outcome: Outcome) -> str:
    """Return a change in words with its sizes and its probability."""
    posterior = outcome.posterior
    sure = "" if posterior is None else f" ({in_words(posterior.probability_of([h]))})"
    if h.name == ALL_PARAMETERS:
        return f"many parameters changed, which these drives do not tell apart{sure}"
    file, place = split(h.name)
    if len(changes) == 1 and changes[0].name.startswith(file):  # such as the gain error of a sensor's gain
        file = changes[0].name.removesuffix(suffix(place or ""))
    what = f"{words(file)} of {words(place)}" if place else words(file)
    sizes = [_size(c, words(c.name) != what.replace(" of ", " ")) for c in changes]
    return f"{what} {listed(sizes)}{sure}"


def _size(c: Change, named: bool) -> str:
    unit = f" {print_unit(c.unit)}".rstrip()
    now = f"{style.uncertain(c.now, c.std)}{unit}"
    text = now if c.new else f"from {style.number(c.before)} to {now}"
    return f"{words(c.name)} {text}" if named else text


def _instead(outcome: Outcome) -> str:
    """Return what may have changed instead: what the 90 % set holds besides."""
    rivals = _rivals(outcome)
    return f" These drives do not tell it from {listed(rivals)}." if rivals else ""


def _rivals(outcome: Outcome) -> list[str]:
    """Return in words what the 90 % set holds that was not added, four names at most."""
    if outcome.posterior is None:
        return []
    own = set(outcome.trace.added)
    sets = outcome.posterior.confusable()
    others = [h for m in sets for a in m.added for h in a.hypotheses if h not in own]
    return list(dict.fromkeys(called(h.name, " of ") for h in others))[:4]


def sizes_of(augmented: AugmentedModel, point: ParameterPoint, processes: Sequence[Hypothesis]) -> dict[str, Any]:
    """Return the parameters of random processes at a point, in SI units."""
    rows = {n: augmented.row(n) for h in processes for n in h.shared}
    units = augmented.model.parameters
    return {n: {"value": float(point.values[row, 0]), "unit": units[row].unit} for n, row in rows.items()}


def record_of_changes(outcome: Outcome) -> dict[str, Any] | None:
    """Return the key ``baseline`` of ``trace.json`` in SI units; ``None`` without a baseline."""
    baseline = outcome.baseline
    if baseline is None:
        return None
    posterior = outcome.posterior
    inclusion = {} if posterior is None else posterior.inclusion()
    return {
        "drives": list(baseline.names),
        "added": [h.name for h in baseline.added],
        "discrepancy": sizes_of(baseline.augmented, baseline.fitted.point, random_processes(baseline.augmented)),
        "changes": [
            {
                "hypothesis": c.hypothesis.name,
                "kind": c.hypothesis.kind,
                "parameter": c.name,
                "unit": c.unit,
                "before": c.before,
                "now": c.now,
                "change": c.now - c.before,
                "std": c.std,
                "interval_95": list(c.interval),
                "probability": inclusion.get(c.hypothesis),
            }
            for c in outcome.changes
        ],
    }
