"""Paired ratios of errors of two estimators: every estimator saw the same drive, noise and Sobol point."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from harness.reporting import style
from harness.reporting.document import Block, Picture, Prose, Sheet, plain
from harness.study.report.analysis import Analysis, Findings, Paired
from harness.study.report.sections.boxes import Panel, arranged, framed

_SIDE_BY_SIDE = 72  # markers across the page that do not cover each other
_SPREAD = 4.0  # largest ratio over the smallest from which an axis is logarithmic


def blocks(analysis: Analysis) -> list[Block]:
    """Return figure and table of the ratios of every design; nothing for a single estimator."""
    if not any(findings.pairs for findings in analysis.findings):
        return []
    content: list[Block] = []
    for number, findings in enumerate(analysis.levelled):
        if number == 0:
            content.append(Prose(_explain(findings)))
        content += _pictures(analysis, findings)
        content += [_table(findings, target) for target in range(len(findings.design.targets))]
    return content


def few(findings: Findings) -> str:
    """Say what the tests of a design can show at best, where that is nothing; else nothing."""
    if not findings.pairs or findings.decides:
        return ""
    most = max(c.result.n for c in findings.comparisons)
    tests = sum(c.result.n > 0 for c in findings.comparisons)
    return (
        f"With {most} pairs of runs and {tests} comparisons no test can show a difference between estimators (that "
        f"takes {findings.pairs_needed} pairs): read the ratio of their errors and in how many runs it is below one."
    )


def _explain(findings: Findings) -> str:
    names = findings.design.estimators
    text = (
        "Each ratio is taken within one run, so what the runs have in common (drive, noise, factor) cancels. The "
        "drives are chosen, not drawn at random: intervals and p-values speak of these drives with other noise, not of "
        "driving at large. "
    )
    text += few(findings) or (
        "The p-value is that of a two-sided Wilcoxon signed-rank test of the log ratio, corrected by Holm for all "
        "comparisons of the design."
    )
    if len(findings.design.bands) > 1:
        text += " All levels: the mean error of a run over the levels, which share its noise."
    if len(names) > 2:
        text += f" With {len(names)} estimators, each is compared with the best, {names[findings.reference]}."
    return plain(text)


def _pictures(analysis: Analysis, findings: Findings) -> list[Block]:
    figures, height = arranged(findings.design, _SIDE_BY_SIDE)
    return [_picture(analysis, findings, panels, height) for panels in figures]


def _picture(analysis: Analysis, findings: Findings, panels: list[Panel], height: float) -> Picture:
    names = findings.design.estimators
    first = names[findings.pairs[0][0]]
    handles = [
        Line2D([], [], color=look.line, marker=look.marker, ls="-", label=f"{names[b]} / {first}")
        for _, b in findings.pairs
        for look in [analysis.looks[names[b]]]
    ]
    question = f"Is {names[1] if len(names) == 2 else 'an estimator'} better than {first} on the same run?"
    svg = framed(
        findings, panels, height, lambda axes, panel: _ratios(axes, analysis, findings, panel), question, handles
    )
    caption = (
        f"Error over that of {first} on the same run: median with its 95 % bootstrap interval; below one the other is "
        "better."
    )
    if findings.decides:
        caption += " Filled: p < 0.05 after Holm's correction; open: no difference shown."
    return Picture(svg, caption, question)


def _ratios(axes: Axes, analysis: Analysis, findings: Findings, panel: Panel) -> None:
    design, quantity = findings.design, findings.design.targets[panel.target]
    style.mark(axes.axhline(1.0, color="black", lw=0.8), "", "no difference")
    count = len(findings.pairs)
    of_all = [c.result.ratio for c in findings.comparisons if c.target == panel.target and c.band is not None]
    ends = np.array([1.0, *(v for ratio in of_all for v in ratio if 0 < v < np.inf)])
    if ends.max() > _SPREAD * ends.min():
        style.logarithmic(axes, float(ends.min()), float(ends.max()))
        style.rescalable(axes)
    else:
        room = 0.12 * max(np.ptp(ends), 1e-3)
        axes.set_ylim(ends.min() - room, ends.max() + room)
    for number, (a, b) in enumerate(findings.pairs):
        name, look = design.estimators[b], analysis.looks[design.estimators[b]]
        for band in panel.levels:
            pair = findings.compared(panel.target, a, b, band)
            place = band + (number - (count - 1) / 2) * 0.8 / max(count, 2)
            value, low, high = pair.result.ratio
            if np.isinf(value) or value == 0:
                lost = name if value else design.estimators[a]
                style.mark(style.at_edge(axes, place, f"{lost} diverged", look, top=bool(value)), name)
                continue
            interval = axes.vlines(place, low, min(high, 2 * axes.get_ylim()[1]), color=look.line, lw=1.4)
            face = look.line if pair.shown or not findings.decides else "white"
            points = axes.plot(place, value, look.marker, ms=5.5, mec=look.line, mfc=face)
            words = f"{name} / {design.estimators[a]}, {design.bands[band]}: {', '.join(_numbers(pair)[:3])}"
            style.mark([interval, *points], name, words)
    axes.set_ylabel(f"RMSE over that of\n{design.estimators[findings.pairs[0][0]]}")
    axes.set_title(quantity.words, loc="left")


def _table(findings: Findings, target: int) -> Sheet:
    design = findings.design
    rows: list[list[str]] = []
    last: tuple[int, int] | None = None
    for c in findings.comparisons:
        if c.target != target or c.band not in findings.told:
            continue
        pair = (c.first, c.second)
        label = f"{design.estimators[c.second]} / {design.estimators[c.first]}"
        level = "all" if c.band is None else design.bands[c.band]
        rows.append(["" if pair == last else label, level, *_numbers(c)[: 4 if findings.decides else 3]])
        last = pair
    header = ["ratio", "level", "median", "its 95 % interval", "smaller in"] + ["p (Holm)"] * findings.decides
    caption = (
        f"Ratio of the RMSE of {design.targets[target].words} on the same run, design “{design.name}”. Smaller in: the "
        "runs in which the estimator named first has the smaller error."
    )
    return Sheet(header, rows, caption, left=2)


def _numbers(pair: Paired) -> list[str]:
    """Return ratio, interval, runs in which it is below one, and p-value in words."""
    result = pair.result
    if not result.n:
        return ["–"] * 4
    value, lower, upper = result.ratio
    interval = "–" if np.isnan(lower) else style.span(lower, upper)
    return [style.number(value), interval, f"{result.wins} of {result.n}", style.probability(pair.p_corrected)]
