"""The figure of box plots, and which run a click on it means."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
from bokeh.models import ColumnDataSource, CustomJS, FixedTicker, LegendItem, LinearAxis, Span

from harness.models.quantities import Quantity
from harness.reporting import style
from harness.reporting.style import Look
from harness.view import looks
from harness.view.boxes import POINTS, SCORES, Box, unit_of

_NO_WIDER = """
const pixels = Math.max(1.5, Math.min(5, 0.5 * wide * cb_obj.inner_width));
points.setv({size: {value: pixels}}, {sync: false});
"""
"""Points that are half as wide as a box, so that on a phone nine estimators do not cover each other."""


@dataclass(frozen=True)
class Across:
    """What boxes stand at, from left to right.

    Attributes:
        labels: Of the levels, drives or studies.
        of: What they are of.
        groups: Label of what each belongs to; successive ones that are alike are written once, below the labels.
    """

    labels: Sequence[str]
    of: str = ""
    groups: Sequence[str] = ()


class BoxFigure:
    """Boxes across levels or drives, one estimator next to the other.

    Args:
        boxes: What is drawn.
        across: What they stand at.
        estimators: Names by index.
        chosen: Look by name.
        score: One of ``SCORES``.
        target: What it is of.
        log: Whether the axis is logarithmic.
        title: Of the figure, if the score does not say all.
        reference: Lines across all boxes, the dashes of each by its value.

    Attributes:
        plot: The figure.
        marked: Source of the run that is shown: ``x`` and ``y`` of its scores.
    """

    def __init__(
        self,
        boxes: Sequence[Box],
        across: Across,
        estimators: Sequence[str],
        chosen: dict[str, Look],
        score: str,
        target: Quantity,
        log: bool,
        title: str = "",
        reference: Mapping[float, str] = MappingProxyType({}),
    ) -> None:
        self._boxes, self._names = [b for b in boxes if len(b.values)], estimators
        labels = self._labels = across.labels
        self._groups = across.groups
        self._log = log and all((b.values > 0).all() for b in self._boxes)
        self.estimators = list(dict.fromkeys(b.estimator for b in boxes))
        self.width = 0.84 / max(1, len(self.estimators))
        self._unit = unit_of(score, target)
        self.plot = looks.plot(
            title
            or f"{SCORES[score]}{'' if score in ('nees', 'nis', 'time_of_divergence') else ' of the ' + target.words}",
            460,
            tools="pan,wheel_zoom,box_zoom,reset",
            y_axis_type="log" if self._log else "linear",
            x_range=(-0.5, max(1, len(labels)) - 0.5),
            name="boxes of runs",
        )
        self.plot.toolbar.active_drag = None
        self.plot.yaxis.axis_label = SCORES[score] + style.in_unit(self._unit)
        self.plot.xaxis.axis_label = across.of
        self.plot.xaxis.ticker = FixedTicker(ticks=list(range(len(labels))))
        self.plot.xaxis.major_label_overrides = {i: str(label) for i, label in enumerate(labels)}
        if sum(map(len, labels)) >= 90:
            looks.slant_labels(self.plot.xaxis)
        self.plot.xgrid.grid_line_color = None
        self._draw_groups()
        looks.legend_above(self.plot, self._draw(chosen), 3)
        for level, dashes in reference.items():
            self.plot.add_layout(Span(location=level, dimension="width", line_color=style.TRUTH, line_dash=dashes))
        self.marked = ColumnDataSource({"x": [], "y": []})
        self.plot.scatter(
            "x", "y", source=self.marked, marker="star", size=16, fill_color="#ffffff", line_color="#000000",
            line_width=1.8, level="overlay",
        )  # fmt: skip  # of its own level, so that thousands of points are not painted anew for it

    def _draw(self, chosen: dict[str, Look]) -> list[LegendItem]:
        """Draw all boxes and points; of one source each, since every glyph costs a reader time. Return the legend."""
        own = sorted(self._boxes, key=lambda b: self.estimators.index(b.estimator))
        styles = [chosen[self._names[b.estimator]] for b in own]
        low, middle, high = np.array([b.quartiles for b in own]).reshape(-1, 3).T
        ends = np.array([[b.values[0], b.values[-1]] for b in own]).reshape(-1, 2).T
        colours = [looks.line(s) for s in styles]
        x, wide = np.array([self.place(b.across, b.estimator) for b in own]), 0.85 * self.width
        source = ColumnDataSource({
            "x": x, "left": x - wide / 2, "right": x + wide / 2, "low": low, "middle": middle, "high": high,
            "least": ends[0], "most": ends[1], "runs": [len(b.values) for b in own], "lost": [b.lost for b in own],
            "line": colours, "tint": [looks.colour(s.tint) for s in styles], "hatch": [looks.hatch(s) for s in styles],
            "grain": [looks.grain(s) for s in styles],
            "name": [str(self._names[b.estimator]) for b in own],
        })  # fmt: skip
        self.plot.segment("x", "least", "x", "most", source=source, color="line")
        box = self.plot.vbar(
            "x", wide, "high", "low", source=source, fill_color="tint", line_color="line", fill_alpha=0.8,
            hatch_pattern="hatch", hatch_color="line", hatch_alpha=0.6, hatch_scale="grain",
        )  # fmt: skip
        most = max(8, POINTS // max(1, len(self._boxes)))
        spread = [self._points(b, most) for b in own]
        counts, nothing = [len(s["x"]) for s in spread], np.empty(0)
        points = ColumnDataSource({
            **{k: np.concatenate([nothing, *(s[k] for s in spread)]) for k in ("x", "y")},
            "line": [c for c, count in zip(colours, counts, strict=True) for _ in range(count)],
            "marker": [looks.marker(s) for s, count in zip(styles, counts, strict=True) for _ in range(count)],
        })  # fmt: skip
        drawn = self.plot.scatter("x", "y", source=points, marker="marker", size=5, color="line", alpha=0.55)
        share = CustomJS(args={"points": drawn.glyph, "wide": wide / max(1, len(self._labels))}, code=_NO_WIDER)
        self.plot.js_on_change("inner_width", share)
        self.plot.segment("left", "middle", "right", "middle", source=source, color=style.TRUTH, line_width=2)
        hovered = [("", "@name"), ("median", "@middle{0.000 a}"), ("quartiles", "@low{0.000 a} to @high{0.000 a}")]
        hovered += [("smallest, largest", "@least{0.000 a}, @most{0.000 a}"), ("runs, lost", "@runs, @lost")]
        self.plot.add_tools(looks.hover([box], *hovered), looks.hover([drawn], ("run", "@y{0.000 a}")))
        firsts = {b.estimator: i for i, b in reversed(list(enumerate(own)))}
        return [
            LegendItem(label={"value": str(self._names[e])}, renderers=[box], index=firsts[e])
            for e in self.estimators
            if e in firsts
        ]

    def _draw_groups(self) -> None:
        """Write below the labels what they belong to, and part one group from the next by a line."""
        starts = [i for i, group in enumerate(self._groups) if i == 0 or group != self._groups[i - 1]]
        if not starts:
            return
        ends = [*starts[1:], len(self._groups)]
        centres = [(start + end - 1) / 2 for start, end in zip(starts, ends, strict=True)]
        axis = LinearAxis(
            ticker=FixedTicker(ticks=centres), axis_line_color=None, major_tick_line_color=None,
            major_label_overrides={c: self._groups[start] for c, start in zip(centres, starts, strict=True)},
        )  # fmt: skip
        looks.write_axis(axis)
        axis.axis_label, self.plot.xaxis.axis_label = self.plot.xaxis.axis_label, ""
        self.plot.add_layout(axis, "below")
        for start in starts[1:]:
            edge = Span(location=start - 0.5, dimension="height", line_color="#9a9a9a", level="underlay")
            self.plot.add_layout(edge)

    def _points(self, box: Box, most: int) -> dict[str, np.ndarray]:
        rows = box.points(most)
        scatter = np.random.default_rng(box.across).uniform(-0.3, 0.3, len(rows)) * self.width
        return {"x": self.place(box.across, box.estimator) + scatter, "y": box.values[rows]}

    def place(self, across: int, estimator: int) -> float:
        """Return where the box of an estimator stands."""
        return across + (self.estimators.index(estimator) - (len(self.estimators) - 1) / 2) * self.width

    def hit(self, x: float, y: float) -> tuple[Box, int] | None:
        """Return the box below a click and the run whose score is nearest to it; ``None`` off all boxes."""
        near = [b for b in self._boxes if abs(self.place(b.across, b.estimator) - x) <= self.width / 2]
        if not near or (self._log and y <= 0):
            return None
        if self._log:
            return near[0], int(np.argmin(np.abs(np.log(near[0].values) - np.log(y))))
        return near[0], near[0].nearest(y)

    @property
    def boxes(self) -> list[Box]:
        """The boxes that hold a run."""
        return self._boxes

    @property
    def offered(self) -> list[tuple[str, str]]:
        """The boxes as a list to choose from: the index of each, and what it is with its median."""
        return [
            (str(i), f"{self._where(b.across)}, {self._names[b.estimator]}: "
             f"median {style.with_unit(b.quartiles[1], self._unit)}")
            for i, b in enumerate(self._boxes)
        ]  # fmt: skip

    def _where(self, across: int) -> str:
        label = str(self._labels[across])
        return f"{self._groups[across]}, {label}" if self._groups else label

    def mark(self, values: Mapping[tuple[int, int], float]) -> None:
        """Mark the scores of the run that is shown, by level or drive and estimator."""
        shown = {at: v for at, v in values.items() if at[1] in self.estimators and np.isfinite(v)}
        self.marked.data = {"x": [self.place(*at) for at in shown], "y": list(shown.values())}
