"""Figures of a design over several factors, with one selection in all of them, and what the factors explain."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
from bokeh.document import Document
from bokeh.events import SelectionGeometry
from bokeh.layouts import column, row
from bokeh.models import (
    BasicTicker,
    ColumnDataSource,
    FixedTicker,
    LegendItem,
    LinearColorMapper,
    LogColorMapper,
    RangeSlider,
    Select,
    Span,
)
from bokeh.palettes import Cividis256

from harness.common.statistics import Interval
from harness.reporting import style
from harness.study.report.analysis import Analysis
from harness.study.report.ranking import limits_of, tolerances
from harness.study.report.sections.over_time import AlongDrive
from harness.study.report.sections.tolerance import value_at
from harness.study.results import Design
from harness.study.score_names import PENDING
from harness.view import looks
from harness.view.boxes import RANKS, SCORES, unit_of
from harness.view.factors import PARALLEL, Brush, Points, points_of, shares, varied
from harness.view.frame import said

_TOOLS = "box_select,tap,reset"
_DRAWN = 4  # factors over time


class FactorsPanel:
    """The factors of a design.

    Args:
        document: Of the page.
        analysis: Of the study.
        choose: Told the run of a single point that is clicked: band, drive, sample, repeat, and the estimator.
        brushed: Told what is selected, ``None`` for nothing.
        along: Told the Sobol indices over the drive of the study that keeps them, ``None`` where there are none.

    Attributes:
        layout: What goes into the page; empty where a design has less than two factors that vary.
        brush: The part of a figure that is selected.
    """

    def __init__(
        self,
        document: Document,
        analysis: Analysis,
        choose: Callable[[tuple[int, int, int, int], int], None],
        brushed: Callable[[Brush | None], None],
        along: Callable[[AlongDrive | None], None],
    ) -> None:
        self._document, self._analysis, self._choose = document, analysis, choose
        self._brushed_to, self._told_along = brushed, along
        self.brush: Brush | None = None
        self.layout = column(sizing_mode="stretch_width")
        self._estimator = Select(title="Estimator", width=260)
        self._estimator.on_change("value", lambda _a, _o, _n: self._draw())
        self._part = Select(title="Points by", width=260)
        self._part.on_change("value", lambda _a, _o, _n: self._set_range())
        self._range = RangeSlider(title="between", start=0.0, end=1.0, value=(0.0, 1.0), step=0.01, width=300)
        self._range.on_change("value_throttled", lambda _a, _o, new: self._by_range(*new))
        self._rank = Select(title="Their run", options=list(RANKS.items()), value="", width=120)
        self._rank.on_change("value", lambda _a, _o, new: self._by_rank(new))
        self._shown: tuple[int, str, int, int | None] | None = None
        self._points: Points | None = None
        self._source = ColumnDataSource()
        self._busy = False

    def show(self, design: int, score: str, target: int, drive: int | None) -> None:
        """Draw a design: one of ``SCORES`` of a target, on one drive or on all."""
        now = design, score, target, drive
        if now == self._shown:
            return
        self._shown = now
        chosen = self._analysis.store.designs[design]
        self._busy = True
        self._estimator.options = [(str(e), chosen.estimators[e]) for e in chosen.giving(target)]
        if self._estimator.value not in dict(self._estimator.options):
            self._estimator.value = self._estimator.options[0][0] if self._estimator.options else ""
        self._busy = False
        self._draw()

    def _draw(self) -> None:
        if self._busy or self._shown is None:
            return
        number, score, target, drive = self._shown
        design = self._analysis.store.designs[number]
        if len(varied(design)) < 2 or not self._estimator.value:
            self.layout.children = []
            return
        estimator = int(self._estimator.value)
        self._told_along(None)
        self._points = points_of(design, score, target, estimator, drive)
        label = SCORES[score] + style.in_unit(unit_of(score, design.targets[target]))
        figures = self._brushed(design, label)
        self._set_parts(design)
        chosen = row(self._estimator, self._part, self._range, self._rank, styles=_WRAPPED, sizing_mode="stretch_width")
        self.layout.children = [said(_HINT), chosen, *figures]
        if score == "rmse" and drive is None:
            self._document.add_next_tick_callback(partial(self.explain, self._shown, estimator))

    def explain(self, shown: tuple[int, str, int, int | None], estimator: int) -> None:
        """Add what the factors explain, which takes longer, behind the points."""
        if shown == self._shown and self._estimator.value == str(estimator):
            self.layout.children = [*self.layout.children[:4], *self._explained(shown[0], shown[2], estimator)]

    def _brushed(self, design: Design, label: str) -> list[Any]:
        """Return parallel coordinates and a scatter per factor, all over one source."""
        points, factors = self._points, varied(design)
        assert points is not None
        placed = {i: shares(design.factors[i], points.values[:, i]) for i in factors}
        at = np.arange(len(factors))
        finite = points.scores[np.isfinite(points.scores)]
        low, high = (float(finite.min()), float(finite.max())) if finite.size else (0.0, 1.0)
        log = low > 0 and high > 5 * low
        mapper = (LogColorMapper if log else LinearColorMapper)(
            palette=list(Cividis256), low=low, high=max(high, low + 1e-12), nan_color="#bbbbbb"
        )
        last = (
            (np.log(points.scores / low) / np.log(high / low))
            if log
            else (points.scores - low) / max(high - low, 1e-12)
        )
        lines = np.column_stack([*(placed[i] for i in factors), last])
        source = ColumnDataSource({
            "xs": [np.append(at, len(factors)) for _ in lines], "ys": list(lines), "score": points.scores,
            **{f"share {k}": lines[:, k] for k in range(lines.shape[1])},
            **{f"factor {i}": points.values[:, i] for i in factors},
        })  # fmt: skip
        self._source = source
        if self.brush is not None:
            columns = lines if self.brush.figure == PARALLEL else points.values[:, [int(self.brush.figure)]]
            source.selected.indices = self.brush.held(columns, points.scores)
        source.selected.on_change("indices", lambda _a, _o, new: self._selected(list(new)))
        colour = {"field": "score", "transform": mapper}
        parallel = looks.plot("Parallel coordinates", 360, tools=_TOOLS,
                              x_range=(-0.3, len(factors) + 0.3), y_range=(-0.06, 1.06),
                              name="parallel coordinates")  # fmt: skip
        parallel.multi_line(
            "xs", "ys", source=source, line_color=colour, line_width=1.2, line_alpha=0.6, nonselection_line_alpha=0.04,
            selection_line_alpha=1.0, selection_line_width=2.0,
        )  # fmt: skip
        for k in range(lines.shape[1]):
            parallel.scatter(k, f"share {k}", source=source, size=5, color=colour, alpha=0.8, nonselection_alpha=0.05)
            parallel.add_layout(Span(location=k, dimension="height", line_color="#888888", level="underlay"))
        ends = [design.factors[i] for i in factors]
        names = [
            f"{f.words}{style.in_unit(f.unit)}\n{style.number(f.values.min())} to {style.number(f.values.max())}"
            for f in ends
        ]
        names.append(f"{label}\n{style.number(low)} to {style.number(high)}")
        parallel.xaxis.ticker = FixedTicker(ticks=list(range(len(names))))
        parallel.xaxis.major_label_overrides = dict(enumerate(names))
        parallel.yaxis.visible = False
        parallel.on_event(SelectionGeometry, self._on_brush(PARALLEL))
        looks.colour_bar(parallel, mapper, label, ticker=BasicTicker())
        plots = []
        for i in factors:
            factor = design.factors[i]
            plot = looks.plot("", 270, tools=_TOOLS, y_axis_type="log" if log else "linear",
                              x_axis_type="log" if factor.log else "linear", name=f"scatter {i}")  # fmt: skip
            plot.scatter(
                f"factor {i}", "score", source=source, size=6, color=colour, alpha=0.85, nonselection_alpha=0.06
            )
            plot.xaxis.axis_label, plot.yaxis.axis_label = f"{factor.words}{style.in_unit(factor.unit)}", label
            plot.on_event(SelectionGeometry, self._on_brush(str(i)))
            plots.append(plot)
        parallel.min_width = 110 * (len(factors) + 1) + 120  # so that names do not overlap: a phone rolls it
        return [
            column(parallel, sizing_mode="stretch_width", styles={"overflow-x": "auto"}),
            column(*plots, sizing_mode="stretch_width", styles=_BESIDE),
        ]

    def _set_parts(self, design: Design) -> None:
        """Offer the factors to those who choose points by keyboard."""
        self._busy = True
        self._part.options = [(str(i), f"{f.words}{style.in_unit(f.unit)}") for i, f in enumerate(design.factors)
                              if i in varied(design)]  # fmt: skip
        if self._part.value not in dict(self._part.options):
            self._part.value = self._part.options[0][0]
        self._busy = False
        self._set_range()

    def _set_range(self) -> None:
        """Let the ends of the range be those of its factor, or of the part that is selected."""
        if self._busy or self._points is None:
            return
        values = self._points.values[:, int(self._part.value)]
        low, high = float(values.min()), float(values.max())
        brushed = self.brush if self.brush is not None and self.brush.figure == self._part.value else None
        part = (low, high) if brushed is None else (max(low, brushed.x0), min(high, brushed.x1))
        digits = max(0, min(6, 2 - math.floor(math.log10(high - low))))
        self._range.update(start=low, end=high, step=(high - low) / 100, value=part,
                           format=f"0[.]{'0' * digits}" if digits else "0")  # fmt: skip

    def _by_range(self, low: float, high: float) -> None:
        """Select the points with a factor between two values, whatever their score."""
        assert self._points is not None
        scores = self._points.scores[np.isfinite(self._points.scores)]
        if not scores.size:
            return
        ends = float(scores.min()), float(scores.max())
        beyond = 0.01 * (ends[1] - ends[0]) + 1e-12
        whole = low <= self._range.start and high >= self._range.end
        self.brush = None if whole else Brush(self._part.value, low, high, ends[0] - beyond, ends[1] + beyond)
        held = self.brush and self.brush.held(self._points.values[:, [int(self._part.value)]], self._points.scores)
        self._source.selected.indices = held or []
        self._brushed_to(self.brush)

    def _by_rank(self, rank: str) -> None:
        """Lead to the worst run of a selected point: that of the smallest, of the median or of the largest score."""
        if not rank or self._points is None:
            return
        scores, held = self._points.scores, self._source.selected.indices or range(len(self._points.scores))
        ranked = sorted((i for i in held if np.isfinite(scores[i])), key=lambda i: float(scores[i]))
        if ranked:
            self._lead_to(ranked[round(float(rank) * (len(ranked) - 1))])

    def _on_brush(self, figure: str) -> Callable[[Any], None]:
        def told(event: Any) -> None:
            g = event.geometry
            if event.final and g.get("type") == "rect":
                self.brush = Brush(figure, *(float(g[k]) for k in ("x0", "x1", "y0", "y1")))
                self._brushed_to(self.brush)

        return told

    def _selected(self, indices: list[int]) -> None:
        """Lead to the worst run of a point that was clicked alone; forget the brush where nothing is left of it."""
        if not indices and self.brush is not None:
            self.brush = None
            self._brushed_to(None)
        self._rank.value = ""
        if len(indices) == 1:
            self._lead_to(indices[0])

    def _lead_to(self, point: int) -> None:
        assert self._points is not None
        band, sample = map(int, self._points.places[point])
        drive, repeat = map(int, self._points.worst[point])
        self._choose((band, drive, sample, repeat), int(self._estimator.value))

    def _explained(self, number: int, target: int, estimator: int) -> list[Any]:
        """Return Sobol indices, over the drive where they are kept, or the tolerance box."""
        findings = self._analysis.findings[number]
        design = findings.design
        if design.count(PENDING):
            return [said("The design is not finished: indices and tolerances need all of its points.")]
        if design.sampling == "saltelli":
            indices = findings.ranking.errors[target][estimator]
            plots = [] if indices is None else [_indices(design, indices.first, indices.total)]
            if "rmse_over_time" in design.data and findings.ranking.errors[target][findings.ranking.best(target)]:
                found_along = AlongDrive(findings.ranking, target)
                plots.append(_along(found_along))
                self._told_along(found_along)
            return plots
        if design.sampling == "tolerance":
            borne = tolerances(design, limits_of(self._analysis.store.attributes)).get((target, estimator))
            return [] if borne is None else [tolerance_box(design, borne.lower, borne.upper, borne.box)]
        return []


def _indices(design: Design, first: tuple[Interval, ...], total: tuple[Interval, ...]) -> Any:
    """Return first-order and total indices with their 95 % intervals."""
    names = [f.words for f in design.factors]
    ends = min(0.0, *(v.lower for v in (*first, *total))), max(1.0, *(v.upper for v in (*first, *total)))
    plot = looks.plot("Sobol indices, 95 % intervals", 120 + 56 * len(names), tools="reset",
                      x_range=(ends[0] - 0.05, ends[1] + 0.05), y_range=(-0.6, len(names) - 0.4),
                      name="Sobol indices")  # fmt: skip
    items = []
    for (name, indices, shift), look in zip(
        (("total", total, 0.1), ("first order", first, -0.1)), style.looks(["total", "first"]).values(), strict=True
    ):
        y = np.arange(len(names))[::-1] - 0.25 + shift
        source = ColumnDataSource({
            "y": y, "value": [v.value for v in indices], "lower": [v.lower for v in indices],
            "upper": [v.upper for v in indices], "name": names,
        })  # fmt: skip
        line = looks.line(look)
        plot.segment("lower", "y", "upper", "y", source=source, color=line, line_width=2.5)
        dots = plot.scatter("value", "y", source=source, color=line, size=9, marker="circle" if shift > 0 else "square")
        plot.add_tools(
            looks.hover([dots], ("", "@name"), (name, "@value{0.000}"), ("95 %", "@lower{0.000} to @upper{0.000}"))
        )
        items.append(LegendItem(label={"value": name}, renderers=[dots]))
    looks.legend_above(plot, items)
    plot.xaxis.axis_label = "share of the variance"
    looks.names_inside(plot, names, plot.x_range.start)
    return plot


def _along(along: AlongDrive) -> Any:
    """Return the total indices over the drive whose errors are kept over time."""
    who = along.design.estimators[along.estimator]
    plot = looks.plot(
        f"Total index over the drive {along.drive}, {who}", 280, y_range=(-0.05, 1.1), name="indices over time"
    )
    total = along.total
    order = np.argsort(-np.nan_to_num(total[:, :, 0]).mean(axis=1), kind="stable")[:_DRAWN]
    chosen = list(style.looks([str(i) for i in order]).values())
    for i, look in zip(order, chosen, strict=True):
        source = ColumnDataSource(
            {"t": along.time, **{n: total[i, :, k] for k, n in enumerate(("value", "lower", "upper"))}}
        )
        line = looks.line(look)
        plot.varea("t", "lower", "upper", source=source, color=line, alpha=0.15)
        plot.line("t", "value", source=source, color=line, line_dash=looks.dash(look), line_width=1.8,
                  legend_label=along.design.factors[i].words)  # fmt: skip
    looks.legend_above(plot)
    plot.xaxis.axis_label, plot.yaxis.axis_label = "time in s", "total index"
    return plot


def tolerance_box(design: Design, lower: Any, upper: Any, box: float) -> Any:
    """Return how far each factor alone may go, and all at once, as shares of the box of the study."""
    names = [
        f"{f.words}: {style.number(value_at(f, -below))} to {style.with_unit(value_at(f, above), f.unit)}"
        for f, below, above in zip(design.factors, lower, upper, strict=True)
    ]
    plot = looks.plot("Tolerated shares of the box: alone; all at once: dashed", 110 + 44 * len(names),
                      tools="reset", x_range=(-1.05, 1.05), y_range=(-0.6, len(names) - 0.4),
                      name="tolerance box")  # fmt: skip
    y, line = np.arange(len(names))[::-1] - 0.22, style.looks(["alone"])["alone"]
    source = ColumnDataSource({"y": y, "left": -np.asarray(lower), "right": np.asarray(upper), "name": names})
    drawn = plot.hbar("y", left="left", right="right", height=0.36, source=source, fill_color=looks.colour(line.tint),
                      line_color=looks.line(line))  # fmt: skip
    plot.add_tools(looks.hover([drawn], ("", "@name"), ("below", "@left{0.00}"), ("above", "@right{0.00}")))
    for at in (-box, box):
        plot.add_layout(Span(location=at, dimension="height", line_color="#000000", line_dash="dashed", line_width=2))
    plot.xaxis.axis_label = f"share of the way from what is {design.nominal_is} to the edge of the box"
    looks.names_inside(plot, names, plot.x_range.start)
    return plot


_WRAPPED = {"flex-wrap": "wrap", "align-items": "end", "gap": "10px 18px"}
_BESIDE = {"display": "grid", "grid-template-columns": "repeat(auto-fit, minmax(min(300px, 100%), 1fr))"}
_HINT = (
    "A line is a point of the design. Drag over a part of any figure: the same points stand out in all of them; reset "
    "shows all again. A click on one point computes its worst run again. By keyboard: choose points by a factor, and a "
    "run of theirs."
)
