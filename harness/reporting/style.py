"""Colours, hatches, markers, fonts and number formats of all reports."""

from __future__ import annotations

import html
import io
import json
import math
import re
import textwrap
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass
from typing import Any
from urllib.parse import quote, unquote
from weakref import WeakKeyDictionary

import matplotlib as mpl
import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG, RendererSVG
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

WIDTH = 6.89  # inches: A4 less two margins of 17.5 mm, so that a point in a figure is a point in print
TALLEST = 9.3  # inches: the most a figure may take of a page
HALF = 4.3  # inches: of a figure that shares a page with another one and both captions
_PAD = 0.04  # inches around a panel with its labels
_NAME = 92  # characters of a line of a legend that fit the width of the page
_used: WeakKeyDictionary[Figure, float] = WeakKeyDictionary()  # inches that ``head`` took of a figure
_MARK = "mark:"  # how the id of an artist begins that ``mark`` said something of
_MARKED = re.compile(rf'<g id="{_MARK}([^"]*)">')
_AXIS = "axis:"  # how the id of an axis begins whose scale a reader on screen may change
TRUTH = "#000000"
MEASURED = "#9a9a9a"
SHADE = "#e9e9e9"

RC: dict[str, Any] = {
    "font.family": "DejaVu Sans",  # comes with matplotlib, so it is the same everywhere
    "font.size": 9,
    "axes.titlesize": 9.5,
    "axes.labelsize": 9,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "legend.fontsize": 9,
    "figure.titlesize": 10.5,
    "figure.titleweight": "bold",
    "axes.linewidth": 0.6,
    "xtick.major.width": 0.6,
    "ytick.major.width": 0.6,
    "lines.linewidth": 0.9,
    "patch.linewidth": 0.6,
    "hatch.linewidth": 0.5,
    "grid.linewidth": 0.4,
    "grid.color": "#d8d8d8",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "legend.frameon": False,
    "text.parse_math": False,  # a dollar sign in the name of a recording is no formula
    "svg.fonttype": "path",  # the HTML must look the same where DejaVu is not installed
    "svg.hashsalt": "robustness-harness",
    "path.simplify_threshold": 0.2,
}


@dataclass(frozen=True)
class Look:
    """Colour, hatch, marker and line of an estimator in all figures."""

    colour: str
    hatch: str
    marker: str
    dashes: str | tuple[int, tuple[float, ...]]
    variant: bool = False

    @property
    def face(self) -> str | tuple[float, float, float]:
        """The colour that fills a marker: white for one whose colour and marker another look has too."""
        return "white" if self.variant else self.tint

    @property
    def tint(self) -> tuple[float, float, float]:
        """The colour at two fifths of its strength, for areas."""
        red, green, blue = (1 - 0.40 * (1 - c) for c in mpl.colors.to_rgb(self.colour))
        return red, green, blue

    @property
    def line(self) -> tuple[float, float, float]:
        """The colour for lines and edges, darkened where it would be too light on white."""
        red, green, blue = mpl.colors.to_rgb(self.colour)
        light = 0.2126 * red + 0.7152 * green + 0.0722 * blue > 0.7
        factor = 0.7 if light else 1.0
        return factor * red, factor * green, factor * blue


# Okabe & Ito (2008), without the black that the truth is drawn in. Yellow is last: it is weak on white.
_LOOKS = (
    Look("#0072B2", "", "o", "-"),
    Look("#D55E00", "////", "s", (0, (5, 1.5))),
    Look("#009E73", "....", "^", (0, (1.2, 1))),
    Look("#CC79A7", "\\\\\\\\", "D", (0, (6, 1.5, 1, 1.5))),
    Look("#56B4E9", "----", "v", (0, (3, 1, 1, 1, 1, 1))),
    Look("#E69F00", "xxxx", "P", (0, (8, 2))),
    Look("#F0E442", "||||", "X", (0, (2, 2))),
)
_MORE_HATCHES = ("++", "oo", "**", "//", "..", "\\\\", "--")
# Estimators that most studies share keep one look across all reports. A name that is not here takes the first
# look that is free, in the order of the study, so a new estimator needs no entry. A variant of a usual one, named so
# behind a comma ("EKF, tuned"), has its colour and marker with another hatch.
_USUAL = {"EKF": 0, "UKF": 1, "CDKF": 2, "STCDKF": 3, "PF": 4, "NARX": 5, "KF": 6}


def looks(estimators: Sequence[str]) -> dict[str, Look]:
    """Return the look of each estimator; no two are alike, however many there are."""
    slots: dict[str, int] = {}
    for name in estimators:
        usual, comma, _ = name.partition(",")
        slot = _USUAL.get("".join(c for c in usual.upper() if c.isalnum()))
        if slot is not None and comma:
            slot += len(_LOOKS)
        if slot is not None and slot not in slots.values():
            slots[name] = slot
    free = (k for k in range(2 * len(_LOOKS) + len(estimators)) if k not in slots.values())
    for name in estimators:
        if name not in slots:
            slots[name] = next(free)
    return {name: _look(slot) for name, slot in slots.items()}


def _look(slot: int) -> Look:
    base = _LOOKS[slot % len(_LOOKS)]
    turn = slot // len(_LOOKS)
    if turn == 0:
        return base
    return Look(base.colour, _MORE_HATCHES[slot % len(_MORE_HATCHES)] * turn, base.marker, (0, (1.0 + turn, 1.0)), True)


_MOST_DIGITS = 6


def number(value: float, digits: int = 3) -> str:
    """Write a number with three significant digits and no exponent where it can be read without one."""
    if not math.isfinite(value):
        return "–" if math.isnan(value) else "∞" if value > 0 else "−∞"
    if value == 0:
        return "0"
    magnitude = abs(value)
    if magnitude >= 1e6 or magnitude < 1e-4:
        mantissa, exponent = f"{value:.{digits - 1}e}".split("e")
        raised = str(int(exponent)).translate(str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹"))
        return f"{mantissa.replace('-', '−')}·10{raised}"
    rounded = float(f"{value:.{digits - 1}e}")
    decimals = max(0, digits - 1 - math.floor(math.log10(abs(rounded))))
    return f"{rounded:.{decimals}f}".replace("-", "−")


def uncertain(value: float, std: float) -> str:
    """Write a number with its standard error, both to the second digit of that; without one where there is none."""
    if not 0 < std < math.inf or not math.isfinite(value):
        return number(value)
    place = math.floor(math.log10(std)) - 1
    rounded = round(value, -place)
    digits = math.floor(math.log10(abs(rounded))) - place + 1 if rounded else 1
    return f"{number(rounded, min(max(digits, 1), _MOST_DIGITS))} ± {number(std, 2)}"


def with_unit(value: float, unit: str) -> str:
    """Write a number with its unit; degrees and no unit stand without a space."""
    return f"{number(value)}{'' if unit in ('°', '') else ' '}{unit}"


def span(lower: float, upper: float, unit: str = "") -> str:
    """Write an interval, e.g. ``1.20 to 1.35 kN``."""
    return f"{number(lower)} to {with_unit(upper, unit)}"


def percent(share: float) -> str:
    """Write a share in percent with two significant digits, e.g. ``0.051 %``."""
    return f"{number(100 * share, 2)} %"


def probability(p: float) -> str:
    """Write a p-value; below one in a thousand only that."""
    if not math.isfinite(p):
        return "–"
    return "< 0.001" if p < 0.001 else f"{p:.3f}"


def in_unit(unit: str) -> str:
    """Return ``" in kN"`` for an axis label, nothing for a plain number."""
    return f" in {unit}" if unit else ""


def drawing(settings: Mapping[str, Any] = RC) -> AbstractContextManager[None]:
    """Return the context in which figures are made: matplotlib's defaults with some settings.

    Those of a ``matplotlibrc`` do not count: the working directory may hold somebody's, which can have LaTeX started.
    """
    mended: Any = {
        key: value for key, value in mpl.rcParamsDefault.items() if key != "backend" and mpl.rcParams[key] != value
    }
    return mpl.rc_context(mended | dict(settings))


def figure(height: float, **layout: Any) -> Figure:
    """Return a figure of the width of the page; call inside ``drawing()``."""
    fig = Figure(figsize=(WIDTH, height), dpi=72, **layout)  # of SVG: text is measured as it is drawn
    FigureCanvasSVG(fig)
    # Near to what most figures end with, so that the ticks chosen while measuring are those that are drawn.
    fig.subplots_adjust(left=0.11, right=0.99, bottom=0.6 / height, top=1.0 - 0.7 / height, hspace=0.2)
    return fig


def mark(artists: Artist | Iterable[Artist], series: str, text: str = "") -> None:
    """Attach series and text to an artist, so that a reader on screen can switch it off and read its numbers.

    Args:
        artists: One or several.
        series: Name that is switched, an estimator's; nothing for what is always shown.
        text: Shown when a pointer rests on it; the series by default.
    """
    for artist in [artists] if isinstance(artists, Artist) else artists:
        artist.set_gid(_MARK + quote(json.dumps([series, text or series])))  # quoted: however XML quotes an id


@contextmanager
def series(axes: Axes, name: str) -> Iterator[None]:
    """Mark everything that is drawn into a panel meanwhile as of a series, where nothing else is said of it."""
    before = set(axes.get_children())
    yield
    mark([a for a in axes.get_children() if a not in before and a.get_gid() is None], name)


def svg(fig: Figure) -> bytes:
    """Return the figure as SVG that depends on its content only (no date, fixed ids)."""
    _lay_out(fig)
    _lay_out(fig)  # the ticks, and with them the room for their labels, depend on the height of a panel
    for axes in fig.axes:
        if axes.yaxis.get_gid() == _AXIS:
            ends = [*axes.get_ylim(), *(fig.bbox.height - axes.bbox.intervaly)]
            axes.yaxis.set_gid(_AXIS + " ".join([axes.get_yscale(), *(f"{end:.6g}" for end in ends)]))
    stream = io.BytesIO()
    fig.savefig(stream, format="svg", metadata={"Date": None, "Creator": None}, dpi=200)
    text = _MARKED.sub(_titled, stream.getvalue().decode("utf-8"))
    return text.replace(f'<g id="{_AXIS}', '<g data-axis="').encode()


def _titled(match: re.Match[str]) -> str:
    """Return the group of an artist with what ``mark`` said of it, in the words of SVG."""
    series, text = json.loads(unquote(match[1]))
    named = f' data-series="{html.escape(series)}"' if series else ""
    return f"<g{named}><title>{html.escape(text)}</title>"


def _lay_out(fig: Figure) -> None:
    """Give the panels all the room that their labels leave: rows equal shares, columns those of their grid.

    Matplotlib's constrained layout does the same for any arrangement, but measures every artist twice, which takes
    as long as drawing. Here only axes, labels and titles are measured, once.
    """
    width, height = fig.get_size_inches() * fig.dpi
    renderer = RendererSVG(width, height, io.StringIO(), image_dpi=int(fig.dpi))
    first = fig.axes[0].get_subplotspec()
    assert first is not None  # every panel is of subplots
    grid, places = first.get_gridspec(), []
    margin_left, margin_right = np.zeros(grid.ncols), np.zeros(grid.ncols)
    above, below = np.zeros(grid.nrows), np.zeros(grid.nrows)
    for axes in fig.axes:
        _fold_title(axes, renderer)
        box, outer = axes.get_window_extent(renderer), axes.get_tightbbox(renderer, bbox_extra_artists=[])
        at = axes.get_subplotspec()
        assert outer is not None
        assert at is not None
        row, column = at.rowspan.start, at.colspan.start
        places.append((axes, row, column))
        margin_left[column] = max(margin_left[column], box.x0 - outer.x0)
        margin_right[column] = max(margin_right[column], outer.x1 - box.x1)
        above[row], below[row] = max(above[row], outer.y1 - box.y1), max(below[row], box.y0 - outer.y0)
    pad = _PAD * fig.dpi
    top = _used.get(fig, 0.0) * fig.dpi
    margin_left, margin_right, above, below = margin_left + pad, margin_right + pad, above + pad, below + pad
    tall = max((height - top - above.sum() - below.sum()) / grid.nrows, 0.2 * fig.dpi)
    ratios = np.array(grid.get_width_ratios())
    wide = (width - margin_left.sum() - margin_right.sum()) * ratios / ratios.sum()
    x = np.cumsum(margin_left + wide + margin_right) - margin_right - wide
    y = height - top - np.cumsum(above + tall + below) + below
    for axes, row, column in places:
        axes.set_position((x[column] / width, y[row] / height, wide[column] / width, tall / height))


def _fold_title(axes: Axes, renderer: RendererSVG) -> None:
    """Break a title that is wider than its panel: it would be cut off, and take the width of all panels."""
    text = axes.get_title(loc="left").replace("\n", " ")
    wide = axes.set_title(text, loc="left").get_window_extent(renderer).width
    room = axes.get_window_extent(renderer).width
    if wide > room:
        axes.set_title(textwrap.fill(text, max(1, int(0.95 * len(text) * room / wide))), loc="left")


def rescalable(axes: Axes) -> None:
    """Let a reader on screen change the scale of the y-axis of a panel in which all that is drawn over it is marked."""
    axes.yaxis.set_gid(_AXIS)
    axes.yaxis.labelpad = 10  # the numbers of the other scale may be longer


def at_edge(axes: Axes, place: float, text: str, look: Look, top: bool = True) -> Artist:
    """Write what is infinite, or nothing, at the end of a y-axis."""
    where = axes.get_xaxis_transform()
    side: Any = {"ha": "center", "va": "top" if top else "bottom", "rotation": 90, "size": 7, "color": look.line}
    return axes.text(place, 0.97 if top else 0.03, text, transform=where, **side)


def logarithmic(axes: Axes, low: float, high: float) -> None:
    """Use a logarithmic axis with plain numbers, at 1, 2, 5 or at decades where it spans many."""
    axes.set_yscale("log")
    subs = (1.0, 2.0, 5.0) if high / low < 300 else (1.0,)
    axes.yaxis.set_major_locator(mpl.ticker.LogLocator(subs=subs))
    axes.yaxis.set_minor_locator(mpl.ticker.NullLocator())
    axes.yaxis.set_major_formatter(mpl.ticker.FuncFormatter(lambda value, _: number(value, 1)))
    axes.set_ylim(0.75 * low, 1.35 * high)


def patches(estimators: Sequence[str], chosen: dict[str, Look]) -> list[Patch]:
    """Return the legend of boxes, one patch per estimator."""
    return [
        Patch(facecolor=chosen[e].tint, edgecolor=chosen[e].line, hatch=chosen[e].hatch, label=e) for e in estimators
    ]


def markers(estimators: Sequence[str], chosen: dict[str, Look]) -> list[Line2D]:
    """Return the legend of points, one marker per estimator."""
    return [
        Line2D([], [], ls="", marker=chosen[e].marker, color=chosen[e].face, mec=chosen[e].line, label=e)
        for e in estimators
    ]


def mark_matched(axes: Axes, position: int | None) -> None:
    """Shade the level at which plant and belief agree; levels are places, not numbers, hence without ticks."""
    axes.tick_params(axis="x", length=0)
    if position is not None:
        axes.axvspan(position - 0.5, position + 0.5, color=SHADE, lw=0, zorder=0)


def head(fig: Figure, text: str, handles: Sequence[Any] = ()) -> None:
    """Write the question over a figure and the legend below it, and leave the rest to the panels.

    Args:
        fig: Figure from ``figure``.
        text: The question; broken where it would be cut off.
        handles: What the legend explains, in as many rows as the names need; a name that is too long is broken.
    """
    lines = textwrap.wrap(text, 80)
    height = fig.get_figheight()
    used = 0.19 * len(lines) + 0.04
    fig.text(0.008, 1.0 - 0.04 / height, "\n".join(lines), ha="left", va="top", weight="bold", size=10.5)
    if handles:
        names = [textwrap.fill(str(h.get_label()), _NAME) for h in handles]
        longest = max(len(line) for name in names for line in name.split("\n"))
        columns = max(1, min(len(handles), 88 // (longest + 8)))
        fig.legend(
            handles=handles,
            labels=names,
            loc="upper left",
            bbox_to_anchor=(0.0, 1.0 - used / height),
            ncols=columns,
            handlelength=2.4,
            columnspacing=1.4,
            borderaxespad=0.1,
        )
        rows = -(-len(handles) // columns)  # a name of several lines has its columns for itself
        used += 0.2 * rows + 0.15 * sum(name.count("\n") for name in names) + 0.06
    _used[fig] = used
