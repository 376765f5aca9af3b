"""Runs over time, as Bild 5.10 of Ziaukas 2023: truth, estimates and their 2-sigma bands."""

from __future__ import annotations

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from harness.common.series import thinned
from harness.models.quantities import Quantity, quantity
from harness.reporting import style
from harness.reporting.document import Block, Heading, Picture, Prose, Sheet, plain
from harness.reporting.style import Look, looks
from harness.study.report.analysis import Analysis
from harness.study.results import run_in_words

_EXPLAIN = (
    "A median hides how an error arises. Drawn are the true value, each estimate and its stated uncertainty; the study "
    "names the run."
)
_ROW = 1.65  # inches per quantity
_LOWEST = 1.1  # inches per quantity where that saves a page
_AS_PIXELS_FROM = 4000  # points from which vectors make the file large and slow
_POINTS = 900  # drawn per line: more than a printer resolves on the width of a page


def blocks(analysis: Analysis) -> list[Block]:
    """Return the time history and the errors of every run the study kept; nothing where it kept none."""
    runs = analysis.store.histories
    if not runs:
        return []
    heading = "What does a run look like over time?" if len(runs) == 1 else "What do runs look like over time?"
    return [Heading(heading), Prose(plain(_EXPLAIN)), *(block for data in runs for block in _run(analysis, data))]


def _run(analysis: Analysis, data: xr.Dataset) -> list[Block]:
    estimators = [str(e) for e in data["estimator"].values]
    chosen = {e: analysis.looks[e] for e in estimators if e in analysis.looks} or looks(estimators)
    chosen = {**looks(estimators), **chosen}
    targets = [quantity(str(t)) for t in data["target"].values]
    inputs = [
        quantity(str(name).removeprefix("input_"))
        for name in data.data_vars
        if str(name).startswith("input_") and str(name).removeprefix("input_") not in {t.name for t in targets}
    ]
    inputs = [q for q in inputs if not q.name.endswith("_rate") and q.name != "time"]
    content: list[Block] = []
    rows: list[Quantity] = [*targets, *inputs]
    per_page = int((style.TALLEST - 1.3) // _LOWEST)
    for some in np.array_split(np.arange(len(rows)), -(-len(rows) // per_page)):
        content.append(_picture(data, [rows[i] for i in some], chosen))
    content.append(_errors(data, targets, estimators))
    return content


def _picture(data: xr.Dataset, rows: list[Quantity], chosen: dict[str, Look]) -> Picture:
    with style.drawing():
        fig = style.figure(1.1 + min(_ROW, (style.TALLEST - 1.3) / len(rows)) * len(rows))
        panels = fig.subplots(len(rows), 1, sharex=True, squeeze=False)[:, 0]
        for axes, row in zip(panels, rows, strict=True):
            _panel(axes, data, row, chosen)
        panels[-1].set_xlabel("time in s")
        handles: list[Line2D | Patch] = []
        if any(_has_truth(data, row) for row in rows):
            handles.append(Line2D([], [], color=style.TRUTH, lw=1.4, label="true"))
        handles += [Line2D([], [], color=k.line, ls=k.dashes, lw=1.3, label=e) for e, k in chosen.items()]
        if bool(np.isfinite(data["std"]).any()):
            handles.append(Patch(color="#b0b0b0", label="± 2σ"))
        if any(f"measured_{row.name}" in data for row in rows):
            handles.append(Line2D([], [], color=style.MEASURED, marker=".", ls="", label="measured"))
        style.head(fig, f"Do the estimates follow the true values ({run_in_words(data)})?", handles)
        svg = style.svg(fig)
    names = ", ".join(row.words for row in rows)
    caption = (
        f"The run “{run_in_words(data)}”: true and estimated {names}. The band in the colour of an estimator is twice "
        "the standard deviation it states to either side; a true value outside it is an error larger than "
        "stated."
    )
    alone = [row.words for row in rows if not _has_truth(data, row)]
    if alone:
        caption += f" The plant has no {' and no '.join(alone)}: only the estimate is drawn."
    return Picture(svg, caption + _ended(data), f"Time history of {names}")


def _ended(data: xr.Dataset) -> str:
    """Say which estimates end before the drive does, and when."""
    finite = np.isfinite(data["estimate"].values)
    time = data["time"].values
    parts = []
    for k, name in enumerate(data["estimator"].values):
        samples = np.flatnonzero(finite[:, k].any(axis=1))
        if samples.size and samples[-1] < len(time) - 1:
            parts.append(f"{name} diverged after {time[samples[-1]]:.2f} s")
    return f" {'; '.join(parts)}: nothing is shown or counted from there on." if parts else ""


def _has_truth(data: xr.Dataset, row: Quantity) -> bool:
    """Whether the plant has the quantity: an input, or a signal whose truth was kept."""
    if row.name not in data["target"].values:
        return True
    return bool(np.isfinite(data["truth"].sel(target=row.name)).any())


def _panel(axes: Axes, data: xr.Dataset, row: Quantity, chosen: dict[str, Look]) -> None:
    time = data["time"].values
    targets = [str(t) for t in data["target"].values]
    axes.set_ylabel(f"${row.symbol}${style.in_unit(row.unit)}", parse_math=True)
    axes.set_title(row.words, loc="left")
    axes.grid(axis="y")
    axes.set_xlim(time[0], time[-1])
    if row.name not in targets:
        values = row.scale * data[f"input_{row.name}"].values
        axes.plot(*thin(time, values), color=style.TRUTH, lw=1.1)
        if np.ptp(values) < 1e-6 * max(1.0, float(np.abs(values).max())):
            axes.set_ylim(values[0] - 1.0, values[0] + 1.0)
        return
    own = data.sel(target=row.name)
    truth = row.scale * own["truth"].values
    shown = [truth]
    if f"measured_{row.name}" in data:
        measured = row.scale * data[f"measured_{row.name}"].values
        axes.plot(time, measured, ".", ms=2.5, color=style.MEASURED, zorder=1, rasterized=len(time) > _AS_PIXELS_FROM)
        shown.append(measured)
    axes.plot(*thin(time, truth), color=style.TRUTH, lw=1.4, zorder=3)
    for name, look in chosen.items():
        mine = own.sel(estimator=name)
        estimate = row.scale * mine["estimate"].values
        reach = 2.0 * row.scale * mine["std"].values
        style.mark(axes.plot(*thin(time, estimate), color=look.line, ls=look.dashes, lw=1.1, zorder=4), name)
        if np.isfinite(reach).any():
            times, lower, upper = envelope(time, estimate - reach, estimate + reach)
            band = axes.fill_between(times, lower, upper, color=look.line, alpha=0.18, lw=0, zorder=2)
            style.mark(band, name, f"{name}, ± 2σ")
        if np.isfinite(estimate[-1]):
            shown.append(estimate)  # one that diverges would flatten all others; it leaves the panel instead
    _limit(axes, shown)


def _limit(axes: Axes, shown: list[NDArray[np.float64]]) -> None:
    """Show all lines and as much of the bands as leaves the lines legible."""
    finite = np.concatenate([s[np.isfinite(s)] for s in shown])
    if finite.size == 0 or np.ptp(finite) == 0:
        return
    low, high = axes.get_ylim()
    room = 0.5 * float(np.ptp(finite))
    axes.set_ylim(max(low, float(finite.min()) - room), min(high, float(finite.max()) + room))


def thin(time: NDArray, values: NDArray) -> tuple[NDArray, NDArray]:
    """Return times and values of a line of at most ``2 * _POINTS`` samples that has every extreme."""
    rows = thinned([values], 0, len(values), 2 * _POINTS // 3)
    return time[rows], values[rows]


def envelope(time: NDArray, lower: NDArray, upper: NDArray) -> tuple[NDArray, NDArray, NDArray]:
    """Thin a band to the outermost values of each span."""
    step = -(-len(time) // _POINTS)
    starts = np.arange(0, len(time), step)
    return time[starts], np.fmin.reduceat(lower, starts), np.fmax.reduceat(upper, starts)


def inside(data: xr.Dataset, estimator: str) -> dict[str, float]:
    """Return the share of samples whose truth lies within ± 2σ of the estimate, by target that has both."""
    own = data.sel(estimator=estimator) if estimator in data["estimator"].values else None
    if own is None:
        return {}
    error, reach = np.abs((own["estimate"] - own["truth"]).values), 2.0 * own["std"].values
    finite = np.isfinite(error) & np.isfinite(reach)
    return {
        str(name): float(np.mean(error[finite[:, k], k] <= reach[finite[:, k], k]))
        for k, name in enumerate(data["target"].values)
        if finite[:, k].any()
    }


def _errors(data: xr.Dataset, targets: list[Quantity], estimators: list[str]) -> Sheet:
    rows = []
    shares = {name: inside(data, name) for name in estimators}
    for target in (t for t in targets if _has_truth(data, t)):
        own = data.sel(target=target.name)
        for number, name in enumerate(estimators):
            error = target.scale * (own["estimate"].sel(estimator=name) - own["truth"]).values
            share = shares[name].get(target.name)
            finite = error[np.isfinite(error)]
            rms = float(np.sqrt(np.mean(finite**2))) if finite.size else np.nan
            largest = float(np.abs(finite).max()) if finite.size else np.nan
            unit = f" ({target.unit})" if target.unit else ""
            rows.append(
                [
                    "" if number else target.words + unit,
                    name,
                    style.number(rms),
                    style.number(largest),
                    "–" if share is None else f"{100 * share:.0f} %",
                ]
            )
    header = ["target", "estimator", "RMSE", "largest error", "inside ± 2σ"]
    return Sheet(header, rows, f"Errors of the run “{run_in_words(data)}”.{_ended(data)}", left=2)
