"""The figures of a run over time: truth and estimates with their bands, innovations, NIS, inputs."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import xarray as xr
from bokeh.events import RangesUpdate, Tap
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, CustomJS, Range1d
from scipy.stats import chi2

from harness.common.arrays import Floats
from harness.common.thinning import kept
from harness.models.quantities import quantity, words
from harness.reporting import style
from harness.reporting.style import Look
from harness.study.replay import Replayed
from harness.study.view import looks

_INPUTS = 4
"""Inputs that are drawn."""


class RunFigure:
    """A column of figures over one time axis, renewed in place as long as it shows the same things.

    Of a run the samples are sent that the pixels show (``harness.common.thinning``); a closer look sends others.

    Args:
        chosen: Look by estimator.
        cursor: The time that a line marks, ``t``.
        to_here: What a click on a figure does.

    Attributes:
        layout: What goes into the page.
    """

    def __init__(self, chosen: dict[str, Look], cursor: ColumnDataSource, to_here: CustomJS) -> None:
        self._looks, self._range, self._cursor, self._to_here = chosen, Range1d(0, 1), cursor, to_here
        self._shown: tuple[tuple[str, ...], tuple[str, ...], bool] | None = None
        self.layout = column(sizing_mode="stretch_width")
        self._sources: dict[str, ColumnDataSource] = {}
        self._columns: dict[str, dict[str, Floats]] = {}

    def show(self, run: Replayed, signals: Sequence[str]) -> None:
        """Draw a run; ``signals`` are those of its targets, and of what its plant publishes, that are wanted."""
        data, estimators = run.data, [str(e) for e in run.data["estimator"].values]
        beyond = set() if run.everything is None else set(map(str, run.everything))
        wanted = [s for s in signals if s in data["target"].values or s in beyond]
        key = (tuple(estimators), tuple(wanted), "nis" in data)
        self._columns = _columns(run, estimators, wanted)
        if key == self._shown:
            self._send()
            return
        self._shown, time = key, data["time"].values
        self._sources = {n: ColumnDataSource({k: [] for k in v}) for n, v in self._columns.items()}
        self._range = Range1d(float(time[0]), float(time[-1]), bounds="auto")
        self._send()
        plots = [self._signal(name, estimators, i == 0) for i, name in enumerate(wanted)]
        if "nis" in data:
            plots += [self._innovation(str(o), estimators) for o in data["output"].values]
            plots.append(self._ratio("nis", "NIS, mean of a second", estimators))
            if np.isfinite(data["nees"].values).any():
                plots.append(self._ratio("nees", "NEES", estimators))
        plots += [self._input(n) for n in list(self._sources) if n.startswith("input_")][:_INPUTS]
        plots[-1].xaxis.axis_label = "time in s"
        plots[-1].height += 30
        plots[0].on_event(RangesUpdate, lambda _event: self._send())
        self.layout.children = plots

    def _send(self) -> None:
        """Send what the figures need of the part of the time axis that they show."""
        for name, columns in self._columns.items():
            time = columns["time"]
            first, stop = np.searchsorted(time, [self._range.start, self._range.end], side="right")
            lines = [
                v for k, v in columns.items() if k.startswith(("truth", "estimate", "innovation", "ni", "ne", "value"))
            ]
            rows = kept(lines, max(0, int(first) - 2), min(len(time), int(stop) + 1))
            self._sources[name].data = {k: v[rows] for k, v in columns.items()}

    def _plot(self, title: str, height: int, **further: Any) -> Any:
        found = looks.plot(title, height, x_range=self._range, **further)
        found.vspan("t", source=self._cursor, line_color="#D55E00", line_width=1.2)
        found.js_on_event(Tap, self._to_here)
        return found

    def _signal(self, name: str, estimators: Sequence[str], legend: bool) -> Any:
        q, source = quantity(name), self._sources[f"signal {name}"]
        found = self._plot(q.words[:1].upper() + q.words[1:], 230)
        found.yaxis.axis_label = q.unit
        for i, estimator in enumerate(estimators):
            look = self._looks[estimator]
            if f"low {i}" in source.data:
                found.varea("time", f"low {i}", f"high {i}", source=source, color=looks.colour(look.line), alpha=0.18)
        truth = found.line("time", "truth", source=source, color=style.TRUTH, line_width=2.4, legend_label="truth")
        for i, estimator in enumerate(estimators):
            if f"estimate {i}" not in source.data:
                continue
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

    def _ratio(self, name: str, words_: str, estimators: Sequence[str]) -> Any:
        found, source = (
            self._plot(f"{words_}; expected value and 95 % band", 190, y_axis_type="log"),
            self._sources[name],
        )
        found.yaxis.axis_label = name.upper()
        for i, estimator in enumerate(estimators):
            look = self._looks[estimator]
            drawn = found.line(
                "time", f"{name} {i}", source=source, color=looks.colour(look.line), line_dash=looks.dash(look)
            )
            found.add_tools(looks.hover([drawn], ("t", "@time s"), (name.upper(), f"@{{{name} {i}}}{{0.00}}")))
        for line, dashes in (("expected", "solid"), ("lower", "dashed"), ("upper", "dashed")):
            found.line("time", line, source=source, color=style.TRUTH, line_dash=dashes, line_width=1.6)
        return found

    def _input(self, name: str) -> Any:
        q = quantity(name.removeprefix("input_"))
        found = self._plot(f"Input: {words(q.words)}", 140)
        found.yaxis.axis_label = q.unit
        found.line("time", "value", source=self._sources[name], color="#444444")
        return found


def _columns(run: Replayed, estimators: Sequence[str], signals: Sequence[str]) -> dict[str, dict[str, Floats]]:
    """Return what each figure draws over all samples, in report units."""
    data, found = run.data, {}
    time = data["time"].values
    for name in signals:
        q, columns = quantity(name), {"time": time}
        if name not in data["target"].values:
            assert run.everything is not None
            found[f"signal {name}"] = columns | {"truth": q.scale * run.everything[name].values}
            continue
        own = data.sel(target=name)
        columns["truth"] = q.scale * own["truth"].values
        for i in range(len(estimators)):
            value, spread = (q.scale * own[v].values[:, i] for v in ("estimate", "std"))
            columns |= {f"estimate {i}": value, f"low {i}": value - 2 * spread, f"high {i}": value + 2 * spread}
        found[f"signal {name}"] = columns
    if "nis" in data:
        found |= _consistency(data, estimators)
    for name in (str(n) for n in data if str(n).startswith("input_") and not str(n).endswith("_rate")):
        scale = quantity(name.removeprefix("input_")).scale
        found[name] = {"time": time, "value": scale * data[name].values}
    return found


def _consistency(data: xr.Dataset, estimators: Sequence[str]) -> dict[str, dict[str, Floats]]:
    """Return innovations with their bounds, and NIS and NEES with what they should be.

    NIS of successive samples are independent in a consistent filter, so the mean of ``n`` has the band of a chi-square
    variable of ``n`` times as many degrees of freedom, over ``n``. Successive NEES are not, so theirs is that of one.
    """
    found, time = {}, data["time"].values
    for output in map(str, data["output"].values):
        q, own = quantity(output), data.sel(output=output)
        columns = {"time": time}
        for i in range(len(estimators)):
            value, spread = (q.scale * own[v].values[:, i] for v in ("innovation", "innovation_std"))
            columns |= {f"innovation {i}": value, f"low {i}": -2 * spread, f"high {i}": 2 * spread}
        found[f"innovation {output}"] = columns
    for name, window in (("nis", max(1, round(1.0 / float(time[1] - time[0])))), ("nees", 1)):
        freedom = float(data[name].attrs["expected"])
        lower, upper = chi2.ppf([0.025, 0.975], window * freedom) / window
        lines = {"expected": freedom, "lower": float(lower), "upper": float(upper)}
        values = {f"{name} {i}": _averaged(data[name].values[:, i], window) for i in range(len(estimators))}
        found[name] = {"time": time, **{k: np.full(len(time), v) for k, v in lines.items()}, **values}
    return found


def _averaged(values: np.ndarray, window: int) -> np.ndarray:
    """Return the mean over a window before each sample; NaN where it holds none."""
    known = np.isfinite(values)
    sums, counts = (np.concatenate([[0.0], np.cumsum(v)]) for v in (np.where(known, values, 0.0), known))
    first = np.maximum(np.arange(len(values)) + 1 - window, 0)
    total, count = sums[1:] - sums[first], counts[1:] - counts[first]
    return np.where(known & (count > 0), total / np.maximum(count, 1), np.nan)
