"""Pictures of estimators on a recording: estimates with their bands, innovations, NIS, errors and NEES."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from itertools import pairwise

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.common.series import thinned
from harness.models.quantities import quantity
from harness.recorded.summary import outputs_of
from harness.reporting import style
from harness.reporting.style import Look, looks
from harness.runner.scores import chi_square_bounds

_PANEL, _LOWEST = 1.6, 1.03
"""Inches per panel, and where that saves a page."""

_AROUND = 1.2
"""Inches of a figure above and below its panels."""

PER_FIGURE = int((style.TALLEST - _AROUND) // _LOWEST)
"""Panels that a page takes."""

_POINTS = 1500
"""Drawn per line: more than a printer resolves on the width of a page."""

_WINDOWS = 150
"""Averages of NIS drawn along a recording."""

_BAND = 2.0
"""Standard deviations to either side."""


def estimates(runs: Sequence[xr.Dataset], signals: Sequence[str], title: str) -> bytes:
    """Return estimates with their bands over what was measured and, where there is one, the reference."""
    measured = {runs[0][f"measured_{n}"].attrs["port"]: f"measured_{n}" for n in outputs_of(runs[0])}

    def panel(axes: Axes, name: str, chosen: dict[str, Look]) -> None:
        q = quantity(name)
        some = _thinned(runs, name, f"{name}_std", f"reference_{name}", measured.get(name, ""))
        time = runs[0]["time"].to_numpy()[some]
        if name in measured:
            values = q.scale * runs[0][measured[name]].to_numpy()[some]
            axes.plot(time, values, ls="", marker=".", ms=1.5, color=style.MEASURED, rasterized=len(time) > 500)
        if f"reference_{name}" in runs[0]:
            axes.plot(time, q.scale * runs[0][f"reference_{name}"].to_numpy()[some], color=style.TRUTH, lw=1.2)
        for run in runs:
            look = chosen[run.attrs["estimator"]]
            value, spread = (q.scale * run[v].to_numpy()[some] for v in (name, f"{name}_std"))
            axes.fill_between(time, value - _BAND * spread, value + _BAND * spread, color=look.line, alpha=0.2, lw=0)
            axes.plot(time, value, color=look.line, ls=look.dashes, lw=1.0)
        _within(axes, [q.scale * r[name].to_numpy() for r in runs])

    handles = [
        Line2D([], [], color=style.TRUTH, lw=1.2, label="reference"),
        Line2D([], [], color=style.MEASURED, marker=".", ls="", label="measured"),
    ]
    there = [any(f"reference_{n}" in runs[0] for n in signals), any(n in measured for n in signals)]
    return _panels(runs, signals, title, panel, [h for h, t in zip(handles, there, strict=True) if t], band=True)


def innovations(runs: Sequence[xr.Dataset], title: str) -> bytes:
    """Return the innovations of every output with the band that each estimator states."""

    def panel(axes: Axes, name: str, chosen: dict[str, Look]) -> None:
        q, some = quantity(name), _thinned(runs, f"innovation_{name}", f"innovation_std_{name}")
        time = runs[0]["time"].to_numpy()[some]
        for run in runs:
            look = chosen[run.attrs["estimator"]]
            value, spread = (
                q.scale * run[v].to_numpy()[some] for v in (f"innovation_{name}", f"innovation_std_{name}")
            )
            axes.plot(time, value, ls="", marker=".", ms=1.8, color=look.line, alpha=0.6, rasterized=len(time) > 500)
            for side in (-_BAND, _BAND):
                axes.plot(time, side * spread, color=look.line, ls=look.dashes, lw=0.9)
        axes.axhline(0.0, color=style.TRUTH, lw=0.5)

    return _panels(runs, outputs_of(runs[0]), title, panel, [], band=True)


def errors(runs: Sequence[xr.Dataset], signals: Sequence[str], title: str) -> bytes:
    """Return estimate less reference with the band that each estimator states."""

    def panel(axes: Axes, name: str, chosen: dict[str, Look]) -> None:
        q, some = quantity(name), _thinned(runs, f"error_{name}", f"{name}_std")
        time = runs[0]["time"].to_numpy()[some]
        for run in runs:
            look = chosen[run.attrs["estimator"]]
            value, spread = (q.scale * run[v].to_numpy()[some] for v in (f"error_{name}", f"{name}_std"))
            axes.fill_between(time, -_BAND * spread, _BAND * spread, color=look.line, alpha=0.2, lw=0)
            axes.plot(time, value, color=look.line, ls=look.dashes, lw=1.0)
        axes.axhline(0.0, color=style.TRUTH, lw=0.5)
        _within(axes, [q.scale * r[f"error_{name}"].to_numpy() for r in runs])

    return _panels(runs, signals, title, panel, [], band=True)


def normalised(runs: Sequence[xr.Dataset], names: Sequence[str], title: str) -> bytes:
    """Return NIS, and NEES where there is one, over their degrees of freedom, averaged in windows.

    The band holds 95 of 100 averages if the estimator is consistent; of NEES, whose neighbours are alike, it is the
    band of a single sample.
    """

    def panel(axes: Axes, name: str, chosen: dict[str, Look]) -> None:
        for run in runs:
            look = chosen[run.attrs["estimator"]]
            value, degrees = run[name].to_numpy(), run[f"{name}_degrees"].to_numpy()
            if not np.isfinite(value).any():
                continue
            time, mean, band = _averaged(run["time"].to_numpy(), value, degrees, single=name == "nees")
            axes.plot(time, mean, color=look.line, ls=look.dashes, lw=1.0)
            axes.fill_between(time, band[:, 0], band[:, 1], color=style.SHADE, lw=0, zorder=0)
        axes.axhline(1.0, color=style.TRUTH, lw=0.6)
        shown = [v for line in axes.get_lines() for v in np.ravel(line.get_ydata()) if np.isfinite(v) and v > 0]
        style.logarithmic(axes, max(min(shown), 1e-3), max(shown))
        axes.set_ylabel(f"{name.upper()} over its\ndegrees of freedom")
        axes.grid(True)

    drawn = [r for r in runs if any(np.isfinite(r[n]).any() for n in names)]
    chosen = looks([r.attrs["estimator"] for r in runs])
    handles = [_line(r, chosen) for r in drawn]
    with style.drawing():
        fig = style.figure(_height(len(names)))
        panels = fig.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        for axes, name in zip(panels, names, strict=True):
            panel(axes, name, chosen)
        panels[-1].set_xlabel("time in s")
        style.head(fig, title, [*handles, Patch(color=style.SHADE, label="95 % if consistent")])
        return style.svg(fig)


def _averaged(time: Floats, value: Floats, degrees: Floats, single: bool) -> tuple[Floats, Floats, Floats]:
    """Return the middle of each window, the mean over its degrees of freedom there, and the 95 % band ``(n, 2)``."""
    counted = np.isfinite(value) & (degrees > 0)
    edges = np.linspace(0, len(time), min(_WINDOWS, max(1, len(time) // 10)) + 1).astype(int)
    rows = []
    largest = int(np.add.reduceat(np.where(counted, degrees, 0), edges[:-1]).max())
    bounds = chi_square_bounds(1 + max(largest, 1))
    for first, last in pairwise(edges):
        here = counted[first:last]
        if not here.any():
            rows.append((time[first:last].mean(), np.nan, np.nan, np.nan))
            continue
        total = int(degrees[first:last][here].sum())
        dof = round(float(degrees[first:last][here].mean())) if single else total
        rows.append((time[first:last].mean(), value[first:last][here].sum() / total, *(bounds[dof] / dof)))
    table = np.array(rows)
    return table[:, 0], table[:, 1], table[:, 2:]


def _height(panels: int) -> float:
    """Return the inches of a figure: those that its panels like, or half a page or a whole one where they fit there."""
    liked, least = (_AROUND + size * panels for size in (_PANEL, _LOWEST))
    return next(min(liked, room) for room in (style.HALF, style.TALLEST) if least <= room)


def _panels(
    runs: Sequence[xr.Dataset],
    names: Sequence[str],
    title: str,
    panel: Callable[[Axes, str, dict[str, Look]], None],
    handles: list[Line2D],
    band: bool,
) -> bytes:
    """Return a figure with a panel for each quantity."""
    chosen = looks([r.attrs["estimator"] for r in runs])
    with style.drawing():
        fig = style.figure(_height(len(names)))
        panels = fig.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        for axes, name in zip(panels, names, strict=True):
            panel(axes, name, chosen)
            q = quantity(name)
            axes.set_ylabel(f"{q.words.replace(' ', chr(10), 1)}\n{style.in_unit(q.unit).strip()}")
            axes.grid(True)
        panels[-1].set_xlabel("time in s")
        bands = [Patch(color="#b0b0b0", label="± 2σ")] if band else []
        style.head(fig, title, [*handles, *(_line(r, chosen) for r in runs), *bands])
        return style.svg(fig)


def _line(run: xr.Dataset, chosen: dict[str, Look]) -> Line2D:
    look = chosen[run.attrs["estimator"]]
    return Line2D([], [], color=look.line, ls=look.dashes, lw=1.3, label=run.attrs["estimator"])


def _thinned(runs: Sequence[xr.Dataset], *names: str) -> NDArray[np.int64]:
    """Return the samples that stand for all of some lines of runs, with every extreme of each."""
    lines = [run[name].to_numpy() for run in runs for name in names if name in run]
    return thinned(lines, 0, runs[0].sizes["time"], max(50, _POINTS // (1 + 2 * len(lines))))


def _within(axes: Axes, values: Sequence[Floats]) -> None:
    """Keep a panel to what is estimated: a band that begins wide must not hide the rest."""
    seen = np.concatenate([v[np.isfinite(v)] for v in values])
    if seen.size:
        low, high = np.quantile(seen, [0.001, 0.999])
        room = 0.6 * max(float(high - low), 1e-9)
        now = axes.get_ylim()
        axes.set_ylim(max(now[0], low - room), min(now[1], high + room))
