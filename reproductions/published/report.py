"""The report of the reproduction: the answer, a picture, and the rows of every document."""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

from harness.reporting.document import Block, Drawing, Heading, Prose, Report, Section, Sheet, plain
from reproductions.published import figures, wording
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
            lambda: figures.overview(chapters),
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
        Heading(chapter.title),
        Prose(plain(f"{wording.sentence(chapter.rows)} {chapter.note}")),
    ]
    if len(figures.compared(chapter.results)) > 2:
        blocks.append(
            Drawing(
                lambda: figures.ratios(chapter),
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
