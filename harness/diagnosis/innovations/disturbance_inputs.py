"""Disturbance inputs of a model: its state equations, the forces and angles it publishes, its sensors.

The library of effects knows the inputs of the published quantities: an amplitude by which a port changes, whatever the
vehicle does, is a disturbance of that port, and its direction in the space of parameters is all that is needed.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
import sympy as sp

from harness.common.arrays import Floats
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import Hypothesis, hypotheses
from harness.models.assembly.assemble import StateSpaceModel, symbol
from harness.models.assembly.candidates import assembled
from harness.models.assembly.placement import Layout, suffix
from harness.models.assembly.plan import GroundPlan
from harness.models.roles import VEHICLES
from harness.models.signals import SIGNALS

Kind = Literal["equation", "port", "sensor"]

_COUPLING = "coupling_moment"


@dataclass(frozen=True)
class DisturbanceInput:
    """An input by which a disturbance enters a model.

    Attributes:
        name: The ports it changes, or ``d/dt`` of the state.
        kind: Equation of a state, published quantity, or sensor.
        unit: Of the disturbance.
        ports: What it changes; the state for an equation.
        parameters: Direction in the space of parameters.
        begins: Parameters that say when it begins.
        never: Parameters that say when it ends.
        shapes: Parameters that mean nothing while it is absent, with a value.
        limit: Largest magnitude that the library allows.
    """

    name: str
    kind: Kind
    unit: str
    ports: tuple[str, ...]
    parameters: Mapping[str, float] = field(default_factory=dict)
    begins: tuple[str, ...] = ()
    never: tuple[str, ...] = ()
    shapes: Mapping[str, float] = field(default_factory=dict)
    limit: float = math.inf

    def __hash__(self) -> int:
        return hash(self.name)

    def values(self, augmented: AugmentedModel, at: Floats) -> Floats:
        """Return parameters ``(np,)`` at which the input acts over the whole drive, else as they are."""
        opened = at.copy()
        for name in self.begins:
            opened[augmented.row(name)] = augmented.model.parameters[augmented.row(name)].lower
        for name in self.never:
            opened[augmented.row(name)] = augmented.model.parameters[augmented.row(name)].upper
        for name, value in self.shapes.items():
            opened[augmented.row(name)] = value
        return opened

    def direction(self, augmented: AugmentedModel) -> Floats:
        """Return the direction in the space of parameters ``(np,)``."""
        direction = np.zeros(len(augmented.names))
        for name, share in self.parameters.items():
            direction[augmented.row(name)] = share
        return direction


def disturbance_inputs_of(augmented: AugmentedModel) -> tuple[DisturbanceInput, ...]:
    """Return every disturbance input of a model: its state equations first, then what it publishes."""
    inputs = [
        DisturbanceInput(f"d/dt {s}", "equation", _per_second(SIGNALS[s].unit), (s,)) for s in augmented.nominal.states
    ]
    ports: dict[tuple[str, ...], DisturbanceInput] = {}
    for h in hypotheses(augmented, ()):
        if h.kind == "effect" and h.name in augmented.placements:
            for disturbance_input in _of_effect(augmented, h):
                ports.setdefault(disturbance_input.ports, disturbance_input)
    coupling = _coupling(augmented, ports)
    if coupling is not None:
        ports[coupling.ports] = coupling
    return (*inputs, *ports.values())


def _per_second(unit: str) -> str:
    return f"{unit}^2" if unit.endswith("/s") else f"{unit}/s"


def _of_effect(augmented: AugmentedModel, h: Hypothesis) -> list[DisturbanceInput]:
    spec = augmented.spec
    model = assembled(spec.vehicle, spec.tyre, (*spec.effects, h.name), spec.sensors)
    parameters = {p.name: p for p in model.parameters}
    inputs = []
    for name in h.amplitudes:
        ports = _changed_by(model, name)
        if ports:
            sensor = all(p.startswith("sensor_") for p in ports)
            shapes = {s: float(augmented.stated()[augmented.row(s)]) for s in h.shapes}
            inputs.append(
                DisturbanceInput(
                    _joined([p.removeprefix("sensor_") for p in ports]) if sensor else _joined(ports),
                    "sensor" if sensor else "port",
                    parameters[name].unit,
                    ports,
                    {name: 1.0},
                    h.change_times[:1],
                    h.change_times[1:],
                    shapes,
                    max(abs(parameters[name].lower), abs(parameters[name].upper)),
                )
            )
    return inputs


def _changed_by(model: StateSpaceModel, name: str) -> tuple[str, ...]:
    """Return the ports that a parameter changes; none if how much depends on what the vehicle does."""
    moving = {symbol(n) for n in (*model.states, *model.inputs, *model.ports)} - {symbol("time")}
    amplitude, ports = symbol(name), []
    for port, expr in model.ports.items():
        if amplitude in expr.free_symbols:
            slope = sp.diff(expr, amplitude)
            if slope.free_symbols & moving:
                return ()
            ports.append(port)
    return tuple(ports)


def _joined(ports: list[str] | tuple[str, ...]) -> str:
    """Return one name for several ports: what they have in common, then how they differ."""
    parts = [p.split("_") for p in ports]
    same = 0
    while same < min(map(len, parts)) and len({p[same] for p in parts}) == 1:
        same += 1
    if len(ports) == 1:
        return ports[0]
    return "_".join([*parts[0][:same], "+".join("_".join(p[same:]) for p in parts)])


def _coupling(augmented: AugmentedModel, ports: Mapping[tuple[str, ...], DisturbanceInput]) -> DisturbanceInput | None:
    """Return the moment between the first two bodies, which acts on both with opposite sign."""
    bodies = list(Layout.of(VEHICLES.load(augmented.spec.vehicle)).bodies)
    if _COUPLING not in augmented.nominal.ports or len(bodies) < 2:
        return None
    leader, follower = (ports.get((f"external_yaw_moment{suffix(body)}",)) for body in bodies[:2])
    if leader is None or follower is None:
        return None
    reaction = {name: -share for name, share in leader.parameters.items()}
    begins, never = (
        tuple(dict.fromkeys((*getattr(leader, when), *getattr(follower, when)))) for when in ("begins", "never")
    )
    parameters, limit = {**reaction, **follower.parameters}, min(leader.limit, follower.limit)
    return DisturbanceInput(_COUPLING, "port", follower.unit, (_COUPLING,), parameters, begins, never, limit=limit)


def place_of(plan: GroundPlan, disturbance_input: DisturbanceInput) -> float:
    """Return where an input acts, in m ahead of the CoG of the first body; of all bodies the middle of them."""
    return float(np.mean([place_of_port(plan, port) for port in disturbance_input.ports]))


def place_of_port(plan: GroundPlan, port: str) -> float:
    """Return where a port of a model is, in m ahead of the CoG of the first body; of all bodies the middle of them."""
    name = port.removeprefix("sensor_")
    axle = name.rpartition("_axle_")[2]
    if axle in plan.axles:
        return plan.along(axle)
    if plan.coupling is not None and name.startswith(("coupling", "articulation")):
        return plan.coupling[0]
    if name == "road_wheel_angle":
        return max(map(plan.along, plan.axles))
    body = next((b for b in plan.cogs if b and name.endswith(b)), None)
    return float(np.mean(list(plan.cogs.values()))) if body is None else plan.cogs[body]
