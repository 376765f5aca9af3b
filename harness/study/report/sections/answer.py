"""The answer in words; every number in it is computed."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import xarray as xr

from harness.models.quantities import capital, listed, words
from harness.reporting.document import Block, Bullets, Prose, Sheet, plain, strong
from harness.reporting.style import in_unit, number, percent
from harness.study.report.analysis import Analysis, Findings
from harness.study.report.opening import at, sentences
from harness.study.report.overall import standings
from harness.study.report.ranking import limits_of, tolerances
from harness.study.report.sections import boxes, exceedance, inputs, overview, paired, sensitivity, shares, tolerance
from harness.study.report.sections.history import inside
from harness.study.results import Design
from harness.study.run_file import LOST
from harness.study.score_names import ESTIMATOR_DIVERGED, PENDING

SURE = 0.5  # share within ± 2σ below which an estimator is over-confident


def blocks(analysis: Analysis, opening: Sequence[Block] = ()) -> list[Block]:
    """Return the answer: in a sentence, in a figure, in a table, and what is to be said of lost runs and covariances.

    Args:
        analysis: Of the study.
        opening: Blocks that follow the sentence.
    """
    findings = analysis.main
    items = [f"{strong('Inputs.')} {plain(text)}" for text in inputs.in_short(findings)]
    items.append(f"{strong('Diverged runs.')} {plain(_lost(analysis))}")
    best, harms, counts = sentences(analysis)
    opening_sentences: list[Block] = [Prose(strong(" ".join(best or harms[:1])))]
    further = harms if best else harms[1:]
    if findings.with_covariance:
        stated, at_worst = _consistent(findings, analysis.store.histories)
        counts += [stated] if stated else []
        items += [f"{strong('Stated uncertainty.')} {plain(at_worst)}"] if at_worst else []
    if further or counts:
        opening_sentences.append(Bullets([plain(text) for text in (*further, *counts)]))
    figures = overview.pictures(analysis) or boxes.pictures(analysis, findings, opening=True)
    return [
        *opening_sentences,
        *opening,
        *_of_the_box(analysis),
        Prose(plain(" ".join(filter(None, [_scope(analysis), few(findings)])))),
        *figures,
        *_standings(analysis),
        table(findings),
        Bullets(items),
    ]


def _standings(analysis: Analysis) -> list[Block]:
    """Return what every estimator bears of every design; nothing of a single design or estimator."""
    of_targets = standings(analysis.findings, limits_of(analysis.store.attributes))
    designs = [f.design for f in of_targets[0].designs]
    names = designs[0].estimators
    if len(designs) == 1 or len(names) == 1:
        return []
    several, rows = len(of_targets) > 1, []
    quantities = [f"{q.words}{in_unit(q.unit)}" for q in designs[0].targets]
    for place, design in enumerate(designs):
        for standing in of_targets:
            cells = zip(standing.area[place], standing.worst[place], strict=True)
            sizes = [_two(mean, worst, len(design.bands)) for mean, worst in cells]
            target = [quantities[standing.target]] if several else []
            rows.append(["" if standing.target else design.name, *target, *sizes])
    subject = "" if several else f" of the {quantities[0]}"
    caption = f"Median RMSE{subject}: in the mean over the levels of each design, and below it at the worst level."
    if any(np.isinf(s.worst).any() for s in of_targets):
        caption += " ∞: most runs diverged."
    if any(d.out_of_control[b].all() for d in designs for b in range(len(d.bands))):
        caption += " Levels at which the vehicle goes out of control in every run are left out."
    return [Sheet(["design", *(["target"] if several else []), *names], rows, caption, left=2 if several else 1)]


def _two(mean: float, worst: float, levels: int) -> str:
    """Return a mean over levels above the worst of them; one number of a single level."""
    if np.isnan(mean):
        return "–"
    return number(mean) if levels == 1 else f"{number(mean)}\n{number(worst)}"


def _of_the_box(analysis: Analysis) -> list[Block]:
    """Say of a study of all factors at once which of them drive the error, and how far all may drift together."""
    boxes = [f for f in analysis.findings if f.design.sampling == "saltelli" and not f.design.count(PENDING)]
    items = [("What drives the error?", " ".join(sensitivity.in_short(f.ranking))) for f in boxes]
    whole = [f for f in analysis.findings if f.design.sampling == "population" and not f.design.count(PENDING)]
    within = {f.design.name: f" in “{f.design.name}”" if len(whole) > 1 else "" for f in whole}
    items += [
        (f"How often is a limit exceeded{within[f.design.name]}?", " ".join(exceedance.in_short(f.population)))
        for f in whole
    ]
    items += [("How rare?", " ".join(exceedance.rare(analysis, f.design))) for f in whole]
    items += [("How much remains?", " ".join(exceedance.narrowed([f.population for f in whole])))]
    items += [("How wrong over all models?", " ".join(exceedance.mixed([f.population for f in whole])))]
    items += [
        (f"What makes the error vary{within[f.design.name]}?", " ".join(shares.in_short(f.population))) for f in whole
    ]
    limits = limits_of(analysis.store.attributes)
    for nested in (d for d in analysis.store.designs if d.sampling == "tolerance" and not d.count(PENDING)):
        limits_borne = tolerance.told(nested, limits, tolerances(nested, limits))
        borne = " ".join(f"For the {target.words}: {text}" for target, text in limits_borne)
        items.append(("How far may all factors drift?", borne))
    shown = [f"{strong(question)} {plain(text)}" for question, text in items if text]
    return [Bullets(shown)] if shown else []


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
    return f" The plant is {plant}, the estimators believe {belief}: the models differ also where the values agree."


def _lost(analysis: Analysis) -> str:
    """Say in how many runs each estimator diverged while the vehicle was under control, and what that means."""
    designs = analysis.store.designs
    per = [
        f"{e} in {n}{_only_on(designs, e) if n > 1 else ''}"
        for e in dict.fromkeys(e for d in designs for e in d.estimators)
        if (n := sum(d.count(ESTIMATOR_DIVERGED, None, d.estimators.index(e)) for d in designs if e in d.estimators))
    ]
    foreign = analysis.store.run.get(LOST)
    because = f" Plants and estimators of somebody else lost runs: {foreign}." if foreign else ""
    if not per:
        return f"None.{because}"
    return f"{'; '.join(per)}. They count as larger than any other error.{because}"


def _only_on(designs: Sequence[Design], estimator: str) -> str:
    """Name the drive on which an estimator diverged, if there is only one of several."""
    where = {
        d.drives[k]
        for d in designs
        if estimator in d.estimators
        for k in np.flatnonzero((d.status[:, d.estimators.index(estimator)] == ESTIMATOR_DIVERGED).any(axis=(0, 2, 3)))
    }
    several = any(len(d.drives) > 1 for d in designs)
    return f", all on {where.pop()}" if several and len(where) == 1 else ""


def _consistent(findings: Findings, histories: Sequence[xr.Dataset]) -> tuple[str, str]:
    """Say what the stated covariances are worth where plant and belief agree, and where they are worst."""
    start = home(findings)
    sentences: list[str] = []
    ratios = np.array(
        [
            [findings.consistency("nees", b, e).ratio for e in findings.with_covariance]
            for b in range(len(findings.design.bands))
        ]
    )
    if np.isfinite(ratios).any():
        band, place = (int(k) for k in np.unravel_index(int(np.nanargmax(ratios)), ratios.shape))
        if band != start:
            sentences += _worst_stated(findings, band, findings.with_covariance[place], histories)
    return "" if start is None else _as_stated(findings, start), " ".join(sentences)


def _as_stated(findings: Findings, band: int) -> str:
    """Say whether the errors of a band are as large as the estimators state."""
    design = findings.design
    meaning = {
        "consistent": "as large as",
        "over-confident": "larger than",
        "cautious": "smaller than",
    }
    groups: dict[str, list[str]] = {}
    for e in findings.with_covariance:
        c = findings.consistency("nees", band, e)
        if np.isfinite(c.ratio):
            high, runs = findings.alone(band, e)
            few = f" through {high} of {runs} runs" if c.verdict == "over-confident" and 2 * high < runs else ""
            groups.setdefault(meaning[c.verdict], []).append(f"{design.estimators[e]} {number(c.ratio)}{few}")
    parts = [f"{size} the covariance states ({', '.join(members)})" for size, members in groups.items()]
    if not parts:
        return ""
    where = capital(at(design, band))
    return f"{where} the errors of the states are {listed(parts)}, by NEES over its expectation."


def _worst_stated(findings: Findings, band: int, e: int, histories: Sequence[xr.Dataset]) -> list[str]:
    """Say what the largest NEES means in standard deviations, for a drawn run, and for who watches innovations."""
    design = findings.design
    name, label = design.estimators[e], design.bands[band]
    c, innovation = findings.consistency("nees", band, e), findings.consistency("nis", band, e)
    if not c.ratio > c.upper:
        return [f"NEES is nowhere much larger (at most {number(c.ratio)} times its expectation, {name} at {label})."]
    sentences = [
        f"At {label} NEES is {number(c.ratio)} times its expectation for {name}: taken over all states the errors are "
        f"about {number(float(np.sqrt(c.ratio)), 2)} times the standard deviation that {name} states (the square root)."
    ]
    run = next(
        (h for h in histories if (h.attrs["design"], words(h.attrs["band_label"])) == (design.name, label)), None
    )
    shares = {} if run is None else inside(run, name)
    if run is not None and shares:
        quantity, share = min(((q, shares[q.name]) for q in design.targets if q.name in shares), key=lambda i: i[1])
        if share < SURE:
            sentences.append(
                f"In the run drawn at {label} the true {quantity.words} lies within ± 2σ of the estimate in only "
                f"{100 * share:.0f} % of the samples (95 % expected): the filter is over-confident."
            )
    if abs(innovation.ratio - 1.0) < 0.1:
        sentences.append(
            f"The innovations do not reveal it: NIS there is {innovation.ratio:.2f} times its expectation, so a "
            "monitor of the innovations raises no alarm."
        )
    elif innovation.ratio > innovation.upper:
        sentences.append(f"The innovations reveal it: NIS there is {number(innovation.ratio)} times its expectation.")
    return sentences


def home(findings: Findings) -> int | None:
    """Return the band that others are compared with: the matched one, or the only one."""
    if findings.design.matched is None and len(findings.design.bands) == 1:
        return 0
    return findings.design.matched


def table(findings: Findings) -> Sheet:
    """Return the table that the answer rests on: targets and estimators down, levels and comparisons across."""
    design, start = findings.design, home(findings)
    ends = _ends(findings, start)
    lost = [design.diverged(e) for e in range(len(design.estimators))]
    bands_told = findings.told if findings.pairs else []
    header = ["target", "estimator"]
    header += [_level(design, start)] if start is not None else []
    header += [_level(design, band) for band in ends]
    header += [f"same run, {_where(design, band)}" for band in bands_told]
    header += ["diverged"] if any(lost) else []
    rows = []
    for target, quantity in enumerate(design.targets):
        for e, name in enumerate(design.estimators):
            row = ["" if e else f"{quantity.words}{in_unit(quantity.unit)}", name]
            row += [_at_home(findings, target, start, e)] if start is not None else []
            row += [_grown(findings, target, start, band, e) for band in ends]
            row += [_compared(findings, target, band, e) for band in bands_told]
            row += [str(lost[e])] if any(lost) else []
            rows.append(row)
    return Sheet(header, rows, _caption(findings, start, ends, any(lost)), left=2)


def few(findings: Findings) -> str:
    """Say how well a design of few runs knows a median, and what its tests can show; nothing of one with enough."""
    design = findings.design
    summaries = [s for table in findings.summaries for row in table for s in row if s.n]
    if not summaries or max(s.n for s in summaries) >= boxes.FEW:
        return paired.few(findings)
    ends = np.array([s.median[1:] for s in summaries])
    with np.errstate(invalid="ignore"):  # both ends of the interval are infinite where runs diverged
        half = np.sqrt(ends[:, 1] / ends[:, 0]) - 1.0
    drives = "this drive" if len(design.drives) == 1 else "these drives"
    sure = (
        f"to about ± {percent(float(np.nanmedian(half)))} on {drives}"
        if np.isfinite(half).any()
        else "without interval"
    )
    text = f"So few runs give a median {sure} and tell nothing of other drives."
    return " ".join(filter(None, [text, paired.few(findings)]))


def _caption(findings: Findings, start: int | None, ends: list[int], lost: bool) -> str:
    design = findings.design
    text = "Median RMSE"
    if start is not None:
        text += f" {design.matched_is}" if design.matched is not None else ""
        text += f" ({design.bands[start]})" if len(design.bands) > 1 else ""
        text += " with its 95 % interval"
    if ends:
        varied = listed([f.words for f in design.factors])
        where = f"at the ends of the {varied}" if len(design.factors) == 1 else "at the level of the largest error"
        text += f", and {where}" + (" (times as much)" if start is not None else "")
    text += "."
    if findings.pairs:
        first = design.estimators[findings.pairs[0][0]]
        text += f" Same run: median of the error over that of {first}, and in how many runs it is smaller."
        if findings.decides:
            text += " n.s.: not significant, p of at least 0.05 after Holm's correction."
    if lost:
        text += " A run that diverged counts as larger than any other."
    if design.out_of_control.any():
        text += " Runs in which the vehicle went out of control count for no estimator."
    return text


def _ends(findings: Findings, start: int | None) -> list[int]:
    """Return the ends of a single factor's range, or else the band with the largest median of all."""
    design, medians = findings.design, findings.medians
    if len(design.factors) == 1:
        centres = (design.factors[0].lower + design.factors[0].upper) / 2
        ends = list(dict.fromkeys([int(np.argmin(centres)), int(np.argmax(centres))]))
    elif (~np.isnan(medians[0])).any():
        ends = [int(np.argmax(np.nanmax(np.where(np.isnan(medians[0]), -np.inf, medians[0]), axis=1)))]
    else:
        ends = []
    return [b for b in ends if b != start]


def _level(design: Design, band: int) -> str:
    return design.whole or design.bands[band]


def _where(design: Design, band: int | None) -> str:
    return "all levels" if band is None else _level(design, band)


def _at_home(findings: Findings, target: int, band: int, e: int) -> str:
    s = findings.summaries[target][band][e]
    if not s.n:
        return "–"
    between = "" if np.isnan(s.median.lower) else f" ({number(s.median.lower)} to {number(s.median.upper)})"
    return number(s.median.value) + between


def _grown(findings: Findings, target: int, start: int | None, band: int, e: int) -> str:
    medians = findings.medians[target]
    if start is None or not medians[start, e] > 0 or not np.isfinite(medians[band, e]):
        return number(medians[band, e])
    return f"{number(medians[band, e])} ({number(medians[band, e] / medians[start, e], 2)}×)"


def _compared(findings: Findings, target: int, band: int | None, e: int) -> str:
    """Return how many times the error of the estimator that all are compared with it is on the same run."""
    if e == findings.pairs[0][0]:
        return "reference"
    pair = findings.compared(target, *next(p for p in findings.pairs if p[1] == e), band)
    if not pair.result.n:
        return "–"
    text = f"{number(pair.result.ratio.value)} ({pair.result.wins}/{pair.result.n})"
    return text if pair.shown or not findings.decides else f"{text} n.s."
