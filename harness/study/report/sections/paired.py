"""Paired differences between estimators: every estimator saw the same drive, noise and Sobol point."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from harness.reporting import style
from harness.reporting.document import Block, Heading, Picture, Prose, Sheet, plain
from harness.study.report.analysis import Analysis, Findings, Paired
from harness.study.report.sections.boxes import foot, label_levels, row_height


def blocks(analysis: Analysis) -> list[Block]:
    """Return figure and table of the differences of every design; nothing for a single estimator."""
    if not any(findings.pairs for findings in analysis.findings):
        return []
    found: list[Block] = [Heading("Which estimator is better, run by run?")]
    for number, findings in enumerate(analysis.levelled):
        if number == 0:
            found.append(Prose(_explain(findings)))
        found += _pictures(analysis, findings)
        found += [_table(findings, target) for target in range(len(findings.design.targets))]
    return found


def _explain(findings: Findings) -> str:
    names = findings.design.estimators
    text = (
        "Each difference is taken within one run, so what the runs have in common (drive, noise, factor) cancels. The "
        "p-value is that of a two-sided Wilcoxon signed-rank test, corrected by Holm for all comparisons of the "
        "design. The drives are chosen, not drawn at random: interval and p-value speak of these drives with other "
        "noise, not of driving at large."
    )
    if len(findings.design.bands) > 1:
        text += " All levels: the mean error of a run over the levels, which share its noise."
    if len(names) > 2:
        text += f" With {len(names)} estimators, each is compared with the best, {names[findings.reference]}."
    return plain(text)


def _pictures(analysis: Analysis, findings: Findings) -> list[Block]:
    targets = range(len(findings.design.targets))
    per_page = int((style.TALLEST - 0.7 - foot(findings.design)) // row_height(findings.design))
    starts = range(0, len(targets), per_page)
    return [_picture(analysis, findings, list(targets[start : start + per_page])) for start in starts]


def _picture(analysis: Analysis, findings: Findings, targets: list[int]) -> Picture:
    design = findings.design
    names = design.estimators
    if len(names) == 2:
        question = f"Is {names[1]} better than {names[0]} on the same run?"
    else:
        question = f"Is an estimator better than {names[findings.reference]} on the same run?"
    with style.drawing():
        fig = style.figure(0.25 + foot(design) + row_height(design) * len(targets))
        rows = fig.subplots(len(targets), 1, sharex=True, squeeze=False)[:, 0]
        for axes, t in zip(rows, targets, strict=True):
            _differences(axes, analysis, findings, t)
        label_levels(rows[-1], design)
        handles = []
        for a, b in findings.pairs:
            look = analysis.looks[names[b]]
            label = f"{names[b]} − {names[a]}"
            handles.append(Line2D([], [], color=look.line, marker=look.marker, ls="-", label=label))
        style.head(fig, question, handles)
        svg = style.svg(fig)
    caption = (
        "Median of the paired differences of RMSE with its 95 % bootstrap interval; below zero the estimator "
        "named first is better. Filled: p < 0.05 after Holm's correction; open: no difference shown."
    )
    return Picture(svg, caption, question)


def _differences(axes: Axes, analysis: Analysis, findings: Findings, target: int) -> None:
    design = findings.design
    style.mark_matched(axes, design.matched)
    axes.axhline(0.0, color="black", lw=0.8)
    count = len(findings.pairs)
    for number, (a, b) in enumerate(findings.pairs):
        look = analysis.looks[design.estimators[b]]
        offset = (number - (count - 1) / 2) * 0.8 / max(count, 2)
        found = [findings.compared(target, a, b, band) for band in range(len(design.bands))]
        values, low, high = np.array([c.result.difference for c in found]).T
        places = np.arange(len(found)) + offset
        name = design.estimators[b]
        style.mark(axes.vlines(places, low, high, color=look.line, lw=1.4), name)
        unit = design.targets[target].unit
        for place, value, one, band in zip(places, values, found, design.bands, strict=True):
            face = look.line if one.shown else "white"
            points = axes.plot(place, value, look.marker, ms=5.5, mec=look.line, mfc=face)
            told = f"{name} − {design.estimators[a]}, {band}: {style.with_unit(value, unit)} "
            style.mark(points, name, f"{told}({style.span(one.result.difference[1], one.result.difference[2], unit)})")
    quantity = design.targets[target]
    axes.set_ylabel(f"difference of RMSE{style.in_unit(quantity.unit)}")
    axes.set_title(quantity.words, loc="left")
    axes.grid(axis="y")


def _table(findings: Findings, target: int) -> Sheet:
    design = findings.design
    rows: list[list[str]] = []
    last: tuple[int, int] | None = None
    for c in findings.comparisons:
        if c.target != target or c.band not in findings.told:
            continue
        pair = (c.first, c.second)
        label = f"{design.estimators[c.second]} − {design.estimators[c.first]}"
        level = "all" if c.band is None else design.bands[c.band]
        rows.append(["" if pair == last else label, level, str(c.result.n), *_numbers(c)])
        last = pair
    header = ["difference", "level", "pairs", "median", "its 95 % interval", "of the RMSE", "better in", "p (Holm)"]
    quantity = design.targets[target]
    caption = (
        f"Paired differences of the RMSE of {quantity.words}{style.in_unit(quantity.unit)}, design “{design.name}”. Of "
        "the RMSE: the median difference in percent of the median RMSE of the estimator named last. Better in: share "
        "of the runs in which the estimator named first has the smaller error."
    )
    return Sheet(header, rows, caption, left=2)


def _numbers(c: Paired) -> list[str]:
    if not c.result.n:
        return ["–"] * 5
    value, lower, upper = c.result.difference
    wins = f"{100 * c.result.wins:.0f} %"
    return [
        style.number(value),
        style.span(lower, upper),
        style.percent(c.relative),
        wins,
        style.probability(c.p_corrected),
    ]
