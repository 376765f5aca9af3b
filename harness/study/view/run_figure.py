"""The figures of a run over time: truth and estimates with their bands, innovations, NIS, inputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, Range1d

from harness.models.quantities import quantity, words
from harness.reporting import style
from harness.reporting.style import Look
from harness.study.view import looks

_INPUTS = 4
"""Inputs that are drawn."""


class RunFigure:
    """A column of figures over one time axis, renewed in place as long as it shows the same things.

    Args:
        chosen: Look by estimator.

    Attributes:
        layout: What goes into the page.
    """

    def __init__(self, chosen: dict[str, Look]) -> None:
        self._looks, self._range = chosen, Range1d(0, 1)
        self._shown: tuple[tuple[str, ...], tuple[str, ...], bool] | None = None
        self.layout = column(sizing_mode="stretch_width")
        self._sources: dict[str, ColumnDataSource] = {}

    def show(self, data: xr.Dataset, signals: Sequence[str]) -> None:
        """Draw a run; ``signals`` are those of its targets that are wanted."""
        estimators = [str(e) for e in data["estimator"].values]
        wanted = [s for s in signals if s in data["target"].values]
        key = (tuple(estimators), tuple(wanted), "nis" in data)
        columns = _columns(data, estimators, wanted)
        if key == self._shown:
            for name, values in columns.items():
                self._sources[name].data = values
            return
        self._shown, self._sources = key, {name: ColumnDataSource(v) for name, v in columns.items()}
        time = data["time"].values
        self._range = Range1d(float(time[0]), float(time[-1]), bounds="auto")
        plots = [self._signal(name, estimators, i == 0) for i, name in enumerate(wanted)]
        if "nis" in data:
            plots += [self._innovation(str(o), estimators) for o in data["output"].values]
            plots.append(self._nis(estimators, float(data["nis"].attrs["expected"])))
        plots += [self._input(n) for n in list(self._sources) if n.startswith("input_")][:_INPUTS]
        plots[-1].xaxis.axis_label = "time in s"
        plots[-1].height += 30
        self.layout.children = plots

    def _plot(self, title: str, height: int, **further: Any) -> Any:
        return looks.plot(title, height, x_range=self._range, **further)

    def _signal(self, name: str, estimators: Sequence[str], legend: bool) -> Any:
        q, source = quantity(name), self._sources[f"signal {name}"]
        found = self._plot(q.words[:1].upper() + q.words[1:], 230)
        found.yaxis.axis_label = q.unit
        for i, estimator in enumerate(estimators):
            look = self._looks[estimator]
            found.varea("time", f"low {i}", f"high {i}", source=source, color=looks.colour(look.line), alpha=0.18)
        truth = found.line("time", "truth", source=source, color=style.TRUTH, line_width=2.4, legend_label="truth")
        for i, estimator in enumerate(estimators):
            look = self._looks[estimator]
            drawn = found.line(
                "time", f"estimate {i}", source=source, color=looks.colour(look.line), line_width=1.6,
                line_dash=looks.dash(look), legend_label=estimator,
            )  # fmt: skip
            found.add_tools(looks.hover([drawn], ("t", "@time s"), ("estimate", f"@{{estimate {i}}}{{0.000 a}}")))
        found.add_tools(looks.hover([truth], ("t", "@time s"), ("truth", "@truth{0.000 a}")))
        found.legend.visible = legend
        found.legend.orientation, found.legend.location = "horizontal", "top_left"
        found.legend.background_fill_alpha, found.legend.border_line_color = 0.7, None
        found.legend.padding = 2
        return found

    def _innovation(self, output: str, estimators: Sequence[str]) -> Any:
        q, source = quantity(output), self._sources[f"innovation {output}"]
        found = self._plot(f"Innovation ± 2σ: {q.words}", 170)
        found.yaxis.axis_label = q.unit
        for i, estimator in enumerate(estimators):
            line = looks.colour(self._looks[estimator].line)
            found.line("time", f"innovation {i}", source=source, color=line, alpha=0.7)
            for side in ("low", "high"):
                found.line("time", f"{side} {i}", source=source, color=line, line_dash="dashed", line_width=1.5)
        return found

    def _nis(self, estimators: Sequence[str], expected: float) -> Any:
        found = self._plot(f"NIS, mean of a second (expected: {expected:g})", 170,
                           y_axis_type="log")  # fmt: skip
        for i, estimator in enumerate(estimators):
            look = self._looks[estimator]
            found.line("time", f"nis {i}", source=self._sources["nis"], color=looks.colour(look.line))
        found.line("time", "expected", source=self._sources["nis"], color=style.TRUTH, line_dash="dashed")
        return found

    def _input(self, name: str) -> Any:
        q = quantity(name.removeprefix("input_"))
        found = self._plot(f"Input: {words(q.words)}", 140)
        found.yaxis.axis_label = q.unit
        found.line("time", "value", source=self._sources[name], color="#444444")
        return found


def _columns(data: xr.Dataset, estimators: Sequence[str], signals: Sequence[str]) -> dict[str, dict[str, Any]]:
    """Return what each figure draws, in report units."""
    time, found = data["time"].values, {}
    for name in signals:
        q, own = quantity(name), data.sel(target=name)
        columns = {"time": time, "truth": q.scale * own["truth"].values}
        for i, estimator in enumerate(estimators):
            value, spread = (q.scale * own[v].sel(estimator=estimator).values for v in ("estimate", "std"))
            columns |= {f"estimate {i}": value, f"low {i}": value - 2 * spread, f"high {i}": value + 2 * spread}
        found[f"signal {name}"] = columns
    if "nis" in data:
        for output in map(str, data["output"].values):
            q, own = quantity(output), data.sel(output=output)
            columns = {"time": time}
            for i, estimator in enumerate(estimators):
                value, spread = (
                    q.scale * own[v].sel(estimator=estimator).values for v in ("innovation", "innovation_std")
                )
                columns |= {f"innovation {i}": value, f"low {i}": -2 * spread, f"high {i}": 2 * spread}
            found[f"innovation {output}"] = columns
        window = max(1, round(1.0 / float(time[1] - time[0])))
        nis = {f"nis {i}": _averaged(data["nis"].values[:, i], window) for i in range(len(estimators))}
        expected = np.full(len(time), float(data["nis"].attrs["expected"]))
        found["nis"] = {"time": time, "expected": expected, **nis}
    for name in (str(n) for n in data if str(n).startswith("input_") and not str(n).endswith("_rate")):
        scale = quantity(name.removeprefix("input_")).scale
        found[name] = {"time": time, "value": scale * data[name].values}
    return found


def _averaged(values: np.ndarray, window: int) -> np.ndarray:
    """Return the mean over a window before each sample; NaN where it holds none."""
    known = np.isfinite(values)
    sums, counts = (np.concatenate([[0.0], np.cumsum(v)]) for v in (np.where(known, values, 0.0), known))
    first = np.maximum(np.arange(len(values)) + 1 - window, 0)
    total, count = sums[1:] - sums[first], counts[1:] - counts[first]
    return np.where(known & (count > 0), total / np.maximum(count, 1), np.nan)
