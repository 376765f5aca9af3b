"""The head of a trace's report: verdict, effect, size, uncertainty and improvement in one table."""

from __future__ import annotations

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis, called
from harness.diagnosis.report import study_gain
from harness.diagnosis.report.probabilities import likely, scaled, size
from harness.diagnosis.result.answer import Value, unmodelled_words
from harness.diagnosis.result.outcome import Outcome
from harness.diagnosis.result.study_gain import StudyGain
from harness.diagnosis.selection.forward_selection import Trace
from harness.models.quantities import listed, quantity, words
from harness.reporting import style
from harness.reporting.document import Block, Bullets, Heading, Prose, Section, Sheet, plain, strong

_MEANING = {
    "adequate": "adequate: nothing is missing that these drives can show",
    "amended": "amended: what is missing has a name, and is confirmed by the held-out drives",
    "unresolved": "unresolved: something is missing that no effect of the library explains",
}

_MEANING_SINCE = {
    "adequate": "adequate: these drives show no change plainly enough to be named",
    "amended": "amended: what has changed has a name, and is confirmed by the held-out drives",
    "unresolved": "unresolved: something has changed that no hypothesis of the library explains",
}
"""With a baseline."""

_NAMELESS = "amended: what is missing has no name, but its effect is known and is confirmed by the held-out drives"


def answered(outcome: Outcome) -> list[Block]:
    """Return the answer in words."""
    return [Heading("What was found?"), Prose(strong(outcome.answer))]


def blocks(outcome: Outcome) -> list[Block]:
    """Return the table, the irregularities of the recordings, and how each round of the search ended."""
    content: list[Block] = [Section(lambda: [_table(outcome)], "Summary", headed=False)]
    if outcome.failures.sentences:
        content += [
            Prose(plain("These parts of the result could not be made:")),
            Bullets([plain(sentence) for sentence in outcome.failures.sentences]),
        ]
    if outcome.cautions:
        content += [Prose(plain("Take the values with care:")), Bullets([plain(c) for c in outcome.cautions])]
    if outcome.notes:
        content += [
            Prose(plain("These irregularities of the recordings may look like a missing effect:")),
            Bullets([plain(note) for note in outcome.notes]),
        ]
    return [*content, Section(lambda: _search(outcome), "How did the search go?", headed=False)]


def _search(outcome: Outcome) -> list[Block]:
    measured = measured_ranges(outcome.trace.fitting.augmented)
    sentences = [*([measured] if measured else []), *_rounds(outcome)]
    return [Prose(plain("How the search went:")), Bullets([plain(s) for s in sentences])]


def _table(outcome: Outcome) -> Sheet:
    nameless = outcome.verdict == "amended" and not outcome.added
    meaning = _MEANING if outcome.baseline is None else _MEANING_SINCE
    rows = [["verdict", _NAMELESS if nameless else meaning[outcome.verdict]]]
    rows += [["what", called(h.name)] for h in outcome.added]
    if outcome.localisation.unmodelled is not None:
        rows += [["what", f"not in the library: {text}"] for text in unmodelled_words(outcome.localisation.unmodelled)]
    rows += [["how large", line] for line in _sizes(outcome)]
    rows += [["refitted", _instead(outcome, v)] for v in outcome.refitted]
    rows += [["how likely", line] for line in likely(outcome)]
    rows += [["how sure", line] for line in _certainty(outcome)]
    rows += [["how much better", line] for line in _improvements(outcome)]
    if isinstance(outcome.study_gain, StudyGain):
        rows.append(["in a study", study_gain.answer(outcome.study_gain)])
    shown = [[label if i == 0 or rows[i - 1][0] != label else "", text] for i, (label, text) in enumerate(rows)]
    return Sheet(["", ""], shown, "Summary; the sections below give the evidence.", left=2)


def _sizes(outcome: Outcome) -> list[str]:
    """Return the parameters of what was added, largest in standard errors first where they are many."""
    stated, sizes = outcome.trace.fitting.augmented.spec.values, []
    for h in outcome.added:
        values = outcome.values[h.name]
        if h.name == ALL_PARAMETERS:
            moved = sorted(values, key=lambda v: -abs(v.value - stated[v.name]) / v.std if v.std else 0.0)[:3]
            sizes += [_instead(outcome, v) for v in moved]
            continue
        sizes += [_instead(outcome, v) if v.name in stated else size(v) for v in values]
    return sizes


def _instead(outcome: Outcome, v: Value) -> str:
    """Return what a stated parameter was found to be."""
    stated = outcome.trace.fitting.augmented.spec.values[v.name]
    return f"{size(v)}, stated {style.number(scaled(v.name, stated, v.unit)[0])}"


def _certainty(outcome: Outcome) -> list[str]:
    """Return the evidence for each addition."""
    evidence, in_force = [], {n for h in outcome.trace.added for n in h.amplitudes}
    for r in outcome.trace.rounds:
        if r.added is None or r.added.held_out is None:
            continue
        if not any(in_force.issuperset(h.amplitudes) for h in r.added.hypothesis.single):
            continue
        gain = r.added.held_out.log_likelihood - r.before.log_likelihood
        text = (
            f"{called(r.added.hypothesis.name)}: {style.number(r.added.bic)} units of BIC on the fitted drives "
            f"({outcome.bic_needed:.0f} needed), log-likelihood {style.number(gain)} higher on the held-out drives"
        )
        if r is not outcome.trace.rounds[0]:
            text += ", both over the model with what earlier rounds had added"
        evidence.append(text)
    gone, instead = _replaced(outcome.trace)
    if instead:
        evidence += [
            f"{called(h.name)}: takes the place of {gone}; likelier by what the held-out drives say and by what was "
            "known before, as “how likely” shows"
            for h in instead
        ]
    if (process := outcome.localisation.random_process) is not None:
        names = listed([called(h.name) for h in process.hypotheses])
        evidence.append(
            f"{names}: log-likelihood of a filter with it {style.number(process.gain)} "
            f"higher on the fitted drives, {style.number(process.held_out_gain)} on the held-out drives, where it "
            f"leaves {'white' if process.white else 'almost white'} innovations"
        )
    return evidence


def _improvements(outcome: Outcome) -> list[str]:
    """Return how far the errors of simulation and estimators fall on the held-out drives."""
    trace, improvements = outcome.trace, []
    if not outcome.added and outcome.localisation.unmodelled is None:
        return []
    outputs, after_all = list(trace.fitting.augmented.model.outputs), outcome.after.error
    fall = _fall(trace.before.error, after_all)
    foretold = trace.added or outcome.localisation.unmodelled is not None  # no simulation predicts a random process
    for a in np.argsort(-np.where(np.isfinite(fall), fall, np.inf))[:2] if foretold else ():
        q = quantity(outputs[a])
        errors = trace.before.error[a], after_all[a], trace.held_out.floor[a]
        before, after, floor = (style.number(q.scale * v) for v in errors)
        improvements.append(f"simulation, {q.words}: RMSE {before} to {after} {q.unit} (floor {floor})")
    for e in outcome.estimators:
        gained = _fall(e.before, e.after)
        a = int(np.argmax(np.where(np.isfinite(e.after) & ~np.isnan(gained), gained, -np.inf)))
        q = quantity(outputs[a])
        before, after = (style.number(q.scale * v) for v in (e.before[a], e.after[a]))
        improvements.append(f"{e.kind.upper()}, {q.words} without its sensor: RMSE {before} to {after} {q.unit}")
    return improvements


def _fall(before: Floats, after: Floats) -> Floats:
    """Return the factor by which each error falls, NaN where neither says it."""
    with np.errstate(invalid="ignore", divide="ignore"):
        return before / after


def measured_ranges(augmented: AugmentedModel) -> str:
    """Return in a sentence to what the search was held because positions have measured it; empty if to nothing."""
    ranges = []
    for name in augmented.ranges:
        if name in augmented.names:
            unit = augmented.model.parameters[augmented.row(name)].unit
            (low, shown), (high, _) = (scaled(name, v, unit) for v in augmented.bounds(name))
            ranges.append(f"{words(name)} from {style.number(low)} to {style.number(high)} {shown}".rstrip())
    return f"Positions have measured these, and nothing beyond was tried: {listed(ranges)}." if ranges else ""


def _rounds(outcome: Outcome) -> list[str]:
    sentences = []
    for number, r in enumerate(outcome.trace.rounds, 1):
        if r.added is not None:
            sentences.append(f"Round {number} added {called(r.added.hypothesis.name)}: it {r.reason}.")
        elif r.best:
            best = called(r.best)
            sentences.append(f"Round {number} added nothing: with {best}, {r.reason}.")
        else:
            sentences.append(f"Round {number} added nothing: {r.reason}.")
    if outcome.refused is not None:
        sentences.append("With all of that the held-out drives are simulated worse, so the nominal model stays.")
    gone, instead = _replaced(outcome.trace)
    if instead:
        likelier = listed([called(h.name) for h in instead])
        sentences.append(f"In place of {gone} stands what is likelier: {likelier}.")
    elif outcome.trace.dropped:
        sentences.append(f"Without {gone} the rest is likelier.")
    return sentences


def _replaced(trace: Trace) -> tuple[str, list[Hypothesis]]:
    """Return in words what rounds added and is gone, or is a part of what took its place, and what took it."""
    kept = [h for r in trace.rounds if r.added for h in r.added.hypothesis.single if h not in trace.dropped]
    of_rounds = {n for h in kept for n in h.amplitudes}
    instead = [h for h in trace.added if not of_rounds.issuperset(h.amplitudes)]
    parts = [h for h in kept if any(set(h.amplitudes) < set(i.amplitudes) for i in instead)]
    return listed([called(h.name) for h in (*trace.dropped, *parts)]), instead
