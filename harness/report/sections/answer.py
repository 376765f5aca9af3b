"""The answer in words; every number in it is computed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.report.analysis import Analysis, Findings, Paired
from harness.report.document import Block, Bullets, Heading, Prose, plain, strong
from harness.report.store import FATES, OK, PENDING, Design
from harness.report.style import number, probability, span, with_unit

_NAMED = 3  # up to so many estimators are all named in a sentence; of more, the best and the worst


def blocks(analysis: Analysis) -> list[Block]:
    """Return the answer: size and growth of the error, who is better, what was lost, what is believed."""
    findings = analysis.main
    items = []
    for target, quantity in enumerate(findings.design.targets):
        sentences = [*_errors(findings, target), *_better(findings, target)]
        items.append(f"{strong(_capital(quantity.words) + '.')} {plain(' '.join(sentences))}")
    items.append(f"{strong('Lost runs.')} {plain(_lost(analysis))}")
    if findings.with_covariance:
        items.append(f"{strong('Stated uncertainty.')} {plain(_consistent(findings))}")
    return [Heading("Answer"), Prose(plain(_scope(analysis))), Bullets(items)]


def _capital(text: str) -> str:
    return text[:1].upper() + text[1:]


def listed(parts: Sequence[str]) -> str:
    """Join with commas and ``and``."""
    return parts[0] if len(parts) == 1 else f"{', '.join(parts[:-1])} and {parts[-1]}"


def _scope(analysis: Analysis) -> str:
    design = analysis.main.design
    drives = f"{len(design.drives)} drive{'s' if len(design.drives) > 1 else ''}"
    varied = listed([f.words for f in design.factors]) if design.factors else "the setting"
    text = f"The words below are about the design “{design.name}”: {listed(design.estimators)}, {drives}, "
    if len(design.bands) > 1:
        text += f"{len(design.bands)} levels of {varied} ({design.bands[0]} to {design.bands[-1]}), "
    text += f"{design.planned} runs per level and estimator. Intervals are at 95 %."
    pending = sum(d.count(PENDING) for d in analysis.store.designs)
    if pending:
        text += f" The study is not finished: {pending} runs are still to come."
    return text


def _named(findings: Findings, target: int, band: int) -> list[int]:
    """Return the estimators named in a sentence."""
    medians = [s.median.value for s in findings.summaries[target][band]]
    known = [e for e, m in enumerate(medians) if np.isfinite(m)]
    if len(known) <= _NAMED:
        return known
    order = sorted(known, key=lambda e: medians[e])
    return [order[0], order[-1]]


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
    medians = np.array([[s.median.value for s in row] for row in table])
    sentences = []
    if home is not None and np.isfinite(medians[home]).any():
        parts = []
        for e in _named(findings, target, home):
            median = table[home][e].median
            interval = span(median.lower, median.upper, unit)
            parts.append(f"{with_unit(median.value, unit)} for {design.estimators[e]} ({interval})")
        if design.matched is None:
            where = f"At {design.bands[home]}"
        else:
            varied = listed([f.words for f in design.factors])
            where = f"With plant and belief alike in {varied} ({design.bands[home]})"
        sentences.append(f"{where} the median RMSE is {listed(parts)}.")
    for band in _extremes(design, medians, home):
        parts = []
        for e in _named(findings, target, band):
            text = f"{with_unit(medians[band, e], unit)} for {design.estimators[e]}"
            if home is not None and medians[home, e] > 0:
                text += f" ({number(medians[band, e] / medians[home, e], 2)} times as much)"
            parts.append(text)
        word = "it" if sentences else "the median RMSE"
        if parts:
            sentences.append(f"At {design.bands[band]} {word} is {listed(parts)}.")
        else:
            sentences.append(f"At {design.bands[band]} no run has a score.")
    return sentences


def _better(findings: Findings, target: int) -> list[str]:
    """Say which estimator is better on the same run and by how much, as believed and overall."""
    design = findings.design
    sentences = []
    home = design.matched
    for band in (None,) if home is None or len(design.bands) == 1 else (home, None):
        where = "Over all levels" if band is None and len(design.bands) > 1 else ""
        where = where or f"At {design.bands[band or 0]}"
        pairs = [findings.compared(target, a, b, band) for a, b in findings.pairs]
        pairs = [p for p in pairs if p.result.n]
        if len(pairs) <= _NAMED:
            sentences += [_difference(findings, p, where) for p in pairs]
        else:
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
            f"{with_unit(value, unit)}, {interval}; p = {_p(pair)})."
        )
    better, worse = (second, first) if value < 0 else (first, second)
    low, high = sorted([abs(lower), abs(upper)])
    interval = span(low, high, unit) if lower * upper > 0 else f"difference {interval}"
    wins = pair.result.wins if value < 0 else 1.0 - pair.result.wins
    return (
        f"{where} {better} is better than {worse} by {with_unit(abs(value), unit)} ({interval}) on the "
        "same run, "
        f"in {100 * wins:.0f} % of {pair.result.n} runs (p {_p(pair, ' ')})."
    )


def _p(pair: Paired, equals: str = "") -> str:
    text = probability(pair.p_corrected)
    return text if text.startswith("<") or not equals else f"= {text}"


def _standing(findings: Findings, pairs: list[Paired], where: str) -> str:
    """Sort many estimators into better than, worse than and not told apart from the first."""
    names = findings.design.estimators
    groups: dict[str, list[str]] = {"better": [], "worse": [], "not told apart": []}
    for pair in pairs:
        value = pair.result.difference.value
        key = "not told apart" if not pair.shown else ("better" if value < 0 else "worse")
        groups[key].append(names[pair.second])
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
            f"{e} {n}"
            for e in dict.fromkeys(e for d in designs for e in d.estimators)
            if (n := sum(d.count(fate, None, d.estimators.index(e)) for d in designs if e in d.estimators))
        ]
        parts.append(f"{name} in {count} ({', '.join(per)})")
    return f"Of {total} runs of all designs, {'; '.join(parts)}. They are in no box and no median."


def _consistent(findings: Findings) -> str:
    design = findings.design
    home = _home(findings)
    sentences = []
    states = [(e, design.estimators[e]) for e in findings.with_covariance]
    for score, title in (("nees", "NEES"), ("nis", "NIS")):
        bands = range(len(design.bands)) if home is None else (home,)
        for band in bands if home is not None else ():
            parts = []
            for e, name in states[:_NAMED]:
                c = findings.consistency(score, band, e)
                if np.isfinite(c.ratio):
                    parts.append(f"{number(c.ratio)} times for {name} ({c.verdict})")
            if parts:
                sentences.append(f"At {design.bands[band]} {title} is {listed(parts)} its expectation.")
        ratios = np.array(
            [[findings.consistency(score, b, e).ratio for e, _ in states] for b in range(len(design.bands))]
        )
        if len(design.bands) > 1 and np.isfinite(ratios).any():
            worst, which = np.unravel_index(int(np.nanargmax(ratios)), ratios.shape)
            sentences.append(
                f"The largest {title} is {number(float(ratios[worst, which]))} times its expectation "
                f"({states[int(which)][1]} at {design.bands[int(worst)]})."
            )
    return " ".join(sentences)
