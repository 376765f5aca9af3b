"""A vehicle from above, with the disturbance inputs where they act and their gain as the area of a mark.

Where axles and kingpin stand follows from the equations: the slip angle of an axle that is ``x`` ahead of the CoG reads
``v_y + x * yaw_rate``, so ``x`` is the ratio of its slopes.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import sympy as sp
from matplotlib.axes import Axes
from matplotlib.patches import Rectangle

from harness.diagnosis.innovations.disturbance_inputs import DisturbanceInput
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.residuals.disturbance_ranking import RankedInput
from harness.models.assembly.assemble import symbol
from harness.models.assembly.placement import Layout, suffix
from harness.models.roles import VEHICLES
from harness.reporting import style

NUMBERED = 8
"""Inputs that carry their rank."""

_SPEED = 15.0
"""m/s at which slopes are taken; they do not depend on it."""

_OVERHANG = 1.0
"""m of a body beyond its first and last axle."""

_LARGEST = 420.0
"""Area of the largest mark in square points."""

_ROWS = {"other": 4.0, "yaw moment": 3.1, "force": 2.2, "tyres and steering": 0.0, "equation": -2.2, "sensor": -3.1}


@dataclass(frozen=True)
class Plan:
    """Where things are along a vehicle, in m ahead of the CoG of the first body.

    Attributes:
        cogs: CoG by body.
        axles: By name.
        kingpin: ``None`` for a vehicle of one body.
        layout: Which axle belongs to which body.
    """

    cogs: dict[str, float]
    axles: dict[str, float]
    kingpin: float | None
    layout: Layout

    def of(self, disturbance_input: DisturbanceInput) -> float:
        """Return where an input acts; what acts on all bodies is drawn in the middle of them."""
        places = [self._place(p.removeprefix("sensor_")) for p in disturbance_input.ports]
        return float(np.mean(places))

    def _place(self, name: str) -> float:
        axle = name.rpartition("_axle_")[2]
        if axle in self.axles:
            return self.axles[axle]
        if self.kingpin is not None and name.startswith(("coupling", "articulation")):
            return self.kingpin
        if name == "road_wheel_angle":
            return max(self.axles.values())
        body = next((b for b in self.cogs if b and name.endswith(b)), None)
        return float(np.mean(list(self.cogs.values()))) if body is None else self.cogs[body]


def plan_of(augmented: AugmentedModel) -> Plan | None:
    """Return where axles and kingpin of a vehicle stand; ``None`` if its equations do not say."""
    model, layout = augmented.nominal, Layout.of(VEHICLES.load(augmented.spec.vehicle))
    numbers = {symbol(n): 0.0 for n in (*model.states, *model.inputs)}
    numbers |= {symbol(n): float(v) for n, v in augmented.spec.values.items()}
    numbers |= {symbol(n): _SPEED for n in ("speed", "longitudinal_velocity") if symbol(n) in numbers}

    def ahead(port: str, body: str) -> float | None:
        motion = [symbol(stem + suffix(body)) for stem in ("yaw_rate", "lateral_velocity")]
        if port not in model.ports or not {str(m) for m in motion} <= set(model.states):
            return None
        expr = model.expand(symbol(port))
        turning, sliding = (sp.diff(expr, m).subs(numbers).evalf() for m in motion)
        return float(turning / sliding) if sliding.is_number and abs(sliding) > 1e-9 else None

    cogs, kingpin = {layout.leader: 0.0}, None
    for follower in list(layout.bodies)[1:]:
        ends = [ahead("constraint_violation", body) for body in (layout.leader, follower)]
        if ends[0] is None or ends[1] is None or kingpin is not None:
            return None
        kingpin = ends[0]
        cogs[follower] = kingpin - ends[1]
    axles = {}
    for axle in model.axles:
        body = layout.body_of_axle(axle)
        place = ahead(f"slip_angle_axle_{axle}", body)
        if place is None:
            return None
        axles[axle] = cogs[body] + place
    return Plan(cogs, axles, kingpin, layout) if axles else None


def row_of(disturbance_input: DisturbanceInput) -> str:
    """Return the row of the picture in which an input is drawn."""
    if disturbance_input.kind != "port":
        return disturbance_input.kind
    if "_axle_" in disturbance_input.ports[0] or disturbance_input.name == "road_wheel_angle":
        return "tyres and steering"
    return {"N": "force", "N*m": "yaw moment"}.get(disturbance_input.unit, "other")


def picture(plan: Plan, ranked_inputs: Sequence[RankedInput]) -> bytes:
    """Return the vehicle from above with a mark per input, its area proportional to the gain in likelihood."""
    look = style.looks(["gain"])["gain"]
    with style.drawing():
        fig = style.figure(4.2)
        axes = fig.subplots()
        ends = _bodies(axes, plan)
        width = ends[1] - ends[0]
        taken: dict[tuple[str, float], int] = {}
        most = max(s.gain for s in ranked_inputs)
        for rank, s in enumerate(ranked_inputs, 1):
            if s.gain <= 0:
                continue
            row, x = row_of(s.disturbance_input), plan.of(s.disturbance_input)
            beside = taken.get((row, round(x, 1)), 0)
            taken[row, round(x, 1)] = beside + 1
            x += 0.055 * width * ((beside + 1) // 2) * (-1) ** beside
            axes.scatter(x, _ROWS[row], s=_LARGEST * s.gain / most, facecolor=look.tint, edgecolor=look.line, zorder=3)
            if rank <= NUMBERED:
                axes.annotate(str(rank), (x, _ROWS[row]), ha="center", va="center", zorder=4)
        axes.set_yticks(list(_ROWS.values()), list(_ROWS))
        axes.set_ylim(-3.8, 4.7)
        axes.set_xlim(ends[0] - 0.05 * width, ends[1] + 0.05 * width)
        axes.set_xlabel("position ahead of the CoG of the first body in m; it drives to the right")
        axes.grid(True, axis="x")
        style.head(fig, "Where does a disturbance explain most?")
        return style.svg(fig)


def _bodies(axes: Axes, plan: Plan) -> tuple[float, float]:
    """Draw bodies, wheels and kingpin; return the ends of the vehicle."""
    low, high = np.inf, -np.inf
    for body, cog in plan.cogs.items():
        places = [plan.axles[a] for a in plan.layout.bodies[body]] + [cog]
        if plan.kingpin is not None:
            places.append(plan.kingpin)
        back, front = min(places) - _OVERHANG, max(places) + _OVERHANG
        low, high = min(low, back), max(high, front)
        shape = Rectangle((back, -1.2), front - back, 2.4, facecolor="none", edgecolor=style.MEASURED, lw=1.0)
        axes.add_patch(shape)
    for place in sorted(set(plan.axles.values())):
        for side in (-1.2, 1.0):
            wheel = Rectangle((place - 0.4, side), 0.8, 0.2, facecolor=style.MEASURED, edgecolor="none")
            axes.add_patch(wheel)
    if plan.kingpin is not None:
        axes.plot(plan.kingpin, 0.0, marker="x", color=style.TRUTH, ms=5)
    return float(low), float(high)
