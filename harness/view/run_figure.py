"""The figures of a run over time: truth and estimates with their bands, innovations, NIS, inputs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import xarray as xr
from bokeh.events import RangesUpdate, Tap
from bokeh.layouts import column
from bokeh.models import ColumnDataSource, CustomJS, LegendItem, Range1d
from scipy.stats import chi2

from harness.common.arrays import Floats
from harness.common.series import thinned
from harness.models.quantities import capital, quantity, words
from harness.reporting import style
from harness.reporting.style import Look
from harness.study.replay import Replayed
from harness.view import looks
from harness.view.frame import said

_INPUTS = 4
"""Inputs that are drawn."""


@dataclass
class _Slot:
    """What the figures draw of one estimator, whichever it is: making them anew would take a second.

    Attributes:
        areas: Bands.
        lines: Lines that have its colour alone.
        dashed: Lines that have its dashes as well.
        labels: Its names in legends.
    """

    areas: list[Any] = field(default_factory=list)
    lines: list[Any] = field(default_factory=list)
    dashed: list[Any] = field(default_factory=list)
    labels: list[Any] = field(default_factory=list)
    _name: str = ""

    def wear(self, name: str, look: Look) -> None:
        """Show an estimator."""
        if name == self._name:
            return
        self._name, colour = name, looks.line(look)
        for glyph in self.areas:
            glyph.fill_color = colour
        for glyph in (*self.lines, *self.dashed):
            glyph.line_color = colour
        for glyph in self.dashed:
            glyph.line_dash = looks.dash(look)
        for item in self.labels:
            item.label = {"value": name}


class RunFigure:
    """A column of figures over one time axis, renewed in place as long as signals and number of estimators stay.

    Of a run the samples are sent that the pixels show (``harness.common.series``); a closer look sends others.

    Args:
        chosen: Look by estimator.
        cursor: The time that a line marks, ``t``.
        to_here: What a click on a figure does.

    Attributes:
        layout: What goes into the page.
    """

    def __init__(self, chosen: dict[str, Look], cursor: ColumnDataSource, to_here: CustomJS) -> None:
        self._looks, self._range, self._cursor, self._to_here = chosen, Range1d(0, 1), cursor, to_here
        self._made_for: tuple[Any, ...] | None = None
        self.layout = column(said("Truth and estimates, once a run is chosen."), sizing_mode="stretch_width")
        self._sources: dict[str, ColumnDataSource] = {}
        self._columns: dict[str, dict[str, Floats]] = {}
        self._slots: list[_Slot] = []

    def show(self, run: Replayed, signals: Sequence[str]) -> None:
        """Draw a run; ``signals`` are those of its targets, and of what its plant publishes, that are wanted.

        A run without innovations, as it is computed while a slider moves, leaves their figures as they are: emptied and
        filled again, they would take longer to paint than all that moves.
        """
        data, estimators = run.data, [str(e) for e in run.data["estimator"].values]
        beyond = set() if run.everything is None else set(map(str, run.everything))
        there = [s for s in signals if s in data["target"].values or s in beyond]
        self._columns = _columns(run, estimators, there)
        sought = len(estimators), tuple(signals)
        if self._made_for is None or self._made_for[:2] != sought or ("nis" in data and not self._made_for[2]):
            self._made_for = *sought, "nis" in data
            self._make(run, len(estimators), there)
        self._send()
        for slot, name in zip(self._slots, estimators, strict=True):
            slot.wear(name, self._looks[name])

    def _make(self, run: Replayed, count: int, signals: Sequence[str]) -> None:
        """Make the figures; which estimators they show is left open."""
        data, time = run.data, run.data["time"].values
        self._slots = [_Slot() for _ in range(count)]
        self._sources = {n: ColumnDataSource({k: [] for k in v}) for n, v in self._columns.items()}
        self._range = Range1d(float(time[0]), float(time[-1]), bounds="auto")
        plots = [self._signal(name, i == 0) for i, name in enumerate(signals)]
        if "nis" in data:
            plots += [self._innovation(str(o)) for o in data["output"].values]
            plots.append(self._ratio("nis", "NIS, mean of a second"))
            if np.isfinite(data["nees"].values).any():
                plots.append(self._ratio("nees", "NEES"))
        plots += [self._input(n) for n in list(self._sources) if n.startswith("input_")][:_INPUTS]
        plots[-1].xaxis.axis_label = "time in s"
        plots[-1].height += 30
        plots[0].on_event(RangesUpdate, lambda _event: self._send())
        self.layout.children = plots

    def _send(self) -> None:
        """Send what the figures need of the part of the time axis that they show."""
        for name, source in self._sources.items():
            columns = self._columns.get(name, {})
            if columns.keys() != source.data.keys():
                continue
            time = columns["time"]
            first, stop = np.searchsorted(time, [self._range.start, self._range.end], side="right")
            lines = [
                v for k, v in columns.items() if k.startswith(("truth", "estimate", "innovation", "ni", "ne", "value"))
            ]
            rows = thinned(lines, max(0, int(first) - 2), min(len(time), int(stop) + 1))
            data = {k: v[rows] for k, v in columns.items()}
            if not all(np.array_equal(v, source.data[k], equal_nan=True) for k, v in data.items()):
                source.data = data  # inputs are those of the drive whatever a slider changes

    def _plot(self, title: str, height: int, **further: Any) -> Any:
        plot = looks.plot(title, height, x_range=self._range, **further)
        plot.vspan("t", source=self._cursor, line_color="#D55E00", line_width=1.2, level="overlay")  # moves alone
        plot.js_on_event(Tap, self._to_here)
        return plot

    def _signal(self, name: str, legend: bool) -> Any:
        q, source = quantity(name), self._sources[f"signal {name}"]
        plot = self._plot(capital(q.words), 230)
        plot.yaxis.axis_label = q.unit
        for i, slot in enumerate(self._slots):
            if f"low {i}" in source.data:
                slot.areas.append(plot.varea("time", f"low {i}", f"high {i}", source=source, alpha=0.18).glyph)
        truth = plot.line("time", "truth", source=source, color=style.TRUTH, line_width=2.4)
        items = [LegendItem(label={"value": "truth"}, renderers=[truth])]
        for i, slot in enumerate(self._slots):
            if f"estimate {i}" not in source.data:
                continue
            drawn = plot.line("time", f"estimate {i}", source=source, line_width=1.6)
            slot.dashed.append(drawn.glyph)
            plot.add_tools(looks.hover([drawn], ("t", "@time s"), ("estimate", f"@{{estimate {i}}}{{0.000 a}}")))
            items.append(LegendItem(label={"value": ""}, renderers=[drawn]))
            slot.labels.append(items[-1])
        plot.add_tools(looks.hover([truth], ("t", "@time s"), ("truth", "@truth{0.000 a}")))
        if legend:
            looks.legend_above(plot, items)
        return plot

    def _innovation(self, output: str) -> Any:
        q, source = quantity(output), self._sources[f"innovation {output}"]
        plot = self._plot(f"Innovation ± 2σ: {q.words}", 170)
        plot.yaxis.axis_label = q.unit
        for i, slot in enumerate(self._slots):
            slot.lines.append(plot.line("time", f"innovation {i}", source=source, alpha=0.7).glyph)
            for side in ("low", "high"):
                bound = plot.line("time", f"{side} {i}", source=source, line_dash="dashed", line_width=1.5)
                slot.lines.append(bound.glyph)
        return plot

    def _ratio(self, name: str, words_: str) -> Any:
        source = self._sources[name]
        plot = self._plot(f"{words_} (black: expected, 95 %)", 190, y_axis_type="log")
        plot.yaxis.axis_label = name.upper()
        for i, slot in enumerate(self._slots):
            drawn = plot.line("time", f"{name} {i}", source=source)
            slot.dashed.append(drawn.glyph)
            plot.add_tools(looks.hover([drawn], ("t", "@time s"), (name.upper(), f"@{{{name} {i}}}{{0.00}}")))
        for line, dashes in (("expected", "solid"), ("lower", "dashed"), ("upper", "dashed")):
            plot.line("time", line, source=source, color=style.TRUTH, line_dash=dashes, line_width=1.6)
        return plot

    def _input(self, name: str) -> Any:
        q = quantity(name.removeprefix("input_"))
        plot = self._plot(f"Input: {words(q.words)}", 140)
        plot.yaxis.axis_label = q.unit
        plot.line("time", "value", source=self._sources[name], color="#444444")
        return plot


def _columns(run: Replayed, estimators: Sequence[str], signals: Sequence[str]) -> dict[str, dict[str, Floats]]:
    """Return what each figure draws over all samples, in report units."""
    data, sources = run.data, {}
    time = data["time"].values
    for name in signals:
        q, columns = quantity(name), {"time": time}
        if name not in data["target"].values:
            assert run.everything is not None
            sources[f"signal {name}"] = columns | {"truth": q.scale * run.everything[name].values}
            continue
        own = data.sel(target=name)
        columns["truth"] = q.scale * own["truth"].values
        for i in range(len(estimators)):
            value, spread = (q.scale * own[v].values[:, i] for v in ("estimate", "std"))
            columns |= {f"estimate {i}": value, f"low {i}": value - 2 * spread, f"high {i}": value + 2 * spread}
        sources[f"signal {name}"] = columns
    if "nis" in data:
        sources |= _consistency(data, estimators)
    for name in (str(n) for n in data if str(n).startswith("input_") and not str(n).endswith("_rate")):
        scale = quantity(name.removeprefix("input_")).scale
        sources[name] = {"time": time, "value": scale * data[name].values}
    return sources


def _consistency(data: xr.Dataset, estimators: Sequence[str]) -> dict[str, dict[str, Floats]]:
    """Return innovations with their bounds, and NIS and NEES with what they should be.

    NIS of successive samples are independent in a consistent filter, so the mean of ``n`` has the band of a chi-square
    variable of ``n`` times as many degrees of freedom, over ``n``. Successive NEES are not, so theirs is that of one.
    """
    sources, time = {}, data["time"].values
    for output in map(str, data["output"].values):
        q, own = quantity(output), data.sel(output=output)
        columns = {"time": time}
        for i in range(len(estimators)):
            value, spread = (q.scale * own[v].values[:, i] for v in ("innovation", "innovation_std"))
            columns |= {f"innovation {i}": value, f"low {i}": -2 * spread, f"high {i}": 2 * spread}
        sources[f"innovation {output}"] = columns
    for name, window in (("nis", max(1, round(1.0 / float(time[1] - time[0])))), ("nees", 1)):
        freedom = float(data[name].attrs["expected"])
        lower, upper = chi2.ppf([0.025, 0.975], window * freedom) / window
        lines = {"expected": freedom, "lower": float(lower), "upper": float(upper)}
        values = {f"{name} {i}": _averaged(data[name].values[:, i], window) for i in range(len(estimators))}
        sources[name] = {"time": time, **{k: np.full(len(time), v) for k, v in lines.items()}, **values}
    return sources


def _averaged(values: np.ndarray, window: int) -> np.ndarray:
    """Return the mean over a window before each sample; NaN where it holds none."""
    finite = np.isfinite(values)
    sums, counts = (np.concatenate([[0.0], np.cumsum(v)]) for v in (np.where(finite, values, 0.0), finite))
    first = np.maximum(np.arange(len(values)) + 1 - window, 0)
    total, count = sums[1:] - sums[first], counts[1:] - counts[first]
    return np.where(finite & (count > 0), total / np.maximum(count, 1), np.nan)
