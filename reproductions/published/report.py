"""The report of the reproduction: the answer, a picture, and the rows of every document."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np
from matplotlib.patches import Patch

from harness.reporting import style
from harness.reporting.document import Block, Drawing, Heading, Prose, Report, Section, Sheet, plain
from reproductions.campaign.evidence import Evidence
from reproductions.published import wording
from reproductions.published.record import Outcome, Row
from reproductions.published.results import Origin
from reproductions.published.wording import Chapter


def report(chapters: Sequence[Chapter], origins: Sequence[Origin]) -> Report:
    """Return the report."""
    rows = [row for chapter in chapters for row in chapter.rows]
    blocks: list[Block] = [
        Prose(plain(wording.sentence(rows))),
        Prose(
            plain(
                "A number is reproduced if ours lies, with its whole 95 % interval, where the row says; a statement if "
                "every number behind it does. An interval that crosses the edge decides nothing."
            )
        ),
        Drawing(
            lambda: overview(chapters),
            "Numbers and statements of the five documents by what became of them. Settings, which are taken over or "
            "not, are not counted.",
            "Bars of outcomes by document",
        ),
        Heading("Stored results"),
        Sheet(
            ["result", "command", "made", "state"],
            [[o.name, o.command, o.made or "–", o.state] for o in origins],
            "What the rows are read from. A row marked † is read from a result that is older than the code or the "
            "study that decides it.",
            left=4,
        ),
    ]
    blocks += [Section(partial(_chapter, chapter), chapter.title) for chapter in chapters]
    return Report("Which published numbers are reproduced?", blocks)


def _chapter(chapter: Chapter) -> list[Block]:
    blocks: list[Block] = [
        Prose(plain(f"{wording.sentence(chapter.rows)} {chapter.note}")),
    ]
    if len(compared(chapter.results)) > 2:
        blocks.append(
            Drawing(
                lambda: ratios(chapter),
                "Ours over theirs with 95 % intervals, where both have a number.",
                f"Ours over theirs, {chapter.title}",
            )
        )
    if chapter.results:
        rows = [
            [r.record.place, r.record.quantity, wording.theirs(r) or "–", wording.ours(r), wording.verdict(r)]
            for r in chapter.results
        ]
        blocks.append(
            Sheet(["place", "what", "theirs", "ours (95 %)", "verdict"], rows, "Numbers and statements.", left=5),
        )
        reasons = dict.fromkeys(wording.why(r) for r in chapter.results)
        blocks += [Prose(plain(reason)) for reason in reasons if reason]
    if chapter.settings:
        rows = [
            [r.record.place, r.record.quantity, wording.theirs(r), wording.ours(r), wording.verdict(r)]
            for r in chapter.settings
        ]
        blocks.append(Sheet(["place", "setting", "theirs", "ours", "verdict"], rows, "Settings.", left=5))
    if chapter.incomparable:
        rows = [
            [r.record.place, r.record.quantity, wording.theirs(r) or "–", r.outcome.value] for r in chapter.incomparable
        ]
        blocks.append(Sheet(["place", "what", "theirs", "because"], rows, "What cannot be compared.", left=4))
    return blocks


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
