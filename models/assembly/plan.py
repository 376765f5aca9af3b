"""The vehicle from above: where axles and coupling stand, as its own equations say.

The slip angle of a wheel that is ``x`` ahead and ``y`` to the left of the CoG is
``steer - atan((v_y + x w) / (v_x - y w))``, so its slopes at straight driving give both: ``x`` is the slope with yaw
rate over that with lateral velocity, ``y`` the speed times the mixed slope over the latter. The coupling of two bodies
is where the tie that the equations state between them (``constraint_violation``) reads their lateral velocities.
Nothing has to be declared for that; how far a body reaches beyond its axles is known only where the vehicle exports
``outline``.
"""

from __future__ import annotations

import functools
from collections.abc import Mapping
from dataclasses import dataclass
from types import ModuleType

import sympy as sp

from harness.models.assembly.model import Body, StateSpaceModel, symbol
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
class GroundPlan:
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


class Planner:
    """Reads plans out of the equations of a vehicle, for any values of its parameters.

    Args:
        model: The equations.
        vehicle: The vehicle's file, for ``BODIES`` and ``outline``.

    Attributes:
        lengths: Names of the parameters on which it depends where axles and coupling are; none if nothing says where.
    """

    def __init__(self, model: StateSpaceModel, vehicle: ModuleType) -> None:
        self.lengths: frozenset[str] = frozenset()
        self._vehicle, self._layout = vehicle, Layout.of(vehicle)
        self._axles: dict[str, _AxleSlopes] | None = None
        self._coupling: list[sp.Expr] = []
        bodies = self._layout.bodies
        if not model.bodies or set(bodies) != set(model.bodies) or len(bodies) > 2:
            return
        slopes = _Slopes(model)
        own = [f"axle_{axle}" for axle in model.axles]
        ports = own or [p.removeprefix("slip_angle_") for p in model.ports if p.startswith("slip_angle_")]
        axles = {name.removeprefix("axle_"): name for name in ports}
        sites = {a: slopes.axle(f"slip_angle_{n}", self._layout.body_of_axle(a)) for a, n in axles.items()}
        coupling = [slopes.ahead("constraint_violation", body) for body in bodies] if len(bodies) == 2 else []
        if sites and None not in sites.values() and None not in coupling:
            self._axles = {axle: at for axle, at in sites.items() if at is not None}
            self._coupling = [at for at in coupling if at is not None]
            wanted = [part for at in self._axles.values() for part in (at.x, at.y, at.steered)] + self._coupling
            places = [part for at in self._axles.values() for part in (at.x, at.y)] + self._coupling
            self.lengths = frozenset(str(s) for e in places for s in e.free_symbols)
            self._symbols = sorted({s for e in wanted for s in e.free_symbols}, key=str)
            self._numbers = sp.lambdify(self._symbols, wanted, "math")

    def plan(self, values: Mapping[str, float]) -> GroundPlan | None:
        """Return the plan of the vehicle; ``None`` if its equations do not say where its axles stand.

        Args:
            values: Its parameters, SI.
        """
        if self._axles is None:
            return None
        numbers = list(map(float, self._numbers(*(values[s.name] for s in self._symbols))))
        axles = {a: Axle(at.body, *numbers[3 * i : 3 * i + 3]) for i, (a, at) in enumerate(self._axles.items())}
        coupling = (numbers[-2], numbers[-1]) if self._coupling else None
        stated = self._vehicle.outline(dict(values)) if hasattr(self._vehicle, "outline") else {}
        outlines = {}
        for i, body in enumerate(self._layout.bodies):
            points = [(a.x, a.y) for a in axles.values() if a.body == body] + ([(coupling[i], 0.0)] if coupling else [])
            ends = stated.get(body)
            outlines[body] = Outline(ends[0], ends[1], ends[2], True) if ends else _guessed(points)
        return GroundPlan(axles, coupling, outlines)


@functools.lru_cache(maxsize=8)
def planner(model: StateSpaceModel, vehicle: ModuleType) -> Planner:
    """Return the planner of a vehicle; to read its equations takes a second."""
    return Planner(model, vehicle)


@dataclass(frozen=True)
class _AxleSlopes:
    """``Axle`` with expressions in the parameters."""

    body: str
    x: sp.Expr
    y: sp.Expr
    steered: sp.Expr


def _guessed(points: list[tuple[float, float]]) -> Outline:
    """Return an outline around axles and coupling; wheels of their own say how wide the vehicle is."""
    back, front = min(x for x, _ in points), max(x for x, _ in points)
    length, track = front - back, 2 * max(abs(y) for _, y in points)
    return Outline(back - _OVERHANG * length, front + _OVERHANG * length, track or min(_WIDTH * length, _WIDEST), False)


class _Slopes:
    """Slopes of ports at straight driving, as expressions in the parameters."""

    def __init__(self, model: StateSpaceModel) -> None:
        self._model = model
        self._numbers = {symbol(n): sp.Float(0.0) for n in (*model.states, *model.inputs, *model.flags, "time")}
        speeds = [self._written_out(body.speed) for body in model.bodies.values()]
        moving = [s for s in self._numbers for speed in speeds if self._at(sp.diff(speed, s) - 1).is_zero]
        self._numbers |= dict.fromkeys(moving, sp.Float(_SPEED))

    def _at(self, expr: sp.Expr) -> sp.Expr:
        return sp.simplify(expr.subs(self._numbers).doit().evalf())

    def _written_out(self, expr: sp.Expr, keep: str = "") -> sp.Expr:
        """Write an expression without ports, but for one."""
        for name in reversed(self._model.ports):
            if name != keep and expr.has(symbol(name)):
                expr = expr.xreplace({symbol(name): self._model.ports[name]})
        return expr

    def _motion(self, body: Body) -> tuple[sp.Symbol, sp.Symbol, sp.Expr, sp.Expr] | None:
        """Return yaw rate and lateral state of a body, and by how much its lateral velocity goes with each."""
        turning, lateral = body.yaw_rate, self._written_out(body.lateral_velocity)
        if not isinstance(turning, sp.Symbol):
            return None
        for name in self._model.states:
            slope = self._at(sp.diff(lateral, symbol(name)))
            if symbol(name) != turning and not slope.is_zero:
                return turning, symbol(name), self._at(sp.diff(lateral, turning)), slope
        return None

    def ahead(self, port: str, body: str) -> sp.Expr | None:
        """Return how far ahead of the CoG a port reads the lateral velocity of a body."""
        motion = self._motion(self._model.bodies[body])
        if motion is None or port not in self._model.ports:
            return None
        turning, sliding, by_turning, by_sliding = motion
        expr = self._written_out(symbol(port))
        turns, slides = self._at(sp.diff(expr, turning)), self._at(sp.diff(expr, sliding))
        return None if slides.is_zero else sp.sympify(turns / slides * by_sliding - by_turning)

    def axle(self, port: str, body: str) -> _AxleSlopes | None:
        """Return where the slip angle of a port is measured."""
        x, motion = self.ahead(port, body), self._motion(self._model.bodies[body])
        if x is None or motion is None:
            return None
        turning, sliding, *_ = motion
        sliding_slope = sp.diff(self._written_out(symbol(port)), sliding)
        slope, mixed = self._at(sliding_slope), self._at(sp.diff(sliding_slope, turning))
        kept = self._written_out(symbol(port), keep="road_wheel_angle")
        steered = sp.diff(kept, symbol("road_wheel_angle")).subs({symbol("road_wheel_angle"): sp.Float(0.0)})
        return _AxleSlopes(body, x, sp.sympify(_SPEED * mixed / slope), self._at(steered))
