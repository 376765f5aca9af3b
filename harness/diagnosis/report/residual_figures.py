"""Figures of where a model lacks something and of what its innovations depend on, as SVG in the look of all reports.

The vehicle is seen from above, with the disturbance inputs where they act and their gain as the area of a mark.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from matplotlib.ticker import NullFormatter, ScalarFormatter

from harness.diagnosis.innovations.disturbance_inputs import DisturbanceInput, place_of, place_of_port
from harness.diagnosis.residuals.dependence import Curve, Regressor
from harness.diagnosis.residuals.disturbance_ranking import DisturbanceHistory, DisturbanceRanking, RankedInput
from harness.diagnosis.residuals.innovation_tests import CrossCorrelation, NisOverTime
from harness.diagnosis.residuals.order_analysis import WAVELENGTHS, PeriodicDisturbance
from harness.diagnosis.result.answer import entry, shown
from harness.identification.data import DriveData
from harness.models.assembly.plan import GroundPlan
from harness.models.quantities import listed, print_unit, quantity, words
from harness.reporting import style

NUMBERED = 8
"""Inputs that carry their rank."""

_LARGEST = 230.0
"""Area of the largest mark in square points."""

_ROWS = {"other": 4.0, "yaw moment": 3.1, "force": 2.2, "tyres and steering": 0.0, "equation": -2.2, "sensor": -3.1}


def row_of(disturbance_input: DisturbanceInput) -> str:
    """Return the row of the picture in which an input is drawn."""
    if disturbance_input.kind != "port":
        return disturbance_input.kind
    return _port_row(disturbance_input.ports[0], disturbance_input.unit)


def _port_row(port: str, unit: str = "") -> str:
    """Return the row of a port of the model."""
    if port.startswith("sensor_"):
        return "sensor"
    if "_axle_" in port or port == "road_wheel_angle":
        return "tyres and steering"
    return {"N": "force", "N*m": "yaw moment"}.get(unit, "other")


def picture(plan: GroundPlan, ranked_inputs: Sequence[RankedInput], added: Mapping[str, Collection[str]]) -> bytes:
    """Return the vehicle from above with a mark per input, its area proportional to the gain in likelihood.

    Args:
        plan: Where everything stands.
        ranked_inputs: The inputs, that of the largest gain first.
        added: Ports that an addition to the model changes, by its name in words: they have a frame.
    """
    look, frame = style.looks(["gain", "added"]).values()
    with style.drawing():
        fig = style.figure(3.3)
        axes = fig.subplots()
        ends = _bodies(axes, plan)
        width = ends[1] - ends[0]
        taken: dict[tuple[str, float], int] = {}
        drawn: dict[str, tuple[str, float]] = {}
        most = max(s.gain for s in ranked_inputs)
        for rank, s in enumerate(ranked_inputs, 1):
            if s.gain <= 0:
                continue
            row, x = row_of(s.disturbance_input), place_of(plan, s.disturbance_input)
            count = taken.get((row, round(x, 1)), 0)
            taken[row, round(x, 1)] = count + 1
            x += 0.055 * width * ((count + 1) // 2) * (-1) ** count
            if len(s.disturbance_input.ports) == 1:
                drawn.setdefault(s.disturbance_input.ports[0], (row, x))
            axes.scatter(x, _ROWS[row], s=_LARGEST * s.gain / most, facecolor=look.tint, edgecolor=look.line, zorder=3)
            if rank <= NUMBERED:
                axes.annotate(str(rank), (x, _ROWS[row]), ha="center", va="center", zorder=4)
        ports = [p for ports in added.values() for p in ports]
        placed = {drawn.get(p, (_port_row(p), place_of_port(plan, p))) for p in ports}
        for row, x in placed:
            axes.scatter(x, _ROWS[row], s=1.5 * _LARGEST, marker="s", facecolor="none", edgecolor=frame.line, lw=1.6,
                         zorder=5)  # fmt: skip
        axes.set_yticks(list(_ROWS.values()), list(_ROWS))
        axes.set_ylim(-3.8, 4.7)
        axes.set_xlim(ends[0] - 0.05 * width, ends[1] + 0.05 * width)
        axes.set_xlabel("position ahead of the CoG of the first body in m; it drives to the right")
        axes.grid(True, axis="x")
        handles = [
            Line2D([], [], ls="", marker="o", color=look.tint, mec=look.line, label="gain of a disturbance, area")
        ]
        if placed:
            label = f"changed by {listed(list(added))}"
            handles.append(Line2D([], [], ls="", marker="s", mfc="none", mec=frame.line, mew=1.6, label=label))
        style.head(fig, "Where is something missing?", handles)
        return style.svg(fig)


def _bodies(axes: Axes, plan: GroundPlan) -> tuple[float, float]:
    """Draw bodies, wheels and kingpin; return the ends of the vehicle."""
    low, high = np.inf, -np.inf
    for body, cog in plan.cogs.items():
        back, front = cog + plan.outlines[body].back, cog + plan.outlines[body].front
        low, high = min(low, back), max(high, front)
        shape = Rectangle((back, -1.2), front - back, 2.4, facecolor="none", edgecolor=style.MEASURED, lw=1.0)
        axes.add_patch(shape)
    for place in sorted(set(map(plan.along, plan.axles))):
        for side in (-1.2, 1.0):
            wheel = Rectangle((place - 0.4, side), 0.8, 0.2, facecolor=style.MEASURED, edgecolor="none")
            axes.add_patch(wheel)
    if plan.coupling is not None:
        axes.plot(plan.coupling[0], 0.0, marker="x", color=style.TRUTH, ms=5)
    return float(low), float(high)


SHOWN = 15
"""Inputs in the ranking."""

DRAWN = 5
"""Signals in the figure of correlations."""

_POINTS = 1500
_BINS = 30
_BEFORE, _AFTER = style.looks(["before", "after"]).values()


def ranking(nominal: Sequence[RankedInput], final: Sequence[RankedInput]) -> bytes:
    """Return the gain of a disturbance at each of the best inputs, before and after what was added, if any."""
    drawn = [s for s in nominal[:SHOWN] if s.gain > 0]
    rankings = {"nominal model": nominal} if nominal is final else {"nominal model": nominal, "final model": final}
    gains = [{s.disturbance_input.name: s.gain for s in ranked_inputs} for ranked_inputs in rankings.values()]
    height = 0.72 / len(gains)
    with style.drawing():
        fig = style.figure(1.2 + 0.26 * len(drawn))
        axes = fig.subplots()
        at = np.arange(len(drawn))[::-1]
        for j, (gain_of, look) in enumerate(zip(gains, (_BEFORE, _AFTER), strict=False)):
            places = at + 0.36 - height * (j + 0.5)
            widths = [gain_of[s.disturbance_input.name] for s in drawn]
            axes.barh(places, widths, 0.9 * height, facecolor=look.tint, edgecolor=look.line, hatch=look.hatch)
        axes.set_yticks(at, [f"{entry(s.disturbance_input)}  {rank}" for rank, s in enumerate(drawn, 1)])
        axes.set_xlabel("gain in log-likelihood")
        axes.grid(True, axis="x")
        names = list(rankings)
        handles = style.patches(names, dict(zip(names, (_BEFORE, _AFTER), strict=False)))
        style.head(fig, "What would an unknown disturbance explain?", handles)
        return style.svg(fig)


def histories(
    drive: DriveData, ranked_inputs: Sequence[RankedInput], disturbances: Sequence[DisturbanceHistory]
) -> bytes:
    """Return the disturbance over one drive at the inputs of the largest gain, each with its 95 % band."""
    with style.drawing():
        fig = style.figure(0.8 + 1.5 * len(ranked_inputs))
        panels = fig.subplots(len(ranked_inputs), 1, sharex=True, squeeze=False)[:, 0]
        some = slice(None, None, max(1, len(drive.time) // _POINTS))
        for axes, s, h in zip(panels, ranked_inputs, disturbances, strict=True):
            unit, scale = shown(s.disturbance_input)
            mean, half = scale * h.mean[some], 1.96 * scale * h.error[some]
            axes.fill_between(drive.time[some], mean - half, mean + half, color=_BEFORE.tint, lw=0)
            axes.plot(drive.time[some], mean, color=_BEFORE.line)
            axes.axhline(0.0, color=style.TRUTH, lw=0.5)
            axes.set_title(entry(s.disturbance_input), loc="left")
            axes.set_ylabel(style.in_unit(unit).strip())
            axes.grid(True)
        panels[-1].set_xlabel("time in s")
        style.head(fig, f"What would the disturbance look like in {drive.name}?")
        return style.svg(fig)


def nis(names: Sequence[str], series: Sequence[NisOverTime]) -> bytes:
    """Return the normalised innovation squared over time with its 95 % band, a panel per drive."""
    with style.drawing():
        fig = style.figure(0.9 + min(1.5, 7.5 / len(series)) * len(series))
        panels = fig.subplots(len(series), 1, sharex=True, squeeze=False)[:, 0]
        for axes, name, c in zip(panels, names, series, strict=True):
            axes.fill_between(c.time, *c.band, color=style.SHADE, lw=0)
            axes.plot(c.time, c.nis, color=_AFTER.line)
            axes.set_title(f"{name}: {style.percent(c.inside)} of the samples inside their own band", loc="left")
            axes.set_ylabel("NIS per value")
            most = float(np.quantile(c.nis, 0.99)) if len(c.nis) else 0.0
            axes.set_ylim(0.0, max(1.6, 1.05 * most))
            axes.grid(True)
        panels[-1].set_xlabel("time in s")
        style.head(fig, "Are the innovations as large as the filter states?")
        return style.svg(fig)


def correlations(correlation: CrossCorrelation, outputs: Sequence[str], regressors: Sequence[Regressor]) -> bytes:
    """Return the correlation of every innovation with the past of the signals of the largest correlations."""
    finite = np.where(
        np.isfinite(correlation.values), correlation.values, 0.0
    )  # nothing is known of a signal that overflows
    strength = np.abs(finite / correlation.band[:, None]).max(axis=(0, 1))
    drawn = np.argsort(-strength)[:DRAWN]
    chosen = style.looks([regressors[j].name for j in drawn])
    with style.drawing():
        fig = style.figure(1.2 + 1.3 * len(outputs))
        panels = fig.subplots(len(outputs), 1, sharex=True, squeeze=False)[:, 0]
        for a, (axes, name) in enumerate(zip(panels, outputs, strict=True)):
            axes.axhspan(-correlation.band[a], correlation.band[a], color=style.SHADE, lw=0)
            for j in drawn:
                look = chosen[regressors[j].name]
                axes.plot(correlation.lag, correlation.values[:, a, j], color=look.line, ls=look.dashes)
            reach = 1.15 * max(float(np.abs(finite[:, a]).max()), 2.0 * float(correlation.band[a]))
            axes.set_ylim(-reach, reach)
            axes.set_ylabel(words(name).replace(" ", "\n", 1))
            axes.grid(True)
        panels[-1].set_xlabel("lag of the innovation behind the signal in s")
        handles = [
            Line2D([], [], color=chosen[d.name].line, ls=chosen[d.name].dashes, label=d.words)
            for d in (regressors[j] for j in drawn)
        ]
        style.head(fig, "Are the innovations correlated with the past?", handles)
        return style.svg(fig)


def curves(ranking: DisturbanceRanking, estimated: Sequence[Curve]) -> bytes:
    """Return each curve with its 95 % band, over the disturbance that the smoother finds in the fitted drives."""
    with style.drawing():
        fig = style.figure(0.9 + 2.1 * len(estimated))
        panels = fig.subplots(len(estimated), 1, squeeze=False)[:, 0]
        for axes, c in zip(panels, estimated, strict=True):
            unit, scale = shown(c.disturbance_input)
            across, along = shown_regressor(c.regressor)
            grid = np.linspace(*c.basis.ends, 300)
            value, half = scale * c.at(grid), 1.96 * scale * c.error(grid)
            places, means = _binned(ranking, c)
            axes.plot(along * places, scale * means, ls="", marker="o", ms=3.5, color=style.MEASURED)
            axes.fill_between(along * grid, value - half, value + half, color=_AFTER.tint, lw=0)
            axes.plot(along * grid, value, color=_AFTER.line)
            axes.set_xlabel(f"{c.regressor.words}{style.in_unit(across)}")
            axes.set_ylabel(f"{entry(c.disturbance_input)}{style.in_unit(unit)}".replace(" ", "\n", 1))
            axes.grid(True)
        handles = [
            Line2D([], [], color=_AFTER.line, label="curve with 95 % band"),
            Line2D([], [], color=style.MEASURED, ls="", marker="o", ms=3.5, label="smoothed disturbance, mean"),
        ]
        style.head(fig, "What does the missing effect depend on?", handles)
        return style.svg(fig)


def spectra(periodic: Sequence[PeriodicDisturbance]) -> bytes:
    """Return the gain of disturbances that are periodic in the distance driven, over the wavelength, a panel each."""
    with style.drawing():
        fig = style.figure(0.9 + 1.9 * len(periodic))
        panels = fig.subplots(len(periodic), 1, sharex=True, squeeze=False)[:, 0]
        for axes, t in zip(panels, periodic, strict=True):
            axes.plot(t.spectrum.wavelength, t.spectrum.gain, color=_BEFORE.line, lw=0.6)
            axes.plot([t.wavelength], [t.gain], ls="", marker="v", ms=6, color=_AFTER.line)
            axes.annotate(
                style.with_unit(t.wavelength, "m"), (t.wavelength, t.gain), (8, -3), textcoords="offset points"
            )
            axes.set_title(entry(t.disturbance_input), loc="left")
            axes.set_ylabel("gain in log-\nlikelihood")
            axes.set_ylim(0.0, 1.15 * t.gain)
            axes.set_xscale("log")
            axes.xaxis.set_major_formatter(ScalarFormatter())
            axes.xaxis.set_minor_formatter(NullFormatter())
            axes.set_xticks([0.5, 1.0, 2.0, 5.0, 10.0])
            axes.set_xlim(*WAVELENGTHS)
            axes.grid(True)
        panels[-1].set_xlabel("wavelength in m driven")
        style.head(fig, "What is periodic in the distance driven?")
        return style.svg(fig)


def shown_regressor(regressor: Regressor) -> tuple[str, float]:
    """Return the unit in which reports show a regressor, and how many of it make an SI unit."""
    q = quantity(regressor.name, regressor.unit)
    return (q.unit, q.scale) if q.meaning else (print_unit(regressor.unit), 1.0)


def _binned(ranking: DisturbanceRanking, curve: Curve) -> tuple[np.ndarray, np.ndarray]:
    """Return the mean of the smoothed disturbance over bins of the signal: where the bins are, and the means."""
    ranked_input = next(s for s in ranking.ranked_inputs if s.disturbance_input == curve.disturbance_input)
    signal = np.concatenate([curve.regressor.over(p.states, p.drive) for p in ranking.linear])
    smoothed = np.concatenate([h.mean for h in ranking.history(ranked_input)])
    edges = np.linspace(*curve.basis.ends, _BINS + 1)
    which = np.digitize(signal, edges) - 1
    kept = [b for b in range(_BINS) if np.sum(which == b) >= 50]
    return np.array([0.5 * (edges[b] + edges[b + 1]) for b in kept]), np.array(
        [smoothed[which == b].mean() for b in kept]
    )
