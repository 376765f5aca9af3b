"""The report of a trace: what is missing, how sure that is, and how much better the model is with it."""

from __future__ import annotations

import math
import re
from collections.abc import Iterable
from functools import partial

from harness.diagnosis.criteria import ERROR_NEEDED, TRIED, WHITE
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, called
from harness.diagnosis.report import changes, probabilities, residual_sections, study_gain, summary
from harness.diagnosis.report.probabilities import scaled
from harness.diagnosis.result.outcome import Outcome
from harness.diagnosis.result.record import equation
from harness.diagnosis.selection.acceptance import Candidate
from harness.identification import figures as fit_figures
from harness.identification.axles import axle_comparison
from harness.identification.report import coloured_outputs, whiteness_sheet
from harness.models.quantities import listed, quantity, words
from harness.reporting import style
from harness.reporting.document import (
    Block,
    Bullets,
    Drawing,
    Listing,
    Prose,
    Report,
    Section,
    Sheet,
    plain,
    strong,
)

_ON_FIRST_PAGE = 4.0
"""Inches of the held-out drive on the first page, which has the vehicle too."""


def report(outcome: Outcome, command: str, title: str = "", evidence: Iterable[Block] = ()) -> Report:
    """Return the report.

    Args:
        outcome: The trace, judged.
        command: How it was made, for the last section.
        title: The question; what the model of the vehicle lacks by default.
        evidence: What stands behind the errors of model and estimators.
    """
    blocks: list[Block] = [
        *summary.answered(outcome),
        *_over_time(outcome)[:1],
        Section(lambda: residual_sections.from_above(outcome), "Where on the vehicle?", headed=False),
        Section(lambda: changes.expectation(outcome), "Were the planned drives as informative as expected?"),
        Section(lambda: changes.since(outcome), "What changed, and by how much?", headed=False),
        *summary.blocks(outcome),
        Section(lambda: _errors(outcome), "How large is the simulation error?", headed=False),
        Section(lambda: _estimators(outcome), "How large are the errors of the estimators?", headed=False),
        *evidence,
        Section(lambda: _additions(outcome), "How large is it?"),
        Section(lambda: _axles(outcome), "What follows for the axles?", headed=False),
        Section(lambda: _confounded(outcome), "What do these drives not tell apart?"),
        Section(lambda: changes.discrepancy(outcome), "How wrong is the model anyway?"),
        Section(lambda: residual_sections.unmodelled(outcome), "Which disturbance is not in the library?"),
        Section(lambda: study_gain.blocks(outcome.study_gain), "What does the amendment gain in a study?"),
        Section(lambda: residual_sections.where(outcome), "Where is something missing?"),
        Section(lambda: _rounds(outcome), "What else was tried?"),
        Section(lambda: _residual(outcome), "Are the innovations white?"),
        Section(lambda: residual_sections.innovations(outcome), "What do the innovations depend on?", headed=False),
        Section(lambda: _over_time(outcome)[1:], "Does the simulation follow the other drives?"),
        Section(lambda: _excitation(outcome), "Which effects could these drives have shown?"),
        Section(lambda: _made(outcome, command), "How was it made?"),
    ]
    vehicle = words(outcome.trace.fitting.augmented.spec.vehicle)
    lacks = f"What does the model of the {vehicle} lack?"
    if outcome.baseline is not None:
        lacks = f"What has changed of the {vehicle} since {listed(list(outcome.baseline.names))}?"
    return Report(title or lacks, blocks)


def _errors(outcome: Outcome) -> list[Block]:
    before, after, rows = outcome.trace.before, outcome.after, []
    floor = outcome.trace.held_out.floor
    for a, name in enumerate(outcome.trace.fitting.augmented.model.outputs):
        q = quantity(name)
        numbers = (floor[a], before.error[a], after.error[a])
        rows.append([q.words, q.unit, *(style.number(q.scale * v) for v in numbers)])
    caption = (
        "Simulation error (root mean square) on the held-out drives, out of sample. Before: the nominal model, its own "
        "parameters refitted. After: the amended one. No model is expected to fall below the floor: the noise of the "
        "sensor and what is not known of the recorded inputs."
    )
    return [Sheet(["output", "unit", "floor", "before", "after"], rows, caption, left=2)]


def _estimators(outcome: Outcome) -> list[Block]:
    if not outcome.estimators:
        return []
    rows = []
    for e in outcome.estimators:
        for a, name in enumerate(outcome.trace.fitting.augmented.model.outputs):
            q = quantity(name)
            numbers = (style.number(q.scale * v) for v in (e.before[a], e.after[a]))
            rows.append([e.kind.upper(), q.words, q.unit, *numbers])
    caption = (
        "Estimators on the held-out drives: root mean square error of each output, estimated from the other "
        "measurements alone, with the nominal and with the amended model. It includes the sensor's own noise. A "
        "dash: diverged."
    )
    return [Sheet(["estimator", "target", "unit", "before", "after"], rows, caption, left=3)]


def _additions(outcome: Outcome) -> list[Block]:
    trace = outcome.trace
    if not outcome.added:
        return []
    blocks: list[Block] = []
    rows = []
    for h in outcome.added:
        for v in outcome.values[h.name]:
            stated = trace.fitting.augmented.spec.values.get(v.name, math.nan)
            moved = abs(v.value - stated) > 3 * v.std if math.isfinite(stated) else True
            if h.name == ALL_PARAMETERS and not moved:
                continue
            (was, unit), (now, _), (spread, _) = (scaled(v.name, x, v.unit) for x in (stated, v.value, v.std))
            row = [called(h.name), words(v.name.replace("@", " in ")), unit]
            rows.append([*row, style.number(was), style.number(now, 4), style.number(spread)])
    header = ["addition", "parameter", "unit", "stated", "found", "std. error"]
    if rows:
        blocks.append(Sheet(header, rows, "What was added, in the order in which it was found.", left=3))
    else:
        sentence = "Many parameters changed together, none of them by more than three standard errors."
        blocks.append(Prose(plain(sentence)))
    for h in (h for h in outcome.added if h.kind == "effect"):
        for port, text in equation(h, outcome).items():
            before, after = (_breakable(text[k]) for k in ("before", "after"))
            blocks.append(Listing(f"{port}\n  before  {before}\n  after   {after}"))
    return blocks


def _axles(outcome: Outcome) -> list[Block]:
    stated = outcome.trace.fitting.augmented.spec
    return axle_comparison({"stated": stated, "refitted": outcome.nominal, "amended": outcome.amended})


def _confounded(outcome: Outcome) -> list[Block]:
    """Return the directions in which the fitted drives tell nothing; nothing where there are none."""
    if not outcome.confounded:
        return []
    text = (
        "The Fisher information of the fitted drives alone, without what is known beforehand, on what was added or "
        "refitted, on stated values and on what may be there in the place of additions. Each of these parameters would "
        "be known alone; its value hinges on that of the others."
    )
    return [Prose(plain(text)), Bullets([plain(str(d)) for d in outcome.confounded])]


def _breakable(equation: str) -> str:
    """Return an equation with room around its products, so that a long one breaks into lines."""
    return re.sub(r"(?<!\*)\*(?!\*)", " * ", equation)


def _rounds(outcome: Outcome) -> list[Block]:
    asked = (
        f"{style.percent(ERROR_NEEDED)} less simulation error there beyond the noise of sensors and inputs; an error "
        "within that noise has to stay there"
    )
    if outcome.baseline is not None:
        asked = "a simulation error there that does not grow, over the noise of sensors and inputs"
    needs = f"An addition needs {outcome.bic_needed:.0f} units of BIC on the fitted drives"
    tried = (
        f"those that promise half of the best are fitted jointly with the nominal parameters. {needs}, a higher "
        f"likelihood of the held-out drives, and {asked}"
    )
    every = "Every effect of the library at every place, and every parameter that was held fixed."
    if outcome.trace.discrepancy and outcome.baseline is None:
        every = "Every effect of the library at every place that acts throughout the drives."
        tried = (
            "those that promise most are fitted jointly with all stated values and the random processes. "
            f"{needs} and a higher likelihood of the held-out drives"
        )
    blocks: list[Block] = [Prose(plain(f"{every} The score test predicts a gain for each; {tried}."))]
    for number, r in enumerate(outcome.trace.rounds, 1):
        if r.candidates and max(c.bic for c in r.candidates) > 1.0:
            title = f"Gain in BIC of the best hypotheses of round {number}, over the model as it was then."
            blocks.append(Drawing(partial(probabilities.ranking, r, number, outcome.bic_needed), title, title))
        fitted = [c for c in r.candidates if c.fitted is not None]
        if fitted:
            blocks.append(_fitted(fitted, r.before.log_likelihood, r.before.normalised_excess_mse, number))
    return blocks


def _fitted(fitted: list[Candidate], likelihood: float, normalised_excess_mse: float, number: int) -> Sheet:
    rows = [
        [
            called(c.hypothesis.name),
            style.number(c.bic),
            style.number(c.held_out.log_likelihood - likelihood),
            style.number(normalised_excess_mse),
            style.number(c.held_out.normalised_excess_mse),
        ]
        for c in fitted
        if c.held_out is not None
    ]
    header = ["hypothesis", "gain in BIC", "held-out log-likelihood", "excess before", "after"]
    caption = (
        f"Round {number}: hypotheses that were fitted. Excess: mean square of the simulation error on the held-out "
        "drives over the variance of the sensor noise, less one, summed over the outputs."
    )
    return Sheet(header, rows, caption)


def _excitation(outcome: Outcome) -> list[Block]:
    """Return the detection limit of every effect by its Fisher information, three standard errors."""
    rows, hidden = [], []
    if not outcome.trace.rounds[0].candidates:
        return []
    parameters = {p.name: p for p in outcome.trace.fitting.augmented.model.parameters}
    for c in sorted(outcome.trace.rounds[0].candidates, key=lambda c: c.hypothesis.name):
        if c.hypothesis.kind != "effect" or ("@" not in c.hypothesis.name and len(c.hypothesis.amplitudes) > 1):
            continue
        if not c.score.excited:
            hidden.append(called(c.hypothesis.name))
            continue
        for name, error in zip(c.hypothesis.amplitudes, c.score.error, strict=True):
            least, unit = scaled(name, 3 * error, parameters[name].unit)
            rows.append([called(c.hypothesis.name), words(name), unit, style.number(least)])
    sentence = f"Not excited by these drives: {', '.join(hidden)}." if hidden else "These drives excite every effect."
    caption = "Smallest size that these drives show with three standard errors, all fitted parameters free."
    return [
        Prose(plain(sentence)),
        Sheet(["effect", "parameter", "unit", "detectable"], rows, caption, left=3),
    ]


def _residual(outcome: Outcome) -> list[Block]:
    outputs = list(outcome.trace.fitting.augmented.model.outputs)
    if not outcome.judged:
        return [Prose(plain("It could not be tested."))]
    coloured = coloured_outputs(outcome.judged, outputs, WHITE)
    sentence = (
        f"Yes: no test rejects it at {style.number(WHITE)}."
        if not coloured
        else f"No: those of {', '.join(coloured)} are coloured."
    )
    return [
        Prose(strong(sentence)),
        Drawing(
            lambda: fit_figures.periodograms(list(outcome.judged), outputs),
            "Cumulative periodogram of the whitened innovations of the final model, less that of white noise, with the "
            "95 % band of white noise.",
            "Cumulative share of power over frequency for each output, less that of white noise.",
        ),
        whiteness_sheet(
            outcome.judged,
            outputs,
            "Whitened innovations of the final model; those of a correct model are white with variance 1.",
        ),
    ]


def _over_time(outcome: Outcome) -> list[Drawing]:
    """Return the picture of every held-out drive; the first belongs to the answer, with room for the vehicle below."""
    outputs, held_out = list(outcome.trace.fitting.augmented.model.outputs), [j for j in outcome.judged if j.held_out]
    return [
        Drawing(
            partial(fit_figures.over_time, j, outputs, style.TALLEST if j is not held_out[0] else _ON_FIRST_PAGE),
            f"{j.drive.name}, held out: measured, and simulated before and after. {fit_figures.ERROR}",
            f"Outputs over time of {j.drive.name}: measured, nominal and amended model.",
        )
        for j in held_out
    ]


def _made(outcome: Outcome, command: str) -> list[Block]:
    trace = outcome.trace
    text = (
        f"{len(trace.rounds[0].candidates)} hypotheses, {len(trace.fitting.drives)} fitted and "
        f"{len(trace.held_out.drives)} held-out drives, {trace.fitting.samples} fitted values. Nominal parameters "
        f"refitted: {', '.join(words(n) for n in trace.free)}. In the place of each "
        f"addition up to {TRIED} more hypotheses were fitted that take over most of its gain."
    )
    return [Prose(plain(text)), Listing(command, "sh")]
