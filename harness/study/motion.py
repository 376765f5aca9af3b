"""The vehicle of a run over time, seen from above: poses of its bodies, angles and forces of its axles.

Poses follow from the velocities of the plant's bodies: the first one's CoG starts in the origin with heading zero, and
the other hangs on the coupling. Axes are those of ISO 8855: x forward, y left, headings counter-clockwise.
"""

from __future__ import annotations

import functools
from collections.abc import Callable, Mapping, Sequence

import numpy as np
import sympy as sp
import xarray as xr

from harness.common.arrays import Floats
from harness.models.assembly.model import StateSpaceModel
from harness.models.assembly.plan import GroundPlan
from harness.models.signals import SIGNALS

BEFORE = "_before_"
"""In the names of ports that only say what a port was without an effect."""


def published(model: StateSpaceModel) -> tuple[str, ...]:
    """Return all that a vehicle says of itself: its states, and its ports that are signals."""
    ports = (p for p in model.ports if p in SIGNALS and BEFORE not in p)
    return tuple(dict.fromkeys([*model.states, *ports]))


def lateral_signal(model: StateSpaceModel, body: str) -> str | None:
    """Return the signal that is the lateral velocity of a body's CoG; ``None`` if it follows from others."""
    velocity = model.bodies[body].lateral_velocity
    return velocity.name if isinstance(velocity, sp.Symbol) else None


def motion(
    plan: GroundPlan, model: StateSpaceModel, everything: xr.Dataset, parameters: Mapping[str, float]
) -> xr.Dataset:
    """Return how a vehicle moves, SI units.

    Args:
        plan: Where things are on it.
        model: Its equations.
        everything: What it published and its inputs, over ``time``; NaN from where it left its range.
        parameters: What it held.

    Returns:
        Dataset over ``time``, ``body`` (the first in front) and ``axle``: ``x``, ``y``, ``heading``, ``speed`` and
        ``lateral_velocity`` of the CoG of each body; of each axle ``steer``, ``slip_angle``, ``lateral_force``,
        ``vertical_load`` and ``friction_use``, the lateral force over the largest that the tyre has. NaN is what the
        vehicle does not publish.
    """
    time, bodies, axles = everything["time"].values, list(plan.outlines), list(plan.axles)
    values = {**{n: np.full(len(time), v) for n, v in parameters.items()}, "time": time}
    values |= {str(n): everything[n].values for n in everything}
    moving = {body: [_evaluated(e, values) for e in _motion_of(model, body)] for body in bodies}
    heading = {bodies[0]: _integrated(moving[bodies[0]][2], time)}
    for body in bodies[1:]:
        heading[body] = heading[bodies[0]] + values["articulation_angle"]
    first = heading[bodies[0]]
    places = {bodies[0]: path_of(moving[bodies[0]], time)}
    for body in bodies[1:]:
        assert plan.coupling is not None
        ahead, own = plan.coupling
        x, y = places[bodies[0]]
        places[body] = (
            x + ahead * np.cos(first) - own * np.cos(heading[body]),
            y + ahead * np.sin(first) - own * np.sin(heading[body]),
        )
    nothing = np.full(len(time), np.nan)

    def of_axles(*stems: str) -> Floats:
        names = ([f"{stem}_axle_{axle}" for stem in stems] + [f"{stems[0]}_{axle}"] for axle in axles)
        return np.array([next((values[n] for n in tried if n in values), nothing) for tried in names]).T

    turned, force = values.get("road_wheel_angle", nothing), of_axles("lateral_force", "steady_lateral_force")
    of_body = {
        "x": [places[b][0] for b in bodies],
        "y": [places[b][1] for b in bodies],
        "heading": [heading[b] for b in bodies],
        "speed": [moving[b][0] for b in bodies],
        "lateral_velocity": [moving[b][1] for b in bodies],
    }
    capacity = of_axles("lateral_force_capacity")
    of_axle = {
        "steer": np.array([plan.axles[a].steered * turned if plan.axles[a].steered else 0 * time for a in axles]).T,
        "slip_angle": of_axles("slip_angle"),
        "lateral_force": force,
        "vertical_load": of_axles("vertical_load"),
        "friction_use": np.abs(force) / np.where(capacity > 0, capacity, np.nan),
    }
    units = {"x": "m", "y": "m", "heading": "rad", "speed": "m/s", "lateral_velocity": "m/s", "steer": "rad",
             "slip_angle": "rad", "lateral_force": "N", "vertical_load": "N", "friction_use": "1"}  # fmt: skip
    return xr.Dataset(
        {n: (("time", "body"), np.array(v).T, {"units": units[n]}) for n, v in of_body.items()}
        | {n: (("time", "axle"), v, {"units": units[n]}) for n, v in of_axle.items()},
        coords={"time": everything["time"], "body": bodies, "axle": axles},
    )


def dead_reckoned(
    model: StateSpaceModel, held: Mapping[str, Mapping[str, Floats]], time: Floats
) -> dict[str, tuple[Floats, Floats]]:
    """Return the path that the estimated motion of the first body's CoG adds up to, from the origin with heading zero.

    Args:
        model: The belief.
        held: By estimator its states, inputs and parameters over ``time`` or as numbers, SI.
        time: Seconds.

    Returns:
        ``x`` and ``y`` in m by estimator; without those whose states do not say how the body moves.
    """
    if not held or not model.bodies:
        return {}
    available = set.intersection(*(set(h) for h in held.values()))
    paths = {}
    for name, values in held.items():
        moving = velocities(model, next(iter(model.bodies)), {n: values[n] for n in available})
        if moving is None:
            return {}
        path = path_of([np.broadcast_to(v, time.shape) for v in moving], time)
        if np.isfinite(path[0]).sum() > 1:
            paths[name] = path
    return paths


def velocities(model: StateSpaceModel, body: str, values: Mapping[str, Floats]) -> tuple[Floats, Floats, Floats] | None:
    """Return forward and lateral velocity of a body's CoG and its yaw rate, SI; ``None`` if the values do not say them.

    Args:
        model: The equations.
        body: One of its bodies.
        values: States, inputs and parameters over time or as numbers.
    """
    moves = [_expanded(e, model, set(values)) for e in _motion_of(model, body)]
    forward, lateral, rate = (None if e is None else _evaluated(e, values) for e in moves)
    return None if forward is None or lateral is None or rate is None else (forward, lateral, rate)


def path_of(moving: Sequence[Floats], time: Floats) -> tuple[Floats, Floats]:
    """Return the path ``x`` and ``y`` in m from the origin with heading zero, of ``velocities`` over time."""
    forward, lateral, rate = moving
    heading = _integrated(rate, time)
    return (
        _integrated(forward * np.cos(heading) - lateral * np.sin(heading), time),
        _integrated(forward * np.sin(heading) + lateral * np.cos(heading), time),
    )


def _expanded(expr: sp.Expr, model: StateSpaceModel, names: set[str]) -> sp.Expr | None:
    """Return an expression in what is known, ports written out; ``None`` if it needs more."""
    expanded = sp.sympify(expr)
    for _ in range(len(model.ports) + 1):
        unknown = [s for s in expanded.free_symbols if str(s) not in names]
        if not unknown:
            return expanded
        if any(str(s) not in model.ports for s in unknown):
            return None
        expanded = expanded.subs({s: model.ports[str(s)] for s in unknown})
    return None


def _motion_of(model: StateSpaceModel, body: str) -> tuple[sp.Expr, sp.Expr, sp.Expr]:
    moves = model.bodies[body]
    return moves.speed, moves.lateral_velocity, moves.yaw_rate


def _evaluated(expr: sp.Expr, values: Mapping[str, Floats]) -> Floats:
    symbols = sorted(sp.sympify(expr).free_symbols, key=str)
    evaluated: Floats = _function(tuple(symbols), expr)(*(values[str(s)] for s in symbols))
    return evaluated


@functools.lru_cache(64)
def _function(symbols: tuple[sp.Symbol, ...], expr: sp.Expr) -> Callable[..., Floats]:
    function: Callable[..., Floats] = sp.lambdify(symbols, expr, "numpy")
    return function


def _integrated(rate: Floats, time: Floats) -> Floats:
    """Return the integral from the first sample on by trapezoids."""
    return np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(time))])
