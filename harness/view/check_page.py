"""The page of a check: every signal over time with what is said of it, and both sides of every comparison."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import BoxAnnotation, ColumnDataSource, Range1d, Select

from harness.common.arrays import Floats
from harness.common.series import unpacked
from harness.models.quantities import print_unit, quantity, words
from harness.models.signals import TRUTH
from harness.reporting import style
from harness.view import looks
from harness.view.frame import Part, address_bar, arguments_of, index_of, put_parts, read_record, said
from harness.view.tables import table

_GAPS = 200
"""Gaps that are shaded, the longest first."""


def build(folder: Path) -> Callable[[Document], None]:
    """Return what puts the page of a check into a document.

    Args:
        folder: With ``check.json`` and ``signals.npz``.

    Raises:
        UserError: If they cannot be read.
    """
    record, series = read_record(folder / "check.json"), unpacked(folder / "signals.npz")

    def put(document: Document) -> None:
        given, address = arguments_of(document), address_bar()
        signals = _Signals(record, series, index_of(given.get("signal"), 10_000), address)
        rows = {"signals": [], "what": [], "evidence": []}  # type: dict[str, list[str]]
        places: list[str] = []
        for f in record.get("findings") or []:
            for key, value in zip(rows, (", ".join(map(words, f["signals"])), f["words"], f["evidence"]), strict=True):
                rows[key].append(str(value))
            places.append(next((f"?signal={signals.names.index(s)}" for s in f["signals"] if s in signals.names), ""))
        parts = []
        if rows["what"]:
            parts.append(Part("What was found?", [table(rows, {"signals": places})], "A name leads to its signal."))
        if record.get("mended"):
            lines = said("\n".join(map(str, record["mended"])), styles=_LISTING)
            parts.append(Part("Lines that mend the map", [lines]))
        if record.get("comparisons"):
            parts.append(Part("Do the signals agree?", [_agreement(record["comparisons"], signals.names)]))
        parts.append(Part("Signals over time", [signals.layout], _SIGNALS))
        answer = [str(record.get("read", "")), *record.get("answer", []), *record.get("warnings", [])]
        put_parts(document, f"Check of {record.get('title', folder.name)}", list(map(str, answer)), parts, address)

    return put


_LISTING = {"font-family": "monospace", "white-space": "pre-wrap"}
_SIGNALS = "Grey: no sample. Below a signal stands what is said of it, and every comparison that it takes part in."


def _agreement(comparisons: Sequence[Mapping[str, Any]], names: Sequence[str]) -> Any:
    """Return the table of comparisons; slope, delay and share explained where the record has them (this version)."""
    rows = {
        "comparison": [str(c["name"]) for c in comparisons],
        "verdict": [str(c["verdict"]) + "".join(f"; {r}" for r in c["reasons"]) for c in comparisons],
        "slope": [_number(c.get("slope")) for c in comparisons],
        "delay in ms": [_number(c.get("delay"), 1e3) if c.get("exact") else "–" for c in comparisons],
        "R²": [_number(c.get("explained")) for c in comparisons],
    }
    signals = [str(c["signal"]) for c in comparisons]
    return table(rows, {"comparison": [f"?signal={names.index(s)}" if s in names else "" for s in signals]})


def _number(value: Any, scale: float = 1.0) -> str:
    return style.number(scale * float(value)) if isinstance(value, (int, float)) else "–"


class _Signals:
    """One signal at a time, with the comparisons that it is in; first one of which something is said."""

    def __init__(
        self, record: Mapping[str, Any], series: Mapping[str, Mapping[str, Floats]], first: int | None, address: Any
    ) -> None:
        self._found, self._series, self._address = record, series, address
        self.names = [n for n in series["recording"] if n != "time"]
        self._flagged = {s for f in record.get("findings") or [] for s in f["signals"]}
        options = [(str(i), words(n) + (": see below" if n in self._flagged else "")) for i, n in enumerate(self.names)]
        if first is None:
            first = next((i for i, n in enumerate(self.names) if n in self._flagged), 0)
        self._select = Select(title="Signal", options=options, value=str(min(first, len(self.names) - 1)), width=340)
        self._holder = column(sizing_mode="stretch_width")
        self._select.on_change("value", lambda _a, _o, _n: self._draw())
        self.layout = column(row(self._select), self._holder, sizing_mode="stretch_width")
        self._draw()

    def _draw(self) -> None:
        number = int(self._select.value)
        name, recording = self.names[number], self._series["recording"]
        time = recording["time"]
        shared = Range1d(float(time[0]), float(time[-1]), bounds="auto")
        q = quantity(name.removeprefix(TRUTH))
        plot = looks.plot(words(name), 300, x_range=shared)
        values = q.scale * recording[name].astype(float)
        source = ColumnDataSource({"time": time, "value": values})
        drawn = plot.line("time", "value", source=source, color=looks.line(style.looks([name])[name]), line_width=1.3)
        plot.add_tools(looks.hover([drawn], ("t", "@time s"), ("value", "@value{0.0000 a}")))
        for begin, end in _gaps(time, values):
            plot.add_layout(BoxAnnotation(left=begin, right=end, fill_color="#bbbbbb", fill_alpha=0.5, line_color=None))
        plot.yaxis.axis_label = q.unit
        models: list[Any] = [plot]
        models += [
            said(f"{f['words']}: {f['evidence']}") for f in self._found.get("findings") or [] if name in f["signals"]
        ]
        among = [
            (c, self._series[f"comparison {i}"])
            for i, c in enumerate(self._found.get("comparisons") or [])
            if name in c.get("signals", [c["signal"]]) and f"comparison {i}" in self._series
        ]
        for comparison, columns in sorted(among, key=lambda pair: not pair[0]["reasons"]):
            models.append(self._comparison(comparison, columns, shared))
        plot.xaxis.axis_label = "time in s"
        self._holder.children = models
        self._address.value = "?" + urlencode({"signal": number})

    def _comparison(self, comparison: Mapping[str, Any], columns: Mapping[str, Floats], shared: Range1d) -> Any:
        """Return both sides; what is computed but for a factor (a wheelbase, a steering ratio) is drawn with it."""
        reasons = ": " + "; ".join(comparison["reasons"]) if comparison["reasons"] else ""
        plot = looks.plot(f"{comparison['name']}: {comparison['verdict']}{reasons}", 240, x_range=shared)
        q = quantity(comparison["signal"])
        scale, unit = comparison.get("scale", q.scale), print_unit(comparison.get("unit", q.unit))
        slope, offset, legend_computed = 1.0, 0.0, "computed"
        if not comparison.get("exact", True) and comparison.get("slope") is not None:
            slope, offset = comparison["slope"], comparison.get("offset") or 0.0
            legend_computed = f"computed, times {style.number(slope)}"
        pair = {"measured": columns["measured"].astype(float),
                "computed": slope * columns["computed"].astype(float) + offset}  # fmt: skip
        source = ColumnDataSource({"time": columns["time"], **{side: scale * v for side, v in pair.items()}})
        chosen = style.looks(["measured", "computed"])
        for side, legend, dashes in (("measured", "measured", "solid"), ("computed", legend_computed, "dashed")):
            drawn = plot.line("time", side, source=source, color=looks.line(chosen[side]), line_dash=dashes,
                              line_width=1.5, legend_label=legend)  # fmt: skip
            plot.add_tools(looks.hover([drawn], ("t", "@time s"), (side, f"@{side}{{0.0000 a}}")))
        looks.legend_above(plot)
        plot.yaxis.axis_label, plot.xaxis.axis_label = unit, "time in s"
        return plot


def _gaps(time: Floats, values: Floats) -> list[tuple[float, float]]:
    """Return where a signal has no sample, the longest gaps first."""
    missing = np.concatenate([[False], np.isnan(values), [False]])
    begins, stops = np.flatnonzero(missing[1:] & ~missing[:-1]), np.flatnonzero(missing[:-1] & ~missing[1:])
    first, last = time[np.maximum(begins - 1, 0)], time[np.minimum(stops, len(time) - 1)]
    gaps = list(zip(first.tolist(), last.tolist(), strict=True))
    return sorted(gaps, key=lambda pair: pair[0] - pair[1])[:_GAPS]
