"""The picture of the report: what became of the published numbers, by document, and how far ours are from theirs."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.patches import Patch

from harness.reporting import style
from reproductions.campaign.evidence import Evidence
from reproductions.published.record import Outcome, Row
from reproductions.published.wording import Chapter

LOOKS = {
    Outcome.REPRODUCED: ("#009E73", ""),
    Outcome.NOT_REPRODUCED: ("#D55E00", "////"),
    Outcome.UNDECIDED: ("#E69F00", "...."),
    Outcome.MISSING: ("#ffffff", ""),
    Outcome.MEASURED: ("#bdbdbd", ""),
    Outcome.IMAGE: ("#dcdcdc", ""),
    Outcome.FOREIGN: ("#efefef", ""),
}
"""Colour and hatch of each outcome, in the order of the bars."""


def overview(chapters: Sequence[Chapter]) -> bytes:
    """Draw a bar per document with a piece for each outcome; settings are not counted."""
    with style.drawing():
        fig = style.figure(1.5 + 0.46 * len(chapters))
        axes = fig.subplots()
        for place, chapter in enumerate(reversed(chapters)):
            rows, start = [*chapter.results, *chapter.incomparable], 0
            for outcome, (colour, hatch) in LOOKS.items():
                number = sum(r.outcome is outcome for r in rows)
                if number:
                    axes.barh(place, number, 0.72, left=start, color=colour, hatch=hatch, edgecolor="#444444", lw=0.5)
                    if number > 2:
                        box = {"facecolor": "white", "edgecolor": "none", "pad": 0.8, "alpha": 0.85}
                        axes.text(start + number / 2, place, str(number), ha="center", va="center", bbox=box)
                    start += number
        axes.set_yticks(range(len(chapters)), [_short(c.title) for c in reversed(chapters)])
        axes.tick_params(axis="y", length=0)
        axes.set_xlabel("numbers and statements")
        axes.grid(axis="x")
        seen = {r.outcome for c in chapters for r in c.rows}
        handles = [
            Patch(facecolor=colour, hatch=hatch, edgecolor="#444444", lw=0.5, label=outcome.value)
            for outcome, (colour, hatch) in LOOKS.items()
            if outcome in seen
        ]
        style.head(fig, "What became of the published numbers?", handles)
        return style.svg(fig)


def _short(title: str) -> str:
    """Return a title in two lines."""
    author, _, rest = title.partition(":")
    first = rest.strip().split(",")[0]
    return f"{author}\n{first if len(first) < 34 else first[:32] + '…'}"


def compared(rows: Sequence[Row]) -> list[tuple[Row, Evidence]]:
    """Return the numbers of ours that stand beside a number of theirs, the first of each row."""
    pairs = []
    for row in rows:
        both = [e for e in row.evidence if np.isfinite(e.theirs) and e.theirs > 0 and e.value.value > 0]
        if both and row.outcome in (Outcome.REPRODUCED, Outcome.NOT_REPRODUCED, Outcome.UNDECIDED):
            pairs.append((row, both[0]))
    return pairs


def ratios(chapter: Chapter) -> bytes:
    """Draw ours over theirs, a point per number with its interval, and half to twice shaded."""
    pairs = compared(chapter.results)
    with style.drawing():
        fig = style.figure(1.3 + 0.24 * len(pairs))
        axes = fig.subplots()
        axes.axvspan(0.5, 2.0, color=style.SHADE, lw=0)
        axes.axvline(1.0, color=style.TRUTH, lw=0.8)
        for place, (row, e) in enumerate(reversed(pairs)):
            colour = LOOKS[row.outcome][0]
            ends = np.array([e.value.lower, e.value.upper]) / e.theirs
            axes.plot(np.clip(ends, 1e-3, 1e3), [place, place], color=colour, lw=2.2, solid_capstyle="butt")
            axes.plot(e.value.value / e.theirs, place, "o", color=colour, ms=4.5, mec="#333333", mew=0.4)
        labels = [f"{r.record.quantity[:62]}{'…' if len(r.record.quantity) > 62 else ''}" for r, _ in reversed(pairs)]
        axes.set_yticks(range(len(pairs)), labels)
        axes.tick_params(axis="y", length=0, labelsize=8)
        axes.set_xscale("log")
        axes.set_xlabel("ours over theirs")
        axes.set_ylim(-0.7, len(pairs) - 0.3)
        axes.grid(axis="x")
        seen = {r.outcome for r, _ in pairs}
        handles = [Patch(facecolor=LOOKS[o][0], label=o.value) for o in LOOKS if o in seen]
        handles.append(Patch(facecolor=style.SHADE, label="half to twice"))
        style.head(fig, "How far are ours from theirs?", handles)
        return style.svg(fig)
