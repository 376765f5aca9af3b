"""The page of a check: every signal over time with what is said of it, and both sides of every comparison."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any
from urllib.parse import urlencode

import numpy as np
from bokeh.document import Document
from bokeh.layouts import column, row
from bokeh.models import BoxAnnotation, ColumnDataSource, Range1d, Select

from harness.common.arrays import Floats
from harness.common.series import unpacked
from harness.models.quantities import quantity, words
from harness.models.signals import TRUTH
from harness.reporting import style
from harness.study.view import looks
from harness.study.view.frame import Part, address_bar, arguments_of, index_of, put_parts, read_record, said
from harness.study.view.tables import table

_GAPS = 200
"""Gaps that are shaded, the longest first."""


def build(folder: Path) -> Callable[[Document], None]:
    """Return what puts the page of a check into a document.

    Args:
        folder: With ``check.json`` and ``signals.npz``.

    Raises:
        UserError: If they cannot be read.
    """
    found, series = read_record(folder / "check.json"), unpacked(folder / "signals.npz")

    def put(document: Document) -> None:
        given, address = arguments_of(document), address_bar()
        signals = _Signals(found, series, index_of(given.get("signal"), 10_000), address)
        rows = {"signals": [], "what": [], "evidence": []}  # type: dict[str, list[str]]
        places: list[str] = []
        for f in found.get("findings") or []:
            for key, value in zip(rows, (", ".join(map(words, f["signals"])), f["words"], f["evidence"]), strict=True):
                rows[key].append(str(value))
            places.append(next((f"?signal={signals.names.index(s)}" for s in f["signals"] if s in signals.names), ""))
        parts = [
            Part("Signals over time", [signals.layout], "Grey: no sample. Below a signal stands what is said of it.")
        ]
        if rows["what"]:
            parts.insert(0, Part("What was found?", [table(rows, {"signals": places})], "A name leads to its signal."))
        answer = [str(found.get("read", "")), *found.get("answer", []), *found.get("warnings", [])]
        put_parts(document, f"Check of {found.get('title', folder.name)}", list(map(str, answer)), parts, address)

    return put


class _Signals:
    """One signal at a time, with the comparisons that it is in; first one of which something is said."""

    def __init__(
        self, found: Mapping[str, Any], series: Mapping[str, Mapping[str, Floats]], first: int | None, address: Any
    ) -> None:
        self._found, self._series, self._address = found, series, address
        self.names = [n for n in series["recording"] if n != "time"]
        self._flagged = {s for f in found.get("findings") or [] for s in f["signals"]}
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
        for left, right in _gaps(time, values):
            plot.add_layout(
                BoxAnnotation(left=left, right=right, fill_color="#bbbbbb", fill_alpha=0.5, line_color=None)
            )
        plot.yaxis.axis_label = q.unit
        models: list[Any] = [plot]
        models += [
            said(f"{f['words']} {f['evidence']}") for f in self._found.get("findings") or [] if name in f["signals"]
        ]
        for i, comparison in enumerate(self._found.get("comparisons") or []):
            if comparison["signal"] == name and f"comparison {i}" in self._series:
                models.append(self._comparison(comparison, self._series[f"comparison {i}"], q, shared))
        models[0].xaxis.axis_label = "time in s"
        self._holder.children = models
        self._address.value = "?" + urlencode({"signal": number})

    def _comparison(self, comparison: Mapping[str, Any], columns: Mapping[str, Floats], q: Any, shared: Range1d) -> Any:
        reasons = ": " + "; ".join(comparison["reasons"]) if comparison["reasons"] else ""
        plot = looks.plot(f"{comparison['name']}: {comparison['verdict']}{reasons}", 240, x_range=shared)
        pair = {side: q.scale * columns[side].astype(float) for side in ("measured", "computed")}
        source = ColumnDataSource({"time": columns["time"], **pair})
        chosen = style.looks(["measured", "computed"])
        for side, dashes in (("measured", "solid"), ("computed", "dashed")):
            plot.line("time", side, source=source, color=looks.line(chosen[side]), line_dash=dashes,
                      line_width=1.5, legend_label=side)  # fmt: skip
        looks.legend_above(plot)
        plot.yaxis.axis_label, plot.xaxis.axis_label = q.unit, "time in s"
        return plot


def _gaps(time: Floats, values: Floats) -> list[tuple[float, float]]:
    """Return where a signal has no sample, the longest gaps first."""
    missing = np.concatenate([[False], np.isnan(values), [False]])
    begins, stops = np.flatnonzero(missing[1:] & ~missing[:-1]), np.flatnonzero(missing[:-1] & ~missing[1:])
    left, right = time[np.maximum(begins - 1, 0)], time[np.minimum(stops, len(time) - 1)]
    found = list(zip(left.tolist(), right.tolist(), strict=True))
    return sorted(found, key=lambda pair: pair[0] - pair[1])[:_GAPS]
