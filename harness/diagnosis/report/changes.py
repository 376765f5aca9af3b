"""Sections on what changed since a baseline, on what planned drives showed, and on how wrong a model is anyway."""

from __future__ import annotations

import math

from harness.diagnosis.model.hypotheses import called
from harness.diagnosis.report.probabilities import scaled
from harness.diagnosis.result.answer import in_words
from harness.diagnosis.result.outcome import Outcome
from harness.diagnosis.result.shown_effects import EffectsShown
from harness.models.quantities import listed, words
from harness.reporting import style
from harness.reporting.document import Block, Prose, Sheet, plain


def since(outcome: Outcome) -> list[Block]:
    """Return what changed since the baseline, and what that showed; nothing without one."""
    baseline = outcome.baseline
    if baseline is None:
        return []
    inclusion = {} if outcome.posterior is None else outcome.posterior.inclusion()
    rows = []
    for c in outcome.changes:
        (was, unit), (now, _), (spread, _) = (scaled(c.name, x, c.unit) for x in (c.before, c.now, c.std))
        low, high = (scaled(c.name, end, c.unit)[0] for end in c.interval)
        probability = inclusion.get(c.hypothesis, math.nan)
        numbers = [style.number(was), style.number(now, 4), style.number(now - was), style.number(spread)]
        interval = f"{style.number(low)} to {style.number(high)}"
        sure = in_words(probability) if math.isfinite(probability) else "–"
        rows.append([called(c.hypothesis.name), words(c.name), unit, *numbers, interval, sure])
    blocks: list[Block] = []
    if rows:
        header = ["change", "parameter", "unit", "before", "now", "difference", "std. error", "95 % interval", "likely"]
        caption = (
            "What changed since the baseline. Interval of the difference, with the error of the baseline and the "
            "discrepancy of the model. Likely: probability of the change, by the held-out drives."
        )
        blocks.append(Sheet(header, rows, caption, left=3))
    learnt = [called(h.name) for h in baseline.added]
    text = f"The baseline is {listed(list(baseline.names))}. All stated parameters were fitted to it within their "
    text += "priors"
    text += f", and it showed {listed(learnt)}." if learnt else "."
    text += " None of that is claimed; it is what the drives since are compared with."
    return [*blocks, Prose(plain(text))]


def expectation(outcome: Outcome) -> list[Block]:
    """Return what was expected of planned drives against what came; nothing where none were planned."""
    met = outcome.expectation
    if met is None:
        return []
    if isinstance(met, EffectsShown):
        return [Prose(plain(met.words))]
    rows = [
        [
            r.rival,
            f"{style.number(r.expected)} ± {style.number(r.deviation)}",
            style.number(r.realised),
            style.number(r.z),
        ]
        for r in met.ratios
    ]
    caption = (
        f"Log likelihood ratio of {met.leading} to each model that it was to be told from, by the drives since: "
        "expected if it is right, with the standard deviation, realised, and by how many of these that differs."
    )
    sheet = Sheet(["rival", "expected", "realised", "z"], rows, caption, left=1)
    return [Prose(plain(met.words)), sheet] if rows else [Prose(plain(met.words))]


def discrepancy(outcome: Outcome) -> list[Block]:
    """Return how wrong the final model is anyway; nothing where the drives need no discrepancy."""
    trace = outcome.trace
    if not trace.discrepancy:
        return []
    augmented, rows = trace.fitting.augmented, []
    for h in trace.discrepancy:
        for n in h.shared:
            row = augmented.row(n)
            p = augmented.model.parameters[row]
            value, unit = scaled(n, float(trace.final.point.values[row, 0]), p.unit)
            rows.append([called(h.name), p.meaning, unit, style.number(value)])
    caption = (
        "Random processes that every model has, with the sizes that the fitted drives show: force and moment of each "
        "body as a share of its lateral force, the bank of the road, the drift of gyroscopes. Standard errors, "
        "probabilities and the floor of the simulation error allow for them."
    )
    blocks: list[Block] = [Sheet(["process", "parameter", "unit", "size"], rows, caption, left=3)]
    if trace.hinging:
        names = listed([words(n) for n in trace.hinging])
        text = f"Sizes that hinge on this: without it, {names} would be outside the 95 % interval stated here."
        blocks.insert(0, Prose(plain(text)))
    return blocks
