"""The answer in words; every number in it is computed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from harness.models.quantities import listed, words
from harness.reporting.document import Block, Bullets, Heading, Prose, plain, strong
from harness.reporting.style import number, percent, probability, span, with_unit
from harness.study.report.analysis import Analysis, Findings, Paired
from harness.study.report.opening import ALIKE, answer_in_short, at
from harness.study.report.ranking import limits_of, tolerances
from harness.study.report.sections import boxes, inputs, sensitivity, tolerance
from harness.study.report.sections.history import inside
from harness.study.results import FATES, Design
from harness.study.scores import OK, PENDING

SURE = 0.5  # share within ± 2σ below which an estimator is over-confident
_NAMED = 3  # up to so many estimators are all named in a sentence; of more, the best and the worst


def blocks(analysis: Analysis, opening: Sequence[Block] = ()) -> list[Block]:
    """Return the answer: in a sentence, in a figure, and in detail for each target, lost runs and covariances.

    Args:
        analysis: Of the study.
        opening: Blocks that follow the sentence.
    """
    findings = analysis.main
    items = []
    for target, quantity in enumerate(findings.design.targets):
        sentences = [*_errors(findings, target), *_better(findings, target)]
        items.append(f"{strong(_capital(quantity.words) + '.')} {plain(' '.join(sentences))}")
    items += [f"{strong('Inputs.')} {plain(text)}" for text in inputs.in_short(findings)]
    items.append(f"{strong('Lost runs.')} {plain(_lost(analysis))}")
    if findings.with_covariance:
        items.append(f"{strong('Stated uncertainty.')} {plain(_consistent(findings, analysis.store.histories))}")
    sentence = Prose(strong(answer_in_short(findings, analysis.store.designs)))
    figures = boxes.pictures(analysis, findings, opening=True)
    return [
        Heading("Answer"),
        sentence,
        *opening,
        *_of_the_box(analysis),
        Prose(plain(_scope(analysis))),
        *figures,
        Bullets(items),
    ]


def _of_the_box(analysis: Analysis) -> list[Block]:
    """Say of a study of all factors at once which of them drive the error, and how far all may drift together."""
    design = analysis.main.design
    if design.sampling != "saltelli" or design.count(PENDING):
        return []
    items = [("What drives the error?", " ".join(sensitivity.in_short(analysis.main.ranking)))]
    limits = limits_of(analysis.store.attributes)
    for nested in (d for d in analysis.store.designs if d.sampling == "tolerance" and not d.count(PENDING)):
        found = tolerance.told(nested, limits, tolerances(nested, limits))
        borne = " ".join(f"For the {target.words}: {text}" for target, text in found)
        items.append(("How far may all factors drift?", borne))
    return [Bullets([f"{strong(question)} {plain(text)}" for question, text in items if text])]


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def _scope(analysis: Analysis) -> str:
    design = analysis.main.design
    drives = f"{len(design.drives)} drive{'s' if len(design.drives) > 1 else ''}"
    varied = listed([f.words for f in design.factors]) if design.factors else "the setting"
    text = f"Design “{design.name}”: {drives}, "
    if len(design.bands) > 1:
        text += f"{len(design.bands)} levels of {varied} ({design.bands[0]} to {design.bands[-1]}), "
    text += f"{design.planned} runs per level and estimator. Intervals are at 95 %.{_belief(analysis)}"
    pending = sum(d.count(PENDING) for d in analysis.store.designs)
    if pending:
        text += f" The study is not finished: {pending} runs are still to come."
    return text


def _belief(analysis: Analysis) -> str:
    """Say that the estimators believe in another model than the plant's, where they do."""
    description = analysis.store.attributes.get("description") or {}
    plant, belief = (str(description.get(side, {}).get("model", "")) for side in ("plant", "belief"))
    if plant == belief:
        return ""
    return f" The plant is {plant}, the estimators believe {belief}: they are wrong at every level."


def _named(findings: Findings, target: int, band: int) -> list[list[int]]:
    """Return the estimators named in a sentence, in groups of like medians: all of a few, else best and worst."""
    medians = findings.medians[target, band]
    if _alike(findings, target):
        return [[0]]
    known = [e for e, m in enumerate(medians) if np.isfinite(m)]
    if len(known) <= _NAMED:
        return [[e] for e in known]
    known = [e for e in known if findings.comparable[e]] or known
    best, worst = min(medians[known]), max(medians[known])
    groups = [
        [e for e in known if medians[e] <= (1 + ALIKE) * best],
        [e for e in known if medians[e] * (1 + ALIKE) >= worst],
    ]
    return groups[:1] if groups[0] == groups[1] else groups


def _alike(findings: Findings, target: int) -> bool:
    """Whether several estimators have nearly the same median in every band."""
    medians = findings.medians[target]
    if medians.shape[1] < 2 or not np.isfinite(medians).all() or not (medians > 0).all():
        return False
    return bool(np.all(medians.max(axis=1) < (1 + ALIKE) * medians.min(axis=1)))


def _home(findings: Findings) -> int | None:
    """Return the band a sentence starts from: the matched one, or the only one."""
    if findings.design.matched is None and len(findings.design.bands) == 1:
        return 0
    return findings.design.matched


def _extremes(design: Design, medians: np.ndarray, home: int | None) -> list[int]:
    """Return the ends of a single factor's range, or else the band with the largest median of all."""
    if len(design.factors) == 1:
        centres = (design.factors[0].lower + design.factors[0].upper) / 2
        ends = list(dict.fromkeys([int(np.argmin(centres)), int(np.argmax(centres))]))
    elif np.isfinite(medians).any():
        ends = [int(np.nanargmax(np.nanmax(np.where(np.isfinite(medians), medians, -np.inf), axis=1)))]
    else:
        ends = []
    return [b for b in ends if b != home]


def _errors(findings: Findings, target: int) -> list[str]:
    """Say how large the error is where plant and belief agree, and at the ends of the range."""
    design, unit = findings.design, findings.design.targets[target].unit
    table = findings.summaries[target]
    home = _home(findings)
    medians = findings.medians[target]

    def who(group: list[int]) -> str:
        return "" if _alike(findings, target) else f" for {listed([design.estimators[e] for e in group])}"

    sentences = []
    if home is not None and np.isfinite(medians[home]).any():
        parts = []
        for group in _named(findings, target, home):
            median = table[home][group[0]].median
            interval = span(median.lower, median.upper, unit)
            parts.append(f"{with_unit(median.value, unit)}{who(group)} ({interval})")
        if design.matched is None:
            where = _capital(at(design, home))
        else:
            varied = listed([f.words for f in design.factors])
            where = f"With the {varied} {design.matched_is} ({design.bands[home]})"
        sentences.append(f"{where} the median RMSE is {listed(parts)}.")
    for band in _extremes(design, medians, home):
        parts = []
        for group in _named(findings, target, band):
            e = group[0]
            text = f"{with_unit(medians[band, e], unit)}{who(group)}"
            if home is not None and medians[home, e] > 0:
                text += f" ({number(medians[band, e] / medians[home, e], 2)} times as much)"
            parts.append(text)
        word = "it" if sentences else "the median RMSE"
        if parts:
            sentences.append(f"{_capital(at(design, band))} {word} is {listed(parts)}.")
        else:
            sentences.append(f"{_capital(at(design, band))} no run has a score.")
    return sentences


def _better(findings: Findings, target: int) -> list[str]:
    """Say which estimator is better on the same run and by how much, as believed and overall."""
    design = findings.design
    sentences = []
    for band in findings.told[-1:] if _alike(findings, target) else findings.told:
        where = "Over all levels" if band is None and len(design.bands) > 1 else ""
        where = where or _capital(at(design, band or 0))
        pairs = [findings.compared(target, a, b, band) for a, b in findings.pairs]
        pairs = [p for p in pairs if p.result.n]
        if len(pairs) == 1:
            sentences.append(_difference(findings, pairs[0], where))
        elif pairs:
            sentences.append(_standing(findings, pairs, where))
    return sentences


def _difference(findings: Findings, pair: Paired, where: str) -> str:
    design, unit = findings.design, findings.design.targets[pair.target].unit
    value, lower, upper = pair.result.difference
    first, second = design.estimators[pair.first], design.estimators[pair.second]
    interval = span(lower, upper, unit)
    if not pair.shown:
        return (
            f"{where} no difference between {second} and {first} is shown (median of the paired differences "
            f"{with_unit(value, unit)}, {percent(pair.relative)} of the median RMSE; {interval}; p {_p(pair, ' ')})."
        )
    better, worse = (second, first) if value < 0 else (first, second)
    size = f"{with_unit(abs(value), unit)}, {percent(abs(pair.relative))} of the median RMSE"
    low, high = sorted([abs(lower), abs(upper)])
    interval = span(low, high, unit) if lower * upper > 0 else f"difference {interval}"
    wins = pair.result.wins if value < 0 else 1.0 - pair.result.wins
    evidence = f"in {100 * wins:.0f} % of {pair.result.n} runs (p {_p(pair, ' ')})"
    if pair.negligible:
        return (
            f"{where} {better} and {worse} differ negligibly: {better} has the smaller error on the same run by {size} "
            f"({interval}), {evidence}."
        )
    return f"{where} {better} is better than {worse} on the same run by {size} ({interval}), {evidence}."


def _p(pair: Paired, equals: str = "") -> str:
    text = probability(pair.p_corrected)
    return text if text.startswith("<") or not equals else f"= {text}"


def _standing(findings: Findings, pairs: list[Paired], where: str) -> str:
    """Sort many estimators into better than, worse than and not distinguished from the best."""
    names = findings.design.estimators
    groups: dict[str, list[str]] = {"better": [], "worse": [], "within 1 %": [], "not distinguished": []}
    for pair in sorted(pairs, key=lambda p: p.relative):
        shown = pair.shown and not pair.negligible
        close = "within 1 %" if pair.negligible else "not distinguished"
        key = ("better" if pair.relative < 0 else "worse") if shown else close
        by = f" by {percent(abs(pair.relative))}" if shown else ""
        groups[key].append(names[pair.second] + by)
    parts = [f"{key}: {listed(members)}" for key, members in groups.items() if members]
    return f"{where}, against {names[pairs[0].first]} on the same run, {'; '.join(parts)}."


def _lost(analysis: Analysis) -> str:
    designs = analysis.store.designs
    total = sum(d.status.size for d in designs)
    if all(d.count(OK) == d.status.size for d in designs):
        return f"None: all {total} runs of all designs have a score."
    parts = []
    for fate, name in FATES.items():
        count = sum(d.count(fate) for d in designs)
        if not count:
            continue
        per = [
            f"{e} {n}{_only_on(designs, e, fate) if n > 1 else ''}"
            for e in dict.fromkeys(e for d in designs for e in d.estimators)
            if (n := sum(d.count(fate, None, d.estimators.index(e)) for d in designs if e in d.estimators))
        ]
        separator = "; " if any("," in text for text in per) else ", "
        parts.append(f"{name} in {count} ({separator.join(per)})")
    return f"Of {total} runs of all designs, {'; '.join(parts)}. They are in no box and no median."


def _only_on(designs: Sequence[Design], estimator: str, fate: int) -> str:
    """Name the drive on which an estimator lost its runs, if there is only one of several."""
    where = {
        d.drives[k]
        for d in designs
        if estimator in d.estimators
        for k in np.flatnonzero((d.status[:, d.estimators.index(estimator)] == fate).any(axis=(0, 2, 3)))
    }
    several = any(len(d.drives) > 1 for d in designs)
    return f", all on {where.pop()}" if several and len(where) == 1 else ""


def _consistent(findings: Findings, histories: Sequence[xr.Dataset]) -> str:
    """Say what the stated covariances are worth where plant and belief agree, and where they are worst."""
    home = _home(findings)
    told = [_as_stated(findings, home)] if home is not None else []
    ratios = np.array(
        [
            [findings.consistency("nees", b, e).ratio for e in findings.with_covariance]
            for b in range(len(findings.design.bands))
        ]
    )
    if np.isfinite(ratios).any():
        band, place = (int(k) for k in np.unravel_index(int(np.nanargmax(ratios)), ratios.shape))
        if band != home:
            told += _worst_stated(findings, band, findings.with_covariance[place], histories)
    return " ".join(text for text in told if text)


def _as_stated(findings: Findings, band: int) -> str:
    """Say whether the errors of a band are as large as the estimators state."""
    design = findings.design
    meaning = {
        "consistent": "as large as stated",
        "over-confident": "larger than stated",
        "cautious": "smaller than stated",
    }
    groups: dict[str, list[str]] = {}
    for e in findings.with_covariance:
        c = findings.consistency("nees", band, e)
        if np.isfinite(c.ratio):
            high, runs = findings.alone(band, e)
            few = f" through {high} of {runs} runs" if c.verdict == "over-confident" and 2 * high < runs else ""
            groups.setdefault(meaning[c.verdict], []).append(f"{design.estimators[e]} {number(c.ratio)}{few}")
    parts = [f"{size} ({', '.join(members)})" for size, members in groups.items()]
    if not parts:
        return ""
    where = _capital(at(design, band))
    return f"{where} the errors of the states are {listed(parts)}; 1 would be exactly as stated (NEES)."


def _worst_stated(findings: Findings, band: int, e: int, histories: Sequence[xr.Dataset]) -> list[str]:
    """Say what the largest NEES means in standard deviations, for a drawn run, and for who watches innovations."""
    design = findings.design
    name, label = design.estimators[e], design.bands[band]
    c, innovation = findings.consistency("nees", band, e), findings.consistency("nis", band, e)
    if not c.ratio > c.upper:
        return [f"Nowhere is it much larger (at most {number(c.ratio)}, {name} at {label})."]
    told = [
        f"At {label} it is {number(c.ratio)} for {name}: taken over all states the errors are about "
        f"{number(float(np.sqrt(c.ratio)), 2)} times the standard deviation that {name} states (the square root)."
    ]
    run = next(
        (h for h in histories if (h.attrs["design"], words(h.attrs["band_label"])) == (design.name, label)), None
    )
    shares = {} if run is None else inside(run, name)
    if run is not None and shares:
        quantity, share = min(((q, shares[q.name]) for q in design.targets if q.name in shares), key=lambda i: i[1])
        if share < SURE:
            told.append(
                f"In the run drawn at {label} the true {quantity.words} lies within ± 2σ of the estimate in only "
                f"{100 * share:.0f} % of the samples (95 % expected): the filter is over-confident."
            )
    if abs(innovation.ratio - 1.0) < 0.1:
        told.append(
            f"The innovations do not reveal it: NIS there is {innovation.ratio:.2f} times its expectation, so a "
            "monitor of the innovations raises no alarm."
        )
    elif innovation.ratio > innovation.upper:
        told.append(f"The innovations reveal it: NIS there is {number(innovation.ratio)} times its expectation.")
    return told
