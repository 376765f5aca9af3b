"""The page of an identification: the values found, with their intervals, and the recordings before and after."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
from bokeh.document import Document
from bokeh.models import ColumnDataSource, Span

from harness.common.series import unpacked
from harness.models.quantities import print_unit, words
from harness.reporting import style
from harness.view import looks
from harness.view.drives_figure import DrivesFigure
from harness.view.frame import Part, address_bar, arguments_of, index_of, put_parts, read_record
from harness.view.tables import correlations, table


def build(folder: Path) -> Callable[[Document], None]:
    """Return what puts the page of an identification into a document.

    Args:
        folder: With ``identify.json`` and, of a fit of this version, ``drives.npz``.

    Raises:
        UserError: If they cannot be read.
    """
    record, file = read_record(folder / "identify.json"), folder / "drives.npz"
    series = unpacked(file) if file.exists() else {}

    def put(document: Document) -> None:
        given, address = arguments_of(document), address_bar()

        def keep(drive: int, output: int) -> None:
            address.value = "?" + urlencode({"drive": drive, "output": output})

        estimates = [e for e in record.get("estimates") or [] if isinstance(e, dict)]
        parts = [Part("Which values were found?", [_table(estimates), _intervals(estimates)], _INTERVALS)]
        if record.get("correlation") and len(record["correlation"]) == len(estimates):
            names = [words(e["name"]) for e in estimates]
            parts.append(
                Part("Which depend on each other?", [correlations(names, record["correlation"])], _CORRELATION)
            )
        if series:
            held = [str(d.get("name")) for d in record.get("drives") or [] if d.get("held_out")]
            chosen = index_of(given.get("drive"), len(series)) or 0, index_of(given.get("output"), 99) or 0
            parts.append(Part("Before and after", [DrivesFigure(series, held, chosen, keep).layout]))
        objective = record.get("objective") or {}
        said = f"Method {record.get('method')} on {record.get('model')}: {objective.get('name')} "
        said += f"{_number(objective.get('before'))} before, {_number(objective.get('after'))} after."
        put_parts(
            document,
            f"Which parameters fit? {folder.name}",
            [said, *map(str, record.get("notes") or [])],
            parts,
            address,
        )

    return put


_CORRELATION = "Correlation of the errors: near 1 or −1, the recordings tell the two apart badly."
_INTERVALS = "The figure has each value and its 95 % interval over where the fit began."


def _number(value: Any) -> str:
    return style.number(float(value), 5) if isinstance(value, (int, float)) else "–"


def _table(estimates: Sequence[Mapping[str, Any]]) -> Any:
    rows: dict[str, list[str]] = {
        "parameter": [words(e["name"]) for e in estimates],
        "unit": [print_unit(str(e.get("unit") or "")) or "–" for e in estimates],
        "at the start": [_number(e.get("start")) for e in estimates],
        "found": [_number(e.get("value")) for e in estimates],
        "95 % interval": [
            f"{_number(e['interval_95'][0])} to {_number(e['interval_95'][1])}" if e.get("interval_95") else "–"
            for e in estimates
        ],
        "verdict": [str(e.get("verdict", "")) for e in estimates],
    }
    return table(rows)


def _intervals(estimates: Sequence[Mapping[str, Any]]) -> Any:
    rows = []
    for e in estimates:
        start, value, interval = e.get("start"), e.get("value"), e.get("interval_95") or (None, None)
        if not start or value is None:
            continue
        ends = [end / start if isinstance(end, (int, float)) else value / start for end in interval]
        rows.append((words(e["name"]), value / start, min(ends), max(ends)))
    plot = looks.plot("Value over that at the start", 110 + 40 * len(rows), tools="xpan,xwheel_zoom,reset",
                       x_range=_ends(rows), y_range=(-0.55, len(rows) - 0.45))  # fmt: skip
    y = np.arange(len(rows))[::-1] - 0.25
    source = ColumnDataSource(
        {k: [r[i] for r in rows] for i, k in enumerate(("name", "value", "low", "high"))} | {"y": y}
    )
    line = looks.line(style.looks(["found"])["found"])
    plot.segment("low", "y", "high", "y", source=source, line_width=3, color=line)
    marks = plot.scatter("value", "y", source=source, size=9, color=line)
    plot.add_layout(Span(location=1.0, dimension="height", line_color="#000000", line_dash="dashed"))
    plot.add_tools(
        looks.hover([marks], ("", "@name"), ("ratio", "@value{0.0000}"), ("95 %", "@low{0.0000} to @high{0.0000}"))
    )
    looks.names_inside(plot, [r[0] for r in rows], plot.x_range.start)
    plot.xaxis.axis_label = "found over start"
    return plot


def _ends(rows: Sequence[tuple[str, float, float, float]]) -> tuple[float, float]:
    """Return the ends of an axis that holds all intervals, and 1."""
    low, high = min((r[2] for r in rows), default=1.0), max((r[3] for r in rows), default=1.0)
    low, high = min(low, 1.0), max(high, 1.0)
    return low - 0.05 * (high - low + 0.1), high + 0.05 * (high - low + 0.1)
