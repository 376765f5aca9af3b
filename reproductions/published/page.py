"""The table as Markdown: the part of ``docs/reproduction.md`` between its marks."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from reproductions.published import wording
from reproductions.published.record import Row
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
    parts = [f"{wording.sentence(rows)} Written on {made}.", _overview(chapters), _stored(origins, rows)]
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


def _chapter(chapter: Chapter) -> str:
    parts = [f"## {chapter.title}", f"{wording.sentence(chapter.rows)} {chapter.note}"]
    if chapter.results:
        header = ["place", "what", "theirs", "ours (95 %)", "holds in", "verdict", "command", "why"]
        parts.append(table(header, [_result(row) for row in chapter.results]))
    if chapter.settings:
        lines = [
            [r.record.place, r.record.quantity, wording.theirs(r), wording.ours(r), wording.verdict(r), wording.why(r)]
            for r in chapter.settings
        ]
        parts += ["### Settings", table(["place", "what", "theirs", "ours", "verdict", "why"], lines)]
    if chapter.incomparable:
        lines = [
            [r.record.place, r.record.quantity, wording.theirs(r) or "–", r.outcome.value, r.record.reason]
            for r in chapter.incomparable
        ]
        parts += ["### Not comparable", table(["place", "what", "theirs", "because", "remark"], lines)]
    return "\n\n".join(_unique(parts, chapter))


def _unique(parts: list[str], chapter: Chapter) -> list[str]:
    """Return the parts with the author behind the headings that every chapter has."""
    short = chapter.title.partition(":")[0]
    return [
        p.replace("### Settings", f"### Settings: {short}").replace("### Not comp", f"### {short}: not comp")
        for p in parts
    ]


def _result(row: Row) -> list[str]:
    return [
        row.record.place,
        row.record.quantity,
        wording.theirs(row) or "–",
        wording.ours(row),
        wording.wanted(row),
        wording.verdict(row),
        f"`{wording.source(row)}`",
        wording.why(row),
    ]
