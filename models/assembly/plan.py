"""The vehicle from above: where axles and coupling stand, as its own equations say.

The slip angle of a wheel that is ``x`` ahead and ``y`` to the left of the CoG is
``steer - atan((v_y + x w) / (v_x - y w))``, so its slopes at straight driving give both: ``x`` is the slope with yaw
rate over that with lateral velocity, ``y`` the speed times the mixed slope over the latter. The coupling of two bodies
is where the tie that the equations state between them (``constraint_violation``) reads their lateral velocities.
Nothing has to be declared for that; how far a body reaches beyond its axles is known only where the vehicle exports
``outline``.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType

import sympy as sp

from harness.models.assembly.model import Body, Model, symbol
from harness.models.assembly.placement import Layout

_SPEED = 15.0
"""m/s at which slopes are taken; places do not depend on it."""

_OVERHANG, _WIDTH, _WIDEST = 0.25, 0.6, 2.5
"""Where the vehicle does not say it: what a body reaches beyond its last points, and its width, both over the distance
of these points, and the largest width in m."""


@dataclass(frozen=True)
class Axle:
    """Where an axle, or a wheel of its own, stands.

    Attributes:
        body: Whose it is.
        x: m ahead of the CoG of its body.
        y: m to the left of it; 0 for an axle that stands for both its wheels.
        steered: By how much of the road-wheel angle it is turned.
    """

    body: str
    x: float
    y: float
    steered: float


@dataclass(frozen=True)
class Outline:
    """How far a body reaches, in m from its CoG.

    Attributes:
        back: Behind it, a negative number.
        front: Ahead of it.
        width: Across.
        stated: Whether the vehicle says so; if not it is a guess for drawing.
    """

    back: float
    front: float
    width: float
    stated: bool


@dataclass(frozen=True)
class Plan:
    """Where things are on a vehicle.

    Attributes:
        axles: By name.
        coupling: Of a vehicle of two bodies: m ahead of the CoG of the first and of the second; ``None`` for one body.
        outlines: By body, the first in front.
    """

    axles: dict[str, Axle]
    coupling: tuple[float, float] | None
    outlines: dict[str, Outline]

    @property
    def cogs(self) -> dict[str, float]:
        """Where the CoG of each body is in the straight vehicle, in m ahead of that of the first."""
        ahead, behind = self.coupling or (0.0, 0.0)
        return {body: ahead - behind if i else 0.0 for i, body in enumerate(self.outlines)}

    def along(self, axle: str) -> float:
        """Return where an axle is in the straight vehicle, in m ahead of the CoG of the first body."""
        return self.cogs[self.axles[axle].body] + self.axles[axle].x


def plan_of(model: Model, vehicle: ModuleType, values: Mapping[str, float]) -> Plan | None:
    """Return the plan of a vehicle; ``None`` if its equations do not say where its axles stand.

    Args:
        model: Its equations.
        vehicle: Its file, for ``BODIES`` and ``outline``.
        values: Its parameters, SI.
    """
    layout, slopes = Layout.of(vehicle), _Slopes(model, values)
    if not model.bodies or set(layout.bodies) != set(model.bodies) or len(layout.bodies) > 2:
        return None
    own = [f"axle_{axle}" for axle in model.axles]
    ports = own or [p.removeprefix("slip_angle_") for p in model.ports if p.startswith("slip_angle_")]
    axles = {}
    for name in ports:
        axle = name.removeprefix("axle_")
        found = slopes.axle(f"slip_angle_{name}", layout.body_of_axle(axle))
        if found is None:
            return None
        axles[axle] = found
    if not axles:
        return None
    coupling = None
    if len(layout.bodies) == 2:
        ahead, behind = (slopes.ahead("constraint_violation", body) for body in layout.bodies)
        if ahead is None or behind is None:
            return None
        coupling = ahead, behind
    stated = vehicle.outline(dict(values)) if hasattr(vehicle, "outline") else {}
    outlines = {}
    for i, body in enumerate(layout.bodies):
        points = [(a.x, a.y) for a in axles.values() if a.body == body] + ([(coupling[i], 0.0)] if coupling else [])
        outlines[body] = Outline(*stated[body], True) if body in stated else _guessed(points)
    return Plan(axles, coupling, outlines)


def _guessed(points: list[tuple[float, float]]) -> Outline:
    """Return an outline around axles and coupling; wheels of their own say how wide the vehicle is."""
    back, front = min(x for x, _ in points), max(x for x, _ in points)
    length, track = front - back, 2 * max(abs(y) for _, y in points)
    return Outline(back - _OVERHANG * length, front + _OVERHANG * length, track or min(_WIDTH * length, _WIDEST), False)


class _Slopes:
    """Slopes of ports at straight driving."""

    def __init__(self, model: Model, values: Mapping[str, float]) -> None:
        self._model = model
        self._numbers = {symbol(n): 0.0 for n in (*model.states, *model.inputs, *model.flags, "time")}
        self._numbers |= {symbol(n): float(values[n]) for n in model.parameter_names if n in values}
        speeds = [self._written_out(body.speed) for body in model.bodies.values()]
        moving = [
            s for s in self._numbers for speed in speeds if speed.has(s) and self._value(sp.diff(speed, s)) == 1.0
        ]
        self._numbers |= dict.fromkeys(moving, _SPEED)

    def _value(self, expr: sp.Expr) -> float | None:
        found = expr.subs(self._numbers).evalf()
        return float(found) if found.is_number and found.is_finite else None

    def _written_out(self, expr: sp.Expr, keep: str = "") -> sp.Expr:
        """Write an expression without ports, but for one."""
        for name in reversed(self._model.ports):
            if name != keep and expr.has(symbol(name)):
                expr = expr.xreplace({symbol(name): self._model.ports[name]})
        return expr

    def _motion(self, body: Body) -> tuple[sp.Symbol, sp.Symbol, float, float] | None:
        """Return yaw rate and lateral state of a body, and by how much its lateral velocity goes with each."""
        turning, lateral = body.yaw_rate, self._written_out(body.lateral_velocity)
        if not isinstance(turning, sp.Symbol):
            return None
        for name in self._model.states:
            slope = self._value(sp.diff(lateral, symbol(name)))
            if symbol(name) != turning and slope:
                return turning, symbol(name), self._value(sp.diff(lateral, turning)) or 0.0, slope
        return None

    def ahead(self, port: str, body: str) -> float | None:
        """Return how far ahead of the CoG a port reads the lateral velocity of a body."""
        motion = self._motion(self._model.bodies[body])
        if motion is None or port not in self._model.ports:
            return None
        turning, sliding, by_turning, by_sliding = motion
        expr = self._written_out(symbol(port))
        turns, slides = self._value(sp.diff(expr, turning)), self._value(sp.diff(expr, sliding))
        return turns / slides * by_sliding - by_turning if slides and turns is not None else None

    def axle(self, port: str, body: str) -> Axle | None:
        """Return where the slip angle of a port is measured."""
        x, motion = self.ahead(port, body), self._motion(self._model.bodies[body])
        if x is None or motion is None:
            return None
        turning, sliding, *_ = motion
        sliding_slope = sp.diff(self._written_out(symbol(port)), sliding)
        slope, mixed = self._value(sliding_slope), self._value(sp.diff(sliding_slope, turning))
        kept = self._written_out(symbol(port), keep="road_wheel_angle")
        steered = sp.diff(kept, symbol("road_wheel_angle")).subs({symbol("road_wheel_angle"): 0.0})
        return Axle(body, x, _SPEED * mixed / slope if mixed and slope else 0.0, self._value(steered) or 0.0)
