"""Figures of a fit, as SVG in the look of all reports."""

from __future__ import annotations

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from harness.common.arrays import Floats
from harness.identification.contract import Fit
from harness.identification.result import Judged
from harness.models.quantities import quantity, words
from harness.reporting import style

_PANEL = 1.35
"""Inches per panel."""

_POINTS = 1500
"""Drawn per line: more than a printer resolves on the width of a page."""

_INTERVALS = 240
"""Over which the error is averaged: half a second of two minutes, so that the noise of a sensor does not hide it."""

ERROR = (
    "The simulation begins in the state that its filter has found by then. "
    f"Error: measured less simulated, in means over each {_INTERVALS}th of the drive."
)
"""What a caption says of it."""

_BEFORE, _AFTER = style.looks(["before", "after"]).values()


def over_time(judged: Judged, outputs: list[str], tallest: float = style.TALLEST) -> bytes:
    """Return measured and simulated outputs and the error, a row per output, in a figure of at most so many inches."""
    panel = min(_PANEL, (tallest - 1.2) / len(outputs))
    with style.drawing():
        fig = style.figure(1.1 + panel * len(outputs))
        rows = fig.subplots(len(outputs), 2, sharex=True, squeeze=False, width_ratios=(3, 2))
        some = slice(None, None, max(1, len(judged.drive.time) // _POINTS))
        time = judged.drive.time[some]
        for a, ((axes, errors), name) in enumerate(zip(rows, outputs, strict=True)):
            q, measured = quantity(name), judged.drive.measurements[:, a]
            axes.plot(time, q.scale * measured[some], color=style.MEASURED, lw=0.6)
            for free, look in zip(judged.free[:, :, a], (_BEFORE, _AFTER), strict=True):
                axes.plot(time, q.scale * free[some], color=look.line, ls=look.dashes, lw=1.0)
                middle, mean = _means(judged.drive.time, measured - free)
                errors.plot(middle, q.scale * mean, color=look.line, lw=0.8)
            seen = measured[np.isfinite(measured)]
            if seen.size:  # a simulation that diverges must not hide the rest
                most = q.scale * max(float(np.abs(seen).max()), 1e-12)
                for each, reach in ((axes, 1.5 * most), (errors, most)):
                    low, high = each.get_ylim()
                    each.set_ylim(max(low, -reach), min(high, reach))
            # Above the panel: next to it the words would be longer than a low panel is high.
            axes.set_title(f"{q.words}{style.in_unit(q.unit)}", loc="left")
            errors.set_title(f"error{style.in_unit(q.unit)}", loc="left")
            for each in (axes, errors):
                each.yaxis.set_major_locator(MaxNLocator(nbins=4 if panel > 0.7 * _PANEL else 2))
                each.grid(True)
        for each in rows[-1]:
            each.set_xlabel("time in s")
        handles = [
            Line2D([], [], color=style.MEASURED, lw=0.9, label="measured"),
            Line2D([], [], color=_BEFORE.line, ls=_BEFORE.dashes, label="simulated before"),
            Line2D([], [], color=_AFTER.line, ls=_AFTER.dashes, label="simulated after"),
        ]
        style.head(fig, f"Does the simulation follow {judged.drive.name}?", handles)
        return style.svg(fig)


def _means(time: Floats, values: Floats) -> tuple[Floats, Floats]:
    """Return the middle of intervals and the mean of what is known in each, NaN where nothing is."""
    each = max(1, len(time) // _INTERVALS)
    n = len(time) // each * each
    parts = values[:n].reshape(-1, each)
    finite = np.isfinite(parts)
    count = finite.sum(axis=1)
    mean = np.where(finite, parts, 0.0).sum(axis=1) / np.where(count, count, np.nan)
    return time[:n].reshape(-1, each).mean(axis=1), mean


def periodograms(judged: list[Judged], outputs: list[str]) -> bytes:
    """Return the cumulative periodograms less that of white noise, a panel per recording and a line per output."""
    chosen = style.looks(outputs)
    panel = min(1.9, (style.TALLEST - 1.6) / len(judged))
    with style.drawing():
        fig = style.figure(1.5 + panel * len(judged))
        panels = fig.subplots(len(judged), 1, sharex=True, squeeze=False)[:, 0]
        for axes, j in zip(panels, judged, strict=True):
            for name, w in zip(outputs, j.whiteness, strict=True):
                if not len(w.frequency):
                    continue
                some = slice(None, None, max(1, len(w.frequency) // _POINTS))
                look = chosen[name]
                away = w.cumulative - 2.0 * w.frequency
                axes.plot(w.frequency[some], away[some], color=look.line, ls=look.dashes)
                for side in (-w.band, w.band):
                    axes.axhline(side, color=style.TRUTH, ls=":", lw=0.8)
            axes.set_xlim(0.0, 0.5)
            axes.set_title(f"{j.drive.name}{', held out' if j.held_out else ''}", loc="left")
            axes.set_ylabel("share of power\nless white")
        panels[-1].set_xlabel("frequency over sampling frequency")
        handles = [Line2D([], [], color=chosen[n].line, ls=chosen[n].dashes, label=words(n)) for n in outputs]
        style.head(fig, "Are the innovations white?", handles)
        return style.svg(fig)


def profiles(fit: Fit) -> bytes:
    """Return the profile likelihood of every parameter that has one, in standard errors from its estimate."""
    drawn = [e for e in fit.estimates if e.profile is not None]
    chosen = style.looks([e.name for e in drawn])
    with style.drawing():
        fig = style.figure(3.4)
        axes = fig.subplots()
        grid = np.linspace(-4, 4, 161)
        axes.plot(grid, -0.5 * grid**2, color=style.TRUTH, ls=(0, (4, 3)), lw=0.8)
        axes.axhline(-1.92, color=style.TRUTH, ls=":", lw=0.8)
        for e in drawn:
            assert e.profile is not None
            look = chosen[e.name]
            away = (e.profile.values - e.value) / e.error
            axes.plot(away, -e.profile.drop, color=look.line, ls=look.dashes, marker=look.marker, ms=3.5)
        axes.set_xlim(-4, 4)
        axes.set_ylim(-6, 0.3)
        axes.set_xlabel("parameter less its estimate in standard errors")
        axes.set_ylabel("log-likelihood\nless its maximum")
        handles = [
            Line2D([], [], color=chosen[e.name].line, ls=chosen[e.name].dashes, marker=chosen[e.name].marker, ms=3.5,
                   label=words(e.name))
            for e in drawn
        ]  # fmt: skip
        style.head(fig, "How well do the recordings determine each parameter?", handles)
        return style.svg(fig)


def correlation(fit: Fit) -> bytes:
    """Return the correlation of the estimates as a matrix of coloured fields with numbers."""
    names = [words(e.name) for e in fit.estimates]
    n = len(names)
    with style.drawing():
        fig = style.figure(min(style.TALLEST, 1.0 + 0.27 * n + 0.5))
        axes = fig.subplots()
        axes.imshow(fit.correlation, cmap="RdBu", vmin=-1, vmax=1, aspect="auto")
        for i in range(n):
            for j in range(n):
                value = fit.correlation[i, j]
                if i != j and abs(value) >= 0.1:
                    shade = "white" if abs(value) > 0.6 else "black"
                    text = f"{value:.1f}".replace("-", "−").replace("0.", ".")
                    axes.text(j, i, text, ha="center", va="center", color=shade, size=9)
        axes.set_xticks(range(n), [str(k + 1) for k in range(n)])
        axes.set_yticks(range(n), [f"{name}  {k + 1}" for k, name in enumerate(names)])
        axes.tick_params(length=0)
        style.head(fig, "Which estimates are confounded?")
        return style.svg(fig)
