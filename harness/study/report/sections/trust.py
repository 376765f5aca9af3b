"""How often trust monitors are right: sentences, curves of detection over false alarms, and counts by level."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from harness.models.quantities import capital, quantity
from harness.reporting import style
from harness.reporting.document import Block, Bullets, Drawing, Heading, Prose, Sheet, plain
from harness.reporting.style import Look, number, percent, span, with_unit
from harness.study.report.analysis import Analysis
from harness.study.trust_file import EstimatorTrust, LevelTrust, StudyTrust

_BESIDE = 2
"""Panels side by side."""


def blocks(analysis: Analysis) -> list[Block]:
    """Return sentences, figures and tables of the monitors that were counted; nothing where none was asked for."""
    trust = analysis.store.trust
    if trust is None:
        return []
    text = (
        "A trust monitor watches averages of the innovations and of their normalised square (NIS) within a window, and "
        "the envelope of what was driven as believed (docs/monitor.md); its bounds are set by false alarms."
    )
    content: list[Block] = [Prose(plain(text))]
    for each in trust.estimators:
        content += [Heading(each.estimator, 2), Bullets([plain(sentence) for sentence in each.says])]
    return [*content, *figures(trust), *tables(trust)]


def share(value: float) -> str:
    """Write a share in percent, a dash where there is none."""
    return percent(value) if value == value else "–"


def delay(seconds: float) -> str:
    """Write a delay; ``never`` where no alarm follows in half of the runs."""
    return "–" if np.isnan(seconds) else with_unit(seconds, "s") if np.isfinite(seconds) else "never"


def area(level: LevelTrust) -> str:
    """Write the area under the curve of a level with its interval."""
    value, low, high = level.area
    return f"{number(value, 2)} ({number(low, 2)} to {number(high, 2)})" if value == value else "–"


def limit_of(target: str, limit: float) -> str:
    """Write the error of a target that matters."""
    shown = quantity(target)
    return f"{limit * shown.scale:.4g}{'' if shown.unit in ('°', '') else ' '}{shown.unit}"


def beyond(target: str, limit: float) -> str:
    """Say that a target is wrong."""
    return f"the {quantity(target).words} is wrong by more than {limit_of(target, limit)}"


def figures(trust: StudyTrust) -> list[Block]:
    """Return a figure of each target with errors: a panel for each estimator, a curve for each level."""
    counted = [each for each in trust.estimators if each.targets]
    content: list[Block] = []
    for t, target in enumerate(counted[0].targets if counted else ()):
        shown = [each for each in counted if each.targets[t].drawn]
        if shown:
            caption = (
                "Share of the samples in error that have more evidence against the belief than a bound, over the share "
                "of those without error where all is as believed, for every bound (ROC); point: the bound of the "
                "monitor. On the dashed line evidence says nothing. Whether an alarm follows within some seconds does "
                "not count here."
            )
            alt = f"Detection of errors of the {quantity(target.target).words} over false alarms"
            content.append(Drawing(partial(_draw, shown, t), caption, alt))
    return content


def _draw(counted: Sequence[EstimatorTrust], t: int) -> bytes:
    names = list(dict.fromkeys(level.label for each in counted for level in each.targets[t].drawn))
    looks = style.looks(names)
    columns = min(len(counted), _BESIDE)
    rows = -(-len(counted) // columns)
    with style.drawing():
        fig = style.figure(style.HALF if len(counted) == 1 else min(3.3 * rows + 0.6, style.TALLEST))
        panels = fig.subplots(rows, columns, squeeze=False).ravel()
        for axes, each in zip(panels, counted, strict=False):
            _curves(axes, each, t, looks)
            if len(counted) > 1:
                axes.set_title(each.estimator, loc="left")
        for axes in panels[len(counted) :]:
            axes.remove()
        handles = [
            Line2D([], [], color=looks[n].line, ls=looks[n].dashes, marker=looks[n].marker, mfc=looks[n].face, label=n)
            for n in names
        ]
        target = counted[0].targets[t]
        limit = limit_of(target.target, target.limit)
        question = f"Do the innovations show that {beyond(target.target, target.limit)}?"
        style.head(fig, question.replace(limit, limit.replace(" ", "\N{NO-BREAK SPACE}")), handles)
        return style.svg(fig)


def _curves(axes: Axes, trust: EstimatorTrust, t: int, looks: dict[str, Look]) -> None:
    """Draw a curve for each level of an estimator."""
    target = trust.targets[t]
    at = len(target.false) // 2  # of the bound: evidence is 1
    for level in target.drawn:
        look = looks[level.label]
        text = f"{level.label}: area {number(level.area.value, 2)} ({span(level.area.lower, level.area.upper)})"
        with style.series(axes, level.label):
            axes.plot(target.false, level.detected, color=look.line, ls=look.dashes)
            (point,) = axes.plot(
                target.false[at], level.detected[at], marker=look.marker, color=look.face, mec=look.line, ls=""
            )
            style.mark(point, level.label, text)
    axes.plot([0, 1], [0, 1], color=style.MEASURED, ls=(0, (4, 3)), zorder=0)
    axes.set_xlim(-0.01, 1.01)
    axes.set_ylim(-0.01, 1.01)
    axes.set_xlabel("share of samples without error, as believed")
    axes.set_ylabel("share of samples in error")
    axes.grid()


def tables(trust: StudyTrust) -> list[Block]:
    """Return a table for each estimator and target: a row for what is as believed, and for each level."""
    within = f"{trust.within:g} s"
    content: list[Block] = []
    header = ["design", "level", "in error", f"said within {within}", "not trusted", "delay", "area", "alarm, no error"]
    for each in trust.estimators:
        for target in each.targets:
            rows = [
                [level.design or "–", level.label, share(level.wrong), share(level.said), share(level.distrusted),
                 delay(level.delay), area(level), share(level.false)]
                for level in (*target.believed, *target.levels)
            ]  # fmt: skip
            caption = (
                f"{each.estimator}, {quantity(target.target).words}, of which an error above "
                f"{limit_of(target.target, target.limit)} matters."
            )
            if not content:
                caption += (
                    f" Share of the samples in error; of these, at which an alarm stands or begins within {within}, "
                    "and at which the estimate is not trusted at once for any reason (level 1 or 2); delay of the "
                    "first alarm behind the first error, median over runs (never: in half of them none follows); area "
                    "under the curve with its interval at 95 % (whole runs drawn with replacement); and share of the "
                    "samples without error that are in an alarm."
                )
            content.append(Sheet(header, rows, capital(caption), left=2))
    return content
