"""Figures of ``harness check``: the signals over time, both sides of each comparison, the curves of the axles."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from harness.common.arrays import Floats
from harness.models.quantities import print_unit, quantity, words
from harness.models.signals import TRUTH
from harness.recordings.consistency import DISAGREES, in_report_unit
from harness.recordings.pair_fit import Agreement
from harness.reporting import style
from harness.reporting.document import Picture

if TYPE_CHECKING:
    from collections.abc import Sequence

    from harness.recordings.axle_curves import Axle


_PER_FIGURE = 6
_TALLEST = 4.7
"""Inches of the panels on the first page, below the findings."""
_POINTS = 1500
_EXCERPT = 30.0
"""s of a comparison that are shown: those with most going on."""
_MEASURED, _COMPUTED = "#0072B2", "#D55E00"
_DOTS = 3000


def signals(recording: xr.Dataset) -> list[Picture]:
    """Draw every signal over time, gaps shaded; six panels to a figure."""
    names = [str(n) for n in recording.data_vars]
    chunks = [names[k : k + _PER_FIGURE] for k in range(0, len(names), _PER_FIGURE)]
    return [_signals(recording, chunk, n + 1, len(chunks)) for n, chunk in enumerate(chunks)]


def _signals(recording: xr.Dataset, names: Sequence[str], which: int, of: int) -> Picture:
    time = recording["time"].values
    part = f" ({which} of {of})" if of > 1 else ""
    with style.drawing():
        fig = style.figure(0.9 + 1.1 * len(names))
        panels = fig.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        gaps = False
        for axes, name in zip(panels, names, strict=True):
            shown = quantity(name.removeprefix(TRUTH))
            values = recording[name].values * shown.scale
            axes.plot(*_envelope(time, values), color=_MEASURED, lw=0.7)
            gaps |= _shade_gaps(axes, time, values)
            axes.set_ylabel(shown.unit or "–")
            axes.set_title(words(name), loc="left")
            axes.grid(axis="y")
            axes.margins(x=0)
        panels[-1].set_xlabel("time in s")
        handles = [Patch(facecolor=style.SHADE, label="no samples")] if gaps else []
        style.head(fig, f"What was recorded?{part}", handles)
        image = style.svg(fig)
    return Picture(image, f"Signals of the recording{part}, each on the common time base.", f"Signals over time{part}")


def _shade_gaps(axes: Axes, time: Floats, values: Floats) -> bool:
    """Shade where samples are missing; return whether any are."""
    missing = np.concatenate([[False], ~np.isfinite(values), [False]])
    edges = np.flatnonzero(np.diff(missing.astype(int)))
    for a, b in edges.reshape(-1, 2):
        axes.axvspan(time[a], time[min(b, len(time) - 1)], color=style.SHADE, lw=0, zorder=0)
    return edges.size > 0


def _envelope(time: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return a line of few points that looks as the full one: smallest and largest value of each short stretch."""
    width = len(values) // (_POINTS // 2)
    if width < 2:
        return time, values
    count = len(values) // width * width
    blocks = values[:count].reshape(-1, width)
    known = np.isfinite(blocks).any(axis=1)
    low, high = (np.full(len(blocks), np.nan) for _ in range(2))
    low[known], high[known] = np.nanmin(blocks[known], axis=1), np.nanmax(blocks[known], axis=1)
    pairs = np.stack([low, high], axis=1)
    return np.repeat(time[:count:width], 2), pairs.ravel()


def agreement(fits: Sequence[Agreement]) -> list[Picture]:
    """Draw both sides of each exact comparison over its half minute of largest variance, those that disagree first."""
    exact = sorted((fit for fit in fits if fit.relation.exact), key=lambda fit: fit.verdict != DISAGREES)
    chunks = [exact[k : k + _PER_FIGURE] for k in range(0, len(exact), _PER_FIGURE)]
    return [_agreement(chunk) for chunk in chunks]


def _agreement(fits: Sequence[Agreement]) -> Picture:
    with style.drawing():
        fig = style.figure(0.9 + min(1.05 * len(fits), _TALLEST))
        panels = fig.subplots(len(fits), 1, squeeze=False)[:, 0]
        for axes, fit in zip(panels, fits, strict=True):
            scale, unit = in_report_unit(fit, 1.0)
            rows, step = _liveliest(fit), fit.step
            time = np.arange(len(fit.measured))[rows] * step
            axes.plot(time, fit.computed[rows] * scale, color=_COMPUTED, lw=1.6, alpha=0.9)
            axes.plot(time, fit.measured[rows] * scale, color=_MEASURED, lw=0.8)
            axes.set_ylabel(print_unit(unit))
            said = ", ".join(fit.reasons) if fit.verdict == DISAGREES else f"R² {fit.explained:.3f}"
            axes.set_title(f"{words(fit.relation.signal)} and {fit.relation.formula}: {said}", loc="left")
            axes.grid(axis="y")
            axes.margins(x=0)
        panels[-1].set_xlabel("time in s")
        handles = [
            Line2D([], [], color=_MEASURED, lw=0.8, label="measured"),
            Line2D([], [], color=_COMPUTED, lw=1.6, label="computed from the other signals"),
        ]
        style.head(fig, "Do the signals agree with each other?", handles)
        image = style.svg(fig)
    caption = "Both sides of each comparison, smoothed alike, over the 30 s in which the computed one varies most."
    return Picture(image, caption, "Measured and computed signals over time")


def _liveliest(fit: Agreement) -> slice:
    """Return the stretch in which the computed side varies most."""
    length = min(int(_EXCERPT / fit.step), len(fit.computed))
    starts = range(0, len(fit.computed) - length + 1, max(length // 4, 1))
    variation = [np.nansum(np.abs(np.diff(fit.computed[a : a + length]))) for a in starts]
    first = list(starts)[int(np.argmax(variation))]
    return slice(first, first + length)


def axles(curves: Sequence[Axle], line: str = "slope up to 0.4", title: str = "How stiff are the axles?") -> Picture:
    """Draw lateral force over load against slip angle for each axle, and a line through its beginning (3.16)."""
    with style.drawing():
        fig = style.figure(0.9 + 2.9 * len(curves))
        panels = fig.subplots(len(curves), 1, squeeze=False)[:, 0]
        for axes, axle in zip(panels, curves, strict=True):
            rows = np.flatnonzero(np.isfinite(axle.slip) & np.isfinite(axle.share))
            few = rows[:: max(len(rows) // _DOTS, 1)]
            axes.plot(np.degrees(axle.slip[few]), axle.share[few], ".", ms=2, color=_MEASURED, alpha=0.4, mew=0)
            if axle.slope is not None and len(few):
                reach = np.nanmax(np.abs(axle.share[few]))
                ends = min(0.4, reach) * np.array([-1.0, 1.0])
                axes.plot(np.degrees(ends / axle.slope.value + axle.slope.offset), ends, color=_COMPUTED, lw=1.6)
            axes.set_ylabel("lateral force over load")
            axes.set_xlabel("slip angle in °")
            axes.set_title(f"{axle.name} axle", loc="left")
            axes.grid()
        handles = [
            Line2D([], [], ls="", marker=".", color=_MEASURED, label="from the measured motion"),
            Line2D([], [], color=_COMPUTED, lw=1.6, label=line),
        ]
        style.head(fig, title, handles)
        image = style.svg(fig)
    caption = (
        "Axle forces from the balance of forces and moments, slip angles from the velocities (Sun 2015, figure 3.16)."
    )
    return Picture(image, caption, "Lateral force over load against slip angle, one panel per axle")
