"""The answer in numbers: the errors where plant and belief agree, at the ends of the range, and on the same runs."""

from __future__ import annotations

import numpy as np

from harness.models.quantities import listed
from harness.reporting.document import Sheet
from harness.reporting.style import in_unit, number, percent
from harness.study.report.analysis import Findings
from harness.study.report.sections import boxes, paired
from harness.study.results import Design


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
    return "whole box" if design.sampling == "saltelli" else design.bands[band]


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
