"""A vehicle from above, with the disturbance inputs where they act and their gain as the area of a mark."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle

from harness.diagnosis.innovations.disturbance_inputs import DisturbanceInput, place_of, place_of_port
from harness.diagnosis.residuals.disturbance_ranking import RankedInput
from harness.models.assembly.plan import Plan
from harness.models.quantities import listed
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


def picture(plan: Plan, ranked_inputs: Sequence[RankedInput], added: Mapping[str, Collection[str]]) -> bytes:
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
            beside = taken.get((row, round(x, 1)), 0)
            taken[row, round(x, 1)] = beside + 1
            x += 0.055 * width * ((beside + 1) // 2) * (-1) ** beside
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
            told = f"changed by {listed(list(added))}"
            handles.append(Line2D([], [], ls="", marker="s", mfc="none", mec=frame.line, mew=1.6, label=told))
        style.head(fig, "Where is something missing?", handles)
        return style.svg(fig)


def _bodies(axes: Axes, plan: Plan) -> tuple[float, float]:
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
