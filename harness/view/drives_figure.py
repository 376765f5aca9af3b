"""Recordings as measured and as a model simulates them before and after: over time and over the path."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
from bokeh.layouts import column, row
from bokeh.models import ColumnDataSource, DataRange1d, Range1d, Select
from bokeh.palettes import Cividis256
from bokeh.transform import linear_cmap

from harness.common.arrays import Floats
from harness.models.quantities import capital, quantity
from harness.reporting import style
from harness.view import looks

Series = Mapping[str, Mapping[str, Floats]]
MEASURED, BEFORE, AFTER = "measured", "before", "after"
"""Before the name of an output in what ``harness.common.series`` keeps."""


class DrivesFigure:
    """Outputs and residuals of one recording at a time.

    Args:
        series: By recording, as ``harness.common.series.unpacked`` returns them.
        held_out: Names of those that were not fitted; they come first.
        chosen: Indices of recording and output that are shown first.
        told: Is given both whenever they change.

    Attributes:
        layout: What goes into the page.
    """

    def __init__(
        self, series: Series, held_out: Sequence[str], chosen: tuple[int, int], keep: Callable[[int, int], None]
    ) -> None:
        self._series, self._told = series, keep
        self._drives = sorted(series, key=lambda name: name not in held_out)
        first = series[self._drives[0]]
        self._outputs = [k.removeprefix(f"{MEASURED} ") for k in first if k.startswith(f"{MEASURED} ")]
        said = [(str(i), f"{d}{', held out' if d in held_out else ''}") for i, d in enumerate(self._drives)]
        outputs = [(str(i), quantity(o).words) for i, o in enumerate(self._outputs)]
        drive, output = min(chosen[0], len(said) - 1), min(chosen[1], len(outputs) - 1)
        self._drive = Select(title="Recording", options=said, value=str(drive), width=320)
        self._output = Select(title="Output", options=outputs, value=str(output), width=260)
        self._source = ColumnDataSource({})
        self._path = ColumnDataSource({})
        self._holder = column(sizing_mode="stretch_width")
        for select in (self._drive, self._output):
            select.on_change("value", lambda _a, _o, _n: self._draw())
        widgets = row(self._drive, self._output, styles={"flex-wrap": "wrap"}, sizing_mode="stretch_width")
        self.layout = column(widgets, self._holder, sizing_mode="stretch_width")
        self._draw()

    def _draw(self) -> None:
        drive, output = int(self._drive.value), int(self._output.value)
        columns, name = self._series[self._drives[drive]], self._outputs[output]
        q = quantity(name)
        values = {w: q.scale * columns[f"{w} {name}"].astype(float) for w in (MEASURED, BEFORE, AFTER)}
        errors = {f"left {w}": values[MEASURED] - values[w] for w in (BEFORE, AFTER)}
        self._source = ColumnDataSource({"time": columns["time"], **values, **errors})
        time = Range1d(float(columns["time"][0]), float(columns["time"][-1]), bounds="auto")
        before, after = style.looks(["before", "after"]).values()
        plots = [
            self._lines(f"{capital(q.words)}: measured and simulated", q.unit, time, 300, [
                (MEASURED, "measured", style.MEASURED, "solid", 1.4),
                (BEFORE, "before", looks.line(before), "solid", 1.4),
                (AFTER, "after", looks.line(after), "dashed", 1.6),
            ], _reach(values[MEASURED])),
            self._lines("Residual: measured less simulated", q.unit, time, 240, [
                (f"left {BEFORE}", "before", looks.line(before), "solid", 1.2),
                (f"left {AFTER}", "after", looks.line(after), "solid", 1.2),
            ], _reach(errors[f"left {BEFORE}"], errors[f"left {AFTER}"])),
        ]  # fmt: skip
        plots[-1].xaxis.axis_label = "time in s"
        if "x" in columns:
            paths = self._paths(columns, errors, q.unit)
            plots.append(row(*paths, sizing_mode="stretch_width", styles={"flex-wrap": "wrap"}))
        self._holder.children = plots
        self._told(drive, output)

    def _lines(self, title: str, unit: str, time: Range1d, height: int, lines: list[Any], reach: float) -> Any:
        plot = looks.plot(title, height, x_range=time)
        plot.yaxis.axis_label = unit
        if np.isfinite(reach) and reach > 0:
            plot.y_range = Range1d(-reach, reach)
        for field, legend, colour, dashes, width in lines:
            drawn = plot.line(
                "time",
                field,
                source=self._source,
                color=colour,
                line_dash=dashes,
                line_width=width,
                legend_label=legend,
            )
            plot.add_tools(looks.hover([drawn], ("t", "@time s"), (legend, f"@{{{field}}}{{0.000 a}}")))
        looks.legend_above(plot)
        plot.legend.click_policy = "hide"
        return plot

    def _paths(self, columns: Mapping[str, Floats], errors: dict[str, Floats], unit: str) -> list[Any]:
        """Return the path, coloured by the residual before and after on one scale."""
        x, y = columns["x"].astype(float), columns["y"].astype(float)
        sizes = {w: np.abs(errors[f"left {w}"]) for w in (BEFORE, AFTER)}
        finite = sizes[BEFORE][np.isfinite(sizes[BEFORE])]
        most = float(np.quantile(finite, 0.99)) if finite.size else 1.0
        ends = {"x0": x[:-1], "y0": y[:-1], "x1": x[1:], "y1": y[1:]}
        self._path = ColumnDataSource(ends | {w: v[:-1] for w, v in sizes.items()})
        plots, shared = [], None
        for which in (BEFORE, AFTER):
            mapper = linear_cmap(which, list(Cividis256), 0.0, max(most, 1e-12), nan_color="#bbbbbb")
            plot = looks.plot(f"Residual over the path, {which}", 380, tools="pan,wheel_zoom,reset", match_aspect=True)
            drawn = plot.segment("x0", "y0", "x1", "y1", source=self._path, line_width=5, line_color=mapper)
            if shared is None:
                shared = DataRange1d(renderers=[drawn]), DataRange1d(renderers=[drawn])
            plot.x_range, plot.y_range = shared
            plot.xaxis.axis_label, plot.yaxis.axis_label = "x in m, ahead at the start", "y in m, left at the start"
            title = f"size in {unit}" if unit else "size"
            looks.colour_bar(plot, mapper["transform"], title)
            plot.styles = {"flex": "1 1 480px"}
            plots.append(plot)
        return plots


def _reach(*columns: Floats) -> float:
    """Return one and a half times the largest size, so that a simulation that leaves its range hides nothing."""
    magnitudes = np.concatenate([np.abs(c[np.isfinite(c)]) for c in columns])
    if not magnitudes.size:
        return 1.0
    middle = float(np.quantile(magnitudes, 0.999))
    return 1.3 * min(float(magnitudes.max()), 3 * middle)
