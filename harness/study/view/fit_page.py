"""The page of an identification: the values found, with their intervals, and the recordings before and after."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
from bokeh.document import Document
from bokeh.models import ColorBar, ColumnDataSource, FixedTicker, Span
from bokeh.transform import linear_cmap

from harness.common.series import unpacked
from harness.models.quantities import print_unit, words
from harness.reporting import style
from harness.study.view import looks
from harness.study.view.bars import table
from harness.study.view.drives_figure import DrivesFigure
from harness.study.view.frame import Part, address_bar, arguments_of, index_of, put_parts, read_record


def build(folder: Path) -> Callable[[Document], None]:
    """Return what puts the page of an identification into a document.

    Args:
        folder: With ``identify.json`` and, of a fit of this version, ``drives.npz``.

    Raises:
        UserError: If they cannot be read.
    """
    found, file = read_record(folder / "identify.json"), folder / "drives.npz"
    series = unpacked(file) if file.exists() else {}

    def put(document: Document) -> None:
        given, address = arguments_of(document), address_bar()

        def told(drive: int, output: int) -> None:
            address.value = "?" + urlencode({"drive": drive, "output": output})

        estimates = [e for e in found.get("estimates") or [] if isinstance(e, dict)]
        parts = [Part("Which values were found?", [_table(estimates), _intervals(estimates)], _INTERVALS)]
        if found.get("correlation") and len(found["correlation"]) == len(estimates):
            names = [words(e["name"]) for e in estimates]
            parts.append(Part("Which depend on each other?", [_correlation(names, np.array(found["correlation"]))]))
        if series:
            held = [str(d.get("name")) for d in found.get("drives") or [] if d.get("held_out")]
            chosen = index_of(given.get("drive"), len(series)) or 0, index_of(given.get("output"), 99) or 0
            parts.append(Part("Before and after", [DrivesFigure(series, held, chosen, told).layout]))
        objective = found.get("objective") or {}
        said = f"Method {found.get('method')} on {found.get('model')}: {objective.get('name')} "
        said += f"{_number(objective.get('before'))} before, {_number(objective.get('after'))} after."
        put_parts(
            document,
            f"Which parameters fit? {folder.name}",
            [said, *map(str, found.get("notes") or [])],
            parts,
            address,
        )

    return put


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
    return table(rows, 60 + 26 * len(estimates))


def _intervals(estimates: Sequence[Mapping[str, Any]]) -> Any:
    rows = []
    for e in estimates:
        start, value, interval = e.get("start"), e.get("value"), e.get("interval_95") or (None, None)
        if not start or value is None:
            continue
        ends = [end / start if isinstance(end, (int, float)) else value / start for end in interval]
        rows.append((words(e["name"]), value / start, min(ends), max(ends)))
    found = looks.plot("Value over that at the start", 110 + 30 * len(rows), tools="xpan,xwheel_zoom,reset",
                       y_range=(-0.6, len(rows) - 0.4))  # fmt: skip
    y = np.arange(len(rows))[::-1]
    source = ColumnDataSource(
        {k: [r[i] for r in rows] for i, k in enumerate(("name", "value", "low", "high"))} | {"y": y}
    )
    line = looks.colour(style.looks(["found"])["found"].line)
    found.segment("low", "y", "high", "y", source=source, line_width=3, color=line)
    marks = found.scatter("value", "y", source=source, size=9, color=line)
    found.add_layout(Span(location=1.0, dimension="height", line_color="#000000", line_dash="dashed"))
    found.add_tools(
        looks.hover([marks], ("", "@name"), ("ratio", "@value{0.0000}"), ("95 %", "@low{0.0000} to @high{0.0000}"))
    )
    found.yaxis.ticker = FixedTicker(ticks=list(range(len(rows))))
    found.yaxis.major_label_overrides = {len(rows) - 1 - i: r[0] for i, r in enumerate(rows)}
    found.xaxis.axis_label = "found over start"
    return found


def _correlation(names: list[str], values: np.ndarray) -> Any:
    count = len(names)
    found = looks.plot("Correlation of the errors", 160 + 28 * count, tools="reset", x_range=(-0.5, count - 0.5),
                       y_range=(count - 0.5, -0.5))  # fmt: skip
    rows, columns = np.mgrid[:count, :count]
    flat = values.astype(float).ravel()
    source = ColumnDataSource({
        "x": columns.ravel(), "y": rows.ravel(), "value": flat, "shown": [style.number(v, 2) for v in flat],
        "one": [names[i] for i in rows.ravel()], "other": [names[j] for j in columns.ravel()],
    })  # fmt: skip
    mapper = linear_cmap("value", looks.DIVERGING, -1.0, 1.0, nan_color="#ffffff")
    drawn = found.rect("x", "y", 0.98, 0.98, source=source, fill_color=mapper, line_color=None)
    if count <= 14:
        found.text("x", "y", "shown", source=source, text_align="center", text_baseline="middle", text_font_size="11px")
    found.add_tools(looks.hover([drawn], ("", "@one"), ("and", "@other"), ("correlation", "@value{0.000}")))
    found.add_layout(ColorBar(color_mapper=mapper["transform"], width=14), "right")
    for axis, turned in ((found.xaxis, 0.7), (found.yaxis, 0.0)):
        axis.ticker = FixedTicker(ticks=list(range(count)))
        axis.major_label_overrides = dict(enumerate(names))
        axis.major_label_orientation = turned
    found.grid.grid_line_color = None
    return found
