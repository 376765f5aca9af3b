"""The table as Markdown: the part of ``docs/tables/reproduction.md`` between its marks."""

from __future__ import annotations

import textwrap
from collections.abc import Iterable, Sequence

from reproductions.published import wording
from reproductions.published.record import Outcome, Row
from reproductions.published.results import Origin
from reproductions.published.wording import Chapter


def table(header: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Write a table."""
    lines = [header, ["---"] * len(header), *rows]
    return "\n".join(f"| {' | '.join(_cell(c) for c in line)} |" for line in lines)


def _cell(text: str) -> str:
    return text.replace("|", "∣").replace("\n", " ") or " "


def content(chapters: Sequence[Chapter], origins: Sequence[Origin], made: str) -> str:
    """Return the page: counts on top, the stored results, and a section per chapter.

    Args:
        chapters: With their rows.
        origins: Of the stored results.
        made: Day on which it is written.
    """
    rows = [row for chapter in chapters for row in chapter.rows]
    parts = [_wrapped(f"{wording.sentence(rows)} Written on {made}."), _overview(chapters), _stored(origins, rows)]
    parts += [_chapter(chapter) for chapter in chapters]
    return "\n\n".join(parts)


def _overview(chapters: Sequence[Chapter]) -> str:
    names = ("reproduced", "not reproduced", "undecided", "result missing")
    lines = []
    for chapter in chapters:
        outcomes = [r.outcome.value for r in chapter.results]
        taken = sum(r.outcome.value == "taken over" for r in chapter.settings)
        settings = f"{taken} of {len(chapter.settings)}" if chapter.settings else "–"
        counts = [str(outcomes.count(name)) for name in names]
        lines.append(
            [f"[{chapter.title}](#{_anchor(chapter.title)})", *counts, str(len(chapter.incomparable)), settings],
        )
    return table(["document", *names, "not comparable", "settings taken over"], lines)


def _anchor(title: str) -> str:
    return "".join(c for c in title.lower() if c.isalnum() or c in " -_").replace(" ", "-")


def _stored(origins: Sequence[Origin], rows: Sequence[Row]) -> str:
    lines = [[o.name, f"`{o.command}`", o.made or "–", o.state] for o in origins]
    text = "## Stored results\n\n" + table(["result", "command", "made", "state"], lines)
    if any(row.old for row in rows):
        text += "\n\n† from a stored result that is older than the code or the study that decides it."
    return text


def _wrapped(text: str, indent: str = "") -> str:
    return textwrap.fill(text, 120, subsequent_indent=indent, break_long_words=False, break_on_hyphens=False)


def _chapter(chapter: Chapter) -> str:
    """Return a section: counts, a line per result, and a line per setting that ours does not take over."""
    reasons: dict[str, int] = {}
    differing = [r for r in chapter.settings if r.outcome is not Outcome.TAKEN_OVER]
    parts = [f"## {chapter.title}", _wrapped(f"{wording.sentence(chapter.rows)} {chapter.note}")]
    header = ["place", "what", "theirs", "ours (95 %)", "verdict"]
    parts.append(table(header, [_line(row, reasons) for row in [*chapter.results, *differing]]))
    notes = [_wrapped(f"{number}. {reason}", indent="   ") for reason, number in reasons.items()]
    commands = dict.fromkeys(command for r in chapter.results for command in wording.source(r).split(", "))
    computed = _wrapped(f"Computed by {', '.join(f'`{command}`' for command in commands)}.")
    return "\n\n".join([*parts, *(["\n".join(notes)] if notes else []), computed])


def _line(row: Row, reasons: dict[str, int]) -> list[str]:
    """Return the cells of a record; the verdict carries the number of its reason."""
    verdict, reason = wording.verdict(row), wording.why(row)
    if reason:
        verdict += f" ({reasons.setdefault(reason, len(reasons) + 1)})"
    return [row.record.place, row.record.quantity, wording.theirs(row) or "–", wording.ours(row), verdict]
