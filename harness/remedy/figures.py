"""The figure to decide by: the box that every remedy tolerates, or its error over the levels."""

from __future__ import annotations

import textwrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from harness.models.quantities import listed, words
from harness.remedy.choices import AS_IT_IS
from harness.remedy.judge import RemedyOutcome, harm
from harness.remedy.run import Tried
from harness.reporting import style
from harness.reporting.style import percent

MOST_DRAWN = 6
"""Remedies whose boxes are drawn, the best first; the table has all."""

_LINE = 0.165
_WIDTH = 50


def in_order(tried: Tried) -> list[RemedyOutcome]:
    """Return all outcomes, the one to take first, then by the harm that is left."""
    first = tried.outcomes[0]
    return [tried.best, *sorted((o for o in tried.outcomes if o is not tried.best), key=lambda o: harm(o, first))]


def boxes(tried: Tried) -> bytes:
    """Draw the boxes of the best remedies, of the study as it is, and with the parameters known, by target."""
    first = tried.outcomes[0]
    order = in_order(tried)[:MOST_DRAWN]
    shown = [*order, *([first] if first not in order else []), *([tried.ideal] if tried.ideal else [])]
    names = [first.targets[t].words for t in first.boxes]
    looks = style.looks(names)
    labels = [textwrap.wrap(_label(o, tried), _WIDTH) for o in shown]
    row = _LINE * max(2.3, *(len(lines) for lines in labels))
    high = 0.8 / len(names)
    with style.drawing():
        fig = style.figure(1.3 + row * len(shown))
        axes = fig.subplots()
        for k, (t, name) in enumerate(zip(first.boxes, names, strict=True)):
            with style.series(axes, name):
                values = [100 * o.boxes[t].box for o in shown]
                y = np.arange(len(shown)) - 0.4 + (k + 0.5) * high
                look = looks[name]
                axes.barh(y, values, 0.85 * high, color=look.tint, edgecolor=look.line, hatch=look.hatch, label=name)
                for value, place in zip(values, y, strict=True):
                    axes.text(value + 1, place, percent(value / 100), va="center", fontsize=7.5)
        axes.set_yticks(range(len(shown)), ["\n".join(lines) for lines in labels], fontsize=8)
        axes.invert_yaxis()
        axes.set_xlim(0, 108)
        axes.set_xticks(range(0, 101, 20))
        axes.set_xlabel("box that is tolerated, % of the way to the edges")
        axes.grid(axis="x")
        style.head(fig, "How far may everything drift together?", axes.get_legend_handles_labels()[0])
        return style.svg(fig)


def _label(o: RemedyOutcome, tried: Tried) -> str:
    label = o.remedy.phrase_with_sensors(tried.drivers)
    return f"to take: {label}" if o is tried.best and o is not tried.outcomes[0] else label


def levels(tried: Tried) -> bytes:
    """Draw the study as it is, the remedy to take, the best without a sensor, and the ideal, over the levels."""
    first = tried.outcomes[0]
    bare = [o for o in tried.outcomes if not o.remedy.added and o is not first]
    chosen = {AS_IT_IS.words: first}
    if bare:
        taken = min(bare, key=lambda o: harm(o, first))
        chosen[f"without a further sensor: {taken.remedy.phrase(tried.drivers)}"] = taken
    chosen[f"to take: {tried.best.remedy.phrase_with_sensors(tried.drivers)}"] = tried.best
    if tried.ideal:
        chosen["the same, parameters known"] = tried.ideal
    looks = style.looks(list(chosen))
    with style.drawing():
        fig = style.figure(1.1 + 2.2 * len(first.targets))
        panels = fig.subplots(len(first.targets), 1, sharex=True, squeeze=False)[:, 0]
        for t, axes in enumerate(panels):
            _panel(axes, t, chosen, looks, first)
        panels[-1].set_xticks(range(len(first.levels)), first.levels)
        handles = [
            Line2D([], [], color=looks[n].line, ls=looks[n].dashes, marker=looks[n].marker, label=n) for n in chosen
        ]
        drivers = listed([words(d) for d in tried.drivers])
        style.head(fig, f"How large is the error where the {drivers} differs from the belief?", handles)
        return style.svg(fig)


def _panel(
    axes: Axes, t: int, chosen: dict[str, RemedyOutcome], looks: dict[str, style.Look], first: RemedyOutcome
) -> None:
    style.mark_matched(axes, first.home)
    seen = []
    for name, o in chosen.items():
        values = np.where(np.isfinite(o.medians[t]), o.medians[t], np.nan)
        seen += [v for v in values if v > 0]
        with style.series(axes, name):
            axes.plot(
                range(len(values)), values, marker=looks[name].marker, ls=looks[name].dashes, color=looks[name].line
            )
    if seen:
        style.logarithmic(axes, min(seen), max(seen))
    axes.set_title(first.targets[t].words, loc="left")
    axes.set_ylabel(f"RMSE{style.in_unit(first.targets[t].unit)}")
    axes.grid(axis="y")
