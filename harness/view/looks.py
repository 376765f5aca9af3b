"""The look of the figures of a page: that of the reports."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence
from typing import Any

import numpy as np
from bokeh.models import (
    ColorBar,
    ColumnDataSource,
    CustomJS,
    CustomJSTicker,
    CustomJSTickFormatter,
    CustomLabelingPolicy,
    HoverTool,
    Legend,
    LogScale,
    NoOverlap,
)
from bokeh.plotting import figure

from harness.common.arrays import Floats
from harness.reporting.style import Look

FONT = "DejaVu Sans, Verdana, sans-serif"
WRAPPED = """
:host { max-width: 100%; box-sizing: border-box; }
.bk-btn-group { flex-wrap: wrap; }
.bk-btn { white-space: normal; overflow-wrap: anywhere; }
"""
"""Style of widgets that are no wider than a phone."""
NAME = 0.5
"""Share of a row that its name takes where names stand inside a figure."""

_TITLE = 34  # characters of a title that fit on a phone
_FOLD = """
const pen = document.createElement('canvas').getContext('2d'), lines = [''];
pen.font = `bold ${title.text_font_size} ${title.text_font}`;
for (const word of title.text.split(/\\s+/)) {
    const longer = `${lines.at(-1)} ${word}`.trim();
    if (longer === word || pen.measureText(longer).width < cb_obj.inner_width) lines[lines.length - 1] = longer;
    else lines.push(word);
}
if (lines.join('\\n') !== title.text) {
    title.setv({text: lines.join('\\n')}, {sync: false});
    setTimeout(() => Bokeh.index.find_one(cb_obj)?.compute_layout());  // the one that is under way ends first
}
"""
"""Breaks a title where its figure ends, whatever its width becomes; a matter of the browser alone."""

_LOG_TICKS = """
const {start, end} = cb_data, low = Math.min(start, end), high = Math.max(start, end);
const first = Math.floor(Math.log10(low)), last = Math.ceil(Math.log10(high));
const every = Math.max(1, Math.ceil((last - first) / 8)), parts = high / low > 1000 ? [1] : [1, 2, 5];
let found = [];
for (let k = first; k <= last; k += every) for (const part of parts) found.push(part * 10 ** k);
found = found.filter((tick) => tick >= low && tick <= high);
if (found.length > 1) return found;
const step = 10 ** Math.floor(Math.log10((high - low) / 2));
return Array.from({length: 20}, (_, k) => (Math.ceil(low / step) + k) * step).filter((tick) => tick <= high);
"""
"""Ticks at 1, 2 and 5, or at decades where the axis spans many, as in the reports; equal steps where it spans few."""

_PLAIN = """
const size = Math.abs(tick), power = Math.floor(Math.log10(size) + 1e-9);
const raised = [...String(power)].map((c) => c === '-' ? '⁻' : '⁰¹²³⁴⁵⁶⁷⁸⁹'[Number(c)]).join('');
const part = Number((tick / 10 ** power).toPrecision(3));
if (size === 0 || (size >= 9e-5 && size < 1e6)) return String(Number(tick.toPrecision(6))).replace('-', '−');
return part === 1 ? `10${raised}` : `${String(part).replace('-', '−')}·10${raised}`;
"""
"""A tick as a number that one reads, as in the reports, not as 5.000e+4."""
_SLANTED = """
let last = -Infinity;
for (const i of indices) {
    if (bboxes[i].right - last < 20) continue;
    last = bboxes[i].right;
    yield i;
}
"""
"""Labels that end, at their ticks, a line of text apart or more; that their frames overlap does not matter."""
_LABELS = 84
"""Least pixels left of a frame of equal scales: how wide its labels are is known when it is painted, and the canvas
keeps a strip of a label that was painted over its edge."""
HATCHES = {"/": "right_diagonal_line", "\\": "left_diagonal_line", ".": "dot", "-": "horizontal_line",
           "|": "vertical_line", "+": "cross", "x": "diagonal_cross", "o": "ring", "*": "criss_cross"}  # fmt: skip


CONTRAST = 3.0
"""Of lines and marks against white, at the least (WCAG 2.2, 1.4.11)."""

MARKERS = {"o": "circle", "s": "square", "^": "triangle", "D": "diamond", "v": "inverted_triangle"}


def plot(title: str, height: int, tools: str = "xpan,xwheel_zoom,xbox_zoom,reset", **further: Any) -> Any:
    """Return an empty figure as wide as the page."""
    plot_ = figure(
        title=textwrap.fill(title, _TITLE),
        height=height,
        sizing_mode="stretch_width",
        tools=tools,
        toolbar_location="right",
        **further,
    )
    plot_.toolbar.logo = None
    plot_.toolbar.autohide = True
    plot_.output_backend = "canvas"
    for axis in plot_.axis:
        write_axis(axis)
    plot_.title.text_font, plot_.title.text_font_size = FONT, "13px"
    plot_.title.text_color = "#111111"
    if len(title) > _TITLE:
        plot_.js_on_change("inner_width", CustomJS(args={"title": plot_.title}, code=_FOLD))
    for axis, scale in ((plot_.xaxis, plot_.x_scale), (plot_.yaxis, plot_.y_scale)):
        if isinstance(scale, LogScale):
            axis.ticker, axis.formatter = CustomJSTicker(major_code=_LOG_TICKS, minor_code="return [];"), plain_ticks()
    plot_.grid.grid_line_color = "#e4e4e4"
    plot_.outline_line_color = None
    if further.get("match_aspect"):
        plot_.min_border_left = _LABELS
    return plot_


def write_axis(axis: Any) -> None:
    """Let an axis have the letters of all figures."""
    axis.axis_label_text_font = axis.major_label_text_font = FONT
    axis.axis_label_text_font_style = "normal"
    axis.axis_label_text_font_size = axis.major_label_text_font_size = "13px"
    axis.minor_tick_line_color = None
    axis.major_label_policy = NoOverlap()
    axis.axis_label_text_color = axis.major_label_text_color = "#111111"


def slant_labels(axis: Any) -> None:
    """Let the labels below an axis rise to their ticks, so that more of them have room than side by side."""
    axis.major_label_orientation = 0.6
    axis.major_label_policy = CustomLabelingPolicy(code=_SLANTED)


def names_inside(plot: Any, names: Sequence[str], edge: float) -> None:
    """Write names above the rows of a figure, the first on top: next to them they would take a phone's width.

    Args:
        plot: With rows at 0, 1, … from below.
        names: Of the rows.
        edge: End of its x-axis.
    """
    source = ColumnDataSource(
        {"x": [edge] * len(names), "y": np.arange(len(names))[::-1] + 0.5 - NAME, "name": list(names)}
    )
    plot.text("x", "y", "name", source=source, text_baseline="bottom", text_font={"value": FONT}, text_font_size="13px",
              text_color="#111111", x_offset=4, y_offset=-1, background_fill_color="#ffffff", padding=2,
              level="overlay")  # fmt: skip
    plot.yaxis.visible = False
    plot.ygrid.grid_line_color = None


def plain_ticks() -> CustomJSTickFormatter:
    """Return what writes the ticks of an axis as the reports write numbers."""
    return CustomJSTickFormatter(code=_PLAIN)


def legend_above(plot: Any, items: Sequence[Any] | None = None, columns: int = 2) -> None:
    """Put the legend of a figure above it, so that it covers no line and, in few columns, is no wider than a phone.

    Args:
        plot: The figure.
        items: Of the legend; by default those of ``legend_label``.
        columns: How many stand side by side.
    """
    legend = plot.legend[0] if items is None else Legend(items=list(items))
    legend.orientation, legend.ncols, legend.border_line_color = "horizontal", columns, None
    legend.padding, legend.margin, legend.spacing, legend.label_standoff = 2, 0, 10, 4
    legend.label_height = legend.glyph_height = 16
    legend.label_text_font, legend.label_text_font_size, legend.label_text_color = FONT, "13px", "#111111"
    plot.add_layout(legend, "above")


def colour_bar(plot: Any, mapper: Any, title: str, **further: Any) -> ColorBar:
    """Put what the colours of a figure mean to its right, and return it."""
    bar = ColorBar(
        color_mapper=mapper, title=title, width=14, title_text_font=FONT, title_text_font_style="normal",
        title_text_font_size="13px", title_text_color="#111111", major_label_text_font=FONT,
        major_label_text_font_size="13px", major_label_text_color="#111111", **further,
    )  # fmt: skip
    plot.add_layout(bar, "right")
    return bar


def dash(look: Look) -> str | list[int]:
    """Return the dashes of an estimator's line."""
    if isinstance(look.dashes, str):
        return "solid"
    return [max(1, round(2 * part)) for part in look.dashes[1]]


def hatch(look: Look) -> str:
    """Return the hatch of an estimator's boxes."""
    return HATCHES.get(look.hatch[:1], "blank")


def grain(look: Look) -> float:
    """Return how coarse the hatch is: few characters stand for a sparse one, as in the reports."""
    return 28.0 / max(1, len(look.hatch))


def marker(look: Look) -> str:
    """Return the marker of an estimator's points."""
    return MARKERS.get(look.marker, "plus")


def colour(rgb: tuple[float, float, float]) -> str:
    """Return a colour as a browser takes it."""
    return "#" + "".join(f"{round(255 * part):02x}" for part in rgb)


def line(look: Look) -> str:
    """Return the colour of an estimator's lines: that of the reports, darkened until it stands out from white."""
    rgb = np.array(look.line)
    while 1.05 / (_luminance(rgb) + 0.05) < CONTRAST:
        rgb = 0.97 * rgb
    return colour((float(rgb[0]), float(rgb[1]), float(rgb[2])))


def _luminance(rgb: Floats) -> float:
    """Return the relative luminance of a colour (WCAG 2.2)."""
    linear = np.where(rgb <= 0.04045, rgb / 12.92, ((rgb + 0.055) / 1.055) ** 2.4)
    return float(linear @ [0.2126, 0.7152, 0.0722])


def hover(renderers: list[Any], *rows: tuple[str, str]) -> HoverTool:
    """Return a tool that shows numbers; names are shown as text, never as code."""
    return HoverTool(renderers=renderers, tooltips=list(rows), visible=False)


def _diverging() -> list[str]:
    """Return colours from blue by white to orange, which colour-blind readers tell apart (Okabe and Ito 2008)."""
    ends = (0x4C, 0x9B, 0xCB), (0xFF, 0xFF, 0xFF), (0xE6, 0x8A, 0x3C)
    colours = []
    for k in range(256):
        share = k / 127.5
        first, last = (ends[0], ends[1]) if share <= 1 else (ends[1], ends[2])
        part = share if share <= 1 else share - 1
        colours.append("#" + "".join(f"{round(a + part * (b - a)):02x}" for a, b in zip(first, last, strict=True)))
    return colours


DIVERGING = _diverging()
"""Colours of what has a sign."""
