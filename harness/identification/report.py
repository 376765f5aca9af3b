"""The report of a fit: what the recordings determine, the simulation error, and the whiteness of the innovations."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from functools import partial

import numpy as np

from harness.identification import figures
from harness.identification.axles import axle_sheet
from harness.identification.contract import Estimate, Fit
from harness.identification.free_run import BLOCK, FEWEST
from harness.identification.measured_file import SpanTable
from harness.identification.result import Judged, answer
from harness.identification.whiteness import REJECTED, Whiteness
from harness.models.quantities import print_unit, quantity, words
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

WHITENESS = ("variance", "p, Ljung-Box", "p, cumulative periodogram")
"""Columns of the tests of whiteness."""


def report(
    fit: Fit,
    judged: list[Judged],
    command: str,
    title: str = "",
    evidence: Iterable[Block] | None = None,
    notes: Sequence[str] = (),
) -> Report:
    """Return the report.

    Args:
        fit: What was found.
        judged: The recordings, fitted ones first.
        command: How it was made, for the last section.
        title: The question; what the recordings say about the vehicle by default.
        evidence: What stands below the answer; the error in each recording by default.
        notes: What is odd about the recordings.
    """
    sections = [
        Section(lambda: answered(fit, judged, notes), "What was found?"),
        *(gains(fit, judged) if evidence is None else evidence),
        Section(lambda: parameters(fit), "Which values?"),
        Section(lambda: _over_time(fit, judged), "Does the simulation follow the drives?"),
        Section(lambda: _errors(fit, judged), "How large are the errors?", headed=False),
        Section(lambda: _residuals(fit, judged), "Are the innovations white?"),
        Section(lambda: certainty(fit), "Which estimates are correlated?"),
        Section(lambda: made(fit, command), "How was it made?"),
    ]
    return Report(title or f"What do the recordings say about {words(fit.spec.vehicle)}?", sections)


def answered(fit: Fit, judged: Sequence[Judged], notes: Sequence[str]) -> list[Block]:
    """Return the answer, with what casts doubt on it."""
    blocks: list[Block] = [Prose(strong(answer(fit, judged)))]
    if not fit.converged:
        blocks.append(Prose(plain("The search did not converge; take the values with care.")))
    bounded = [f"{words(e.name)}: {e.reason}" for e in fit.estimates if e.verdict == "at its bound"]
    if bounded:
        blocks += [Prose(plain("The fit ends at bounds:")), Bullets([plain(b) for b in bounded])]
    if notes:
        blocks += [
            Prose(plain("These irregularities of the recordings may have moved the values:")),
            Bullets([plain(note) for note in notes]),
        ]
    return blocks


def gains(fit: Fit, judged: list[Judged]) -> list[Block]:
    """Return how the simulation error of each recording changes."""
    return [
        Section(
            lambda: [Bullets([plain(_gain(j, fit)) for j in judged])],
            "How large is the simulation error?",
            headed=False,
        )
    ]


def _gain(judged: Judged, fit: Fit) -> str:
    """Say how the simulation error of a recording changes."""
    outputs = list(fit.spec.model().outputs)
    ratio = judged.free_error[1] / judged.free_error[0]
    finite = np.flatnonzero(np.isfinite(ratio))
    role = "held out" if judged.held_out else "fitted"
    if not finite.size:
        return f"{judged.drive.name} ({role}): the free run leaves the range in which the equations hold."
    before, after = judged.free_error
    parts = [f"{words(outputs[a])} {_shown(outputs[a], before[a])} to {_shown(outputs[a], after[a])}" for a in finite]
    return f"{judged.drive.name} ({role}): simulation error {', '.join(parts)}."


def _shown(name: str, value: float) -> str:
    q = quantity(name)
    return style.with_unit(q.scale * value, q.unit)


def parameters(fit: Fit) -> list[Block]:
    """Return the values that were found."""
    physical = [e for e in fit.estimates if e.name in fit.spec.values]
    noise = [e for e in fit.estimates if e.name not in fit.spec.values]
    blocks: list[Block] = [_sheet(physical, "Parameters before and after the fit"), *axle_sheet(fit)]
    if any(e.profile is not None for e in physical):
        blocks.append(
            Drawing(
                lambda: figures.profiles(fit),
                "How far the log-likelihood falls along each parameter, everything else refitted; what lies below the "
                "dotted line is outside the 95 % interval, dashed is the parabola of the standard error.",
                "Profile likelihood of each parameter in standard errors from its estimate.",
            )
        )
    if noise:
        caption = "Noise before and after; process noise as a factor on the variances of all states of that unit"
        blocks.append(_sheet(noise, caption))
    reasons = [f"{words(e.name)}: {e.reason}" for e in physical if e.reason and e.verdict != "determined"]
    confounded = [f"{words(e.name)}: {e.reason}" for e in physical if "confounded" in e.reason]
    remarks = list(dict.fromkeys([*reasons, *confounded]))
    return [*blocks, Bullets([plain(r) for r in remarks])] if remarks else blocks


def _sheet(estimates: list[Estimate], caption: str) -> Sheet:
    rows = [
        [
            words(e.name),
            print_unit(e.unit),
            style.number(e.start),
            style.number(e.value),
            style.number(e.error),
            f"{style.number(e.lower)} to {style.number(e.upper)}" if math.isfinite(e.lower) else "–",
            e.verdict or "–",
        ]
        for e in estimates
    ]
    header = ["quantity", "unit", "before", "found", "std. error", "95 % interval", "these recordings"]
    return Sheet(header, rows, f"{caption}. A dash: not stated.", left=2)


def _over_time(fit: Fit, judged: list[Judged]) -> list[Block]:
    begins = (
        "Free run: the model is simulated over the recorded inputs, without measurements. It begins behind the first "
        f"{BLOCK:g} s, or a {FEWEST}th of a short drive, in the state that its filter has found there."
    )
    return [Prose(plain(begins)), *drawn(fit, judged, figures.ERROR)]


def drawn(fit: Fit, judged: list[Judged], remark: str = "") -> list[Block]:
    """Return each recording over time, measured and simulated."""
    outputs, blocks = list(fit.spec.model().outputs), list[Block]()
    for j in judged:
        role = "held out" if j.held_out else "fitted"
        blocks.append(
            Drawing(
                partial(figures.over_time, j, outputs),
                f"{j.drive.name} ({role}): measured, and simulated before and after the fit. {remark}".rstrip(),
                f"Outputs over time of {j.drive.name}: measured and simulated before and after the fit.",
            )
        )
    return blocks


def _errors(fit: Fit, judged: list[Judged]) -> list[Block]:
    rows = []
    for j in judged:
        for a, name in enumerate(fit.spec.model().outputs):
            q = quantity(name)
            errors = [*j.free_error[:, a], *j.one_step_error[:, a]]
            role = "held out" if j.held_out else "fitted"
            rows.append([j.drive.name, role, q.words, q.unit, *(style.number(q.scale * e) for e in errors)])
    header = ["drive", "role", "output", "unit", "simulation before", "after", "one step before", "after"]
    caption = (
        "Root mean square of the simulation error (free run) and of the filter's one-step prediction error. A dash: "
        "the free run left the range in which the equations hold at once."
    )
    return [Sheet(header, rows, caption, left=4)]


def _residuals(fit: Fit, judged: list[Judged]) -> list[Block]:
    if not judged:
        return []
    outputs = list(fit.spec.model().outputs)
    coloured = coloured_outputs(judged, outputs, REJECTED)
    little = "" if fit.coloured or not fit.correlation.size else "; on the fitted drives that widens no interval"
    sentence = (
        "Yes: no test rejects it."
        if not coloured
        else f"No: those of {', '.join(coloured)} are coloured, so the model leaves something predictable{little}."
    )
    caption = "Whitened innovations; those of a correct model are white (large p) with variance 1."
    return [
        Prose(strong(sentence)),
        Drawing(
            lambda: figures.periodograms(judged, outputs),
            "Cumulative periodogram of the whitened innovations less that of white noise, which stays between the "
            "dotted lines in 95 of 100 cases.",
            "Share of power below each frequency less that of white noise, for each output, with the 95 % band.",
        ),
        whiteness_sheet(judged, outputs, caption),
    ]


def coloured_outputs(judged: Sequence[Judged], outputs: Sequence[str], limit: float) -> list[str]:
    """Return the outputs of each drive whose innovations a test of whiteness rejects at a p-value, in words."""
    tested = [(name, j, w) for j in judged for name, w in zip(outputs, j.whiteness, strict=True)]
    return [f"{words(name)} of {j.drive.name}" for name, j, w in tested if w.p_value < limit]


def whiteness_sheet(judged: Sequence[Judged], outputs: Sequence[str], caption: str) -> Sheet:
    """Return the tests of whiteness of every output of every drive as a table."""
    rows = [
        [j.drive.name, words(name), *whiteness_cells(w)]
        for j in judged
        for name, w in zip(outputs, j.whiteness, strict=True)
    ]
    return Sheet(["drive", "output", *WHITENESS], rows, caption, left=2)


def whiteness_cells(w: Whiteness) -> list[str]:
    """Return variance and p-values of a series of innovations, in the order of ``WHITENESS``."""
    return [style.number(w.variance), style.probability(w.ljung_box), style.probability(w.periodogram)]


def certainty(fit: Fit) -> list[Block]:
    """Return the correlation of the estimates."""
    if not fit.correlation.size:
        return []
    caption = (
        "Correlation of the estimates. A pair near 1 or -1 is confounded: the recordings determine one combination of "
        "the two, not each."
    )
    alt = "Matrix of correlations between the estimates."
    matrix = Drawing(lambda: figures.correlation(fit), caption, alt)
    return [matrix]


def made(fit: Fit, command: str) -> list[Block]:
    """Return how the fit was made."""
    text = (
        f"Method {fit.method}; {fit.objective} {style.number(fit.before, 6)} before and {style.number(fit.after, 6)} "
        f"after {len(fit.history)} iterations, {'converged' if fit.converged else 'not converged'}."
    )
    notes: list[Block] = [Bullets([plain(n) for n in fit.notes])] if fit.notes else []
    return [Prose(plain(text)), *notes, Listing(command, "sh")]


def spans_sheet(spans: Mapping[str, Sequence[SpanTable]]) -> Sheet:
    """Return the table of the drives for a report, by what they were used for."""
    rows = [
        [s.name or s.file, purpose, "all" if s.span is None else " to ".join(map(str, s.span))]
        for purpose, tables in spans.items()
        for s in tables
    ]
    return Sheet(["recording", "used", "span"], rows, "The drives.", left=3)
