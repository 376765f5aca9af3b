"""Tables of a page: text that can be copied, sorted by a click on a heading, filtered by a word, never cut."""

from __future__ import annotations

import html
import math
import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

from bokeh.models import Div

import harness.reporting
from harness.reporting import style
from harness.view import looks

SORTED_FROM, FILTERED_FROM, ROLLED_FROM = 3, 9, 18
"""Rows from which a table can be sorted, filtered, and rolls in a frame of its own."""

PROSE_FROM = 60
"""Characters of a cell from which the rows of a table become paragraphs on a phone."""

_NUMBER = re.compile(r"[<>]?\s*[-−+]?\d|–$")
_SHARED = Path(harness.reporting.__file__).parent
_STYLE = "".join(f.read_text(encoding="utf-8") for f in (_SHARED / "rolled.css", Path(__file__).parent / "tables.css"))


def script() -> str:
    """Return what sorts and filters the tables of a page: that of the reports."""
    return (_SHARED / "tables.js").read_text(encoding="utf-8")


def table(
    columns: Mapping[str, Sequence[str]], links: Mapping[str, Sequence[str]] = MappingProxyType({}), still: bool = False
) -> Div:
    """Return a table; its texts are shown as they are, whatever characters they have.

    Args:
        columns: Texts by heading.
        links: Addresses that the texts of a column lead to, by its heading.
        still: Whether it is renewed so often that nobody sorts it.
    """
    return Div(text=rows_of(columns, links, still), sizing_mode="stretch_width", stylesheets=[_STYLE])


def rows_of(
    columns: Mapping[str, Sequence[str]], links: Mapping[str, Sequence[str]] = MappingProxyType({}), still: bool = False
) -> str:
    """Return the HTML of a table, see ``table``."""
    count = len(next(iter(columns.values()), ()))
    numeric = {name: all(_NUMBER.match(text) for text in texts) and count > 0 for name, texts in columns.items()}
    mark = {name: ' class="number"' if numeric[name] else "" for name in columns}
    width = {name: "" if numeric[name] else _least_width(texts) for name, texts in columns.items()}
    sorts = count >= SORTED_FROM and not still
    heads = (_button(html.escape(name)) if sorts else html.escape(name) for name in columns)
    head = "".join(f"<th{mark[n]}{width[n]}>{text}</th>" for n, text in zip(columns, heads, strict=True))
    body = []
    for i in range(count):
        cells = (
            f'<td{mark[n]} data-of="{html.escape(n)}">{_linked(texts[i], links.get(n, ())[i : i + 1])}</td>'
            for n, texts in columns.items()
        )
        body.append(f"<tr>{''.join(cells)}</tr>")
    longest = max((len(str(text)) for texts in columns.values() for text in texts), default=0)
    rolls = count >= ROLLED_FROM and not still
    named = f"sheet{' rolled' if rolls else ''}{' prose' if longest > PROSE_FROM else ''}"
    rolled = f' class="{named}"' + (' tabindex="0"' if rolls else "")
    field = '<div class="tools"><label>rows with <input type="search"></label></div>'
    return (
        f"{field if count >= FILTERED_FROM and not still else ''}<div{rolled}><table><thead><tr>{head}</tr></thead>"
        f"<tbody>{''.join(body)}</tbody></table></div>"
    )


def _least_width(texts: Sequence[str]) -> str:
    """Return the style of a column of words: half of its longest text, so that no row grows tall by it."""
    longest = max(map(len, map(str, texts)), default=0)
    return f' style="min-width: min(18rem, 45vw, {longest // 2}ch)"' if longest > 16 else ""


def correlations(names: Sequence[str], values: Sequence[Sequence[float | None]]) -> Div:
    """Return a matrix of correlations, each cell in the colour of its value; columns are numbered as the rows are."""
    heads = "".join(f'<th class="number">{k}</th>' for k in range(1, len(names) + 1))
    rows = []
    for k, (name, row) in enumerate(zip(names, values, strict=True), 1):
        cells = "".join(
            f'<td class="number"{_tint(v)}>{style.number(v, 2) if v is not None else "–"}</td>' for v in row
        )
        rows.append(f'<tr><th class="number">{k}</th><th>{html.escape(name)}</th>{cells}</tr>')
    text = f'<div class="sheet"><table class="matrix"><tr><th></th><th></th>{heads}</tr>{"".join(rows)}</table></div>'
    return Div(text=text, sizing_mode="stretch_width", stylesheets=[_STYLE])


def _tint(value: float | None) -> str:
    if value is None or not math.isfinite(value):
        return ""
    return f' style="background: {looks.DIVERGING[round(127.5 * (1 + max(-1.0, min(1.0, value))))]}"'


def _button(text: str) -> str:
    return f'<button type="button" title="sort">{text}</button>'


def _linked(text: str, address: Sequence[str]) -> str:
    shown = html.escape(str(text))
    return f'<a href="{html.escape(address[0], quote=True)}">{shown}</a>' if address and address[0] else shown
