"""Put a vehicle, a tyre, effects and sensors together into one ``StateSpaceModel``.

A vehicle states its equations through a ``Builder``. Every quantity worth changing or looking at is published
as a *port*: a named intermediate. An effect changes a port's definition and never the vehicle. Ports are
symbols until the model is complete; then they are put in order of use, and two writers, an unmet read or a
cycle is refused.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from types import ModuleType

import sympy as sp

from harness.common import components, registry
from harness.common.errors import ModelError
from harness.models.assembly.algebraic_loops import solve_loops
from harness.models.assembly.contexts import EffectContext, TyreContext
from harness.models.assembly.degradation import apart, with_degradations
from harness.models.assembly.expressions import any_of, present
from harness.models.assembly.model import Body, StateSpaceModel, symbol
from harness.models.assembly.placement import (
    Layout,
    Site,
    parameter_at,
    place_of,
    ports_of,
    sites,
    split,
    suffix,
)
from harness.models.contracts import DRIVE_INPUTS, Parameter
from harness.models.roles import SENSORS, TYRES, VEHICLES
from harness.models.signals import SIGNALS

__all__ = ["Body", "Builder", "EffectContext", "StateSpaceModel", "TyreContext", "assemble", "symbol"]


class Builder:
    """Collects a vehicle's equations; handed to ``equations(v)`` of a vehicle file."""

    def __init__(
        self, vehicle: ModuleType, tyre: ModuleType | None, effects: Mapping[str, ModuleType], optional: bool = False
    ) -> None:
        self.optional = optional
        self.flags: dict[str, tuple[str, ...]] = {}
        self._named: set[str] = set()
        self.vehicle, self.tyre_file, self.effects = vehicle, tyre, dict(effects)
        self.vehicle_name = components.name_of(vehicle)
        for part in (vehicle, tyre, *effects.values()):
            if part is not None:
                SIGNALS.learn(part)
        self.states: list[str] = list(vehicle.STATES)
        self.inputs: list[str] = list(vehicle.INPUTS)
        self.parameters: dict[str, Parameter] = {p.name: p for p in vehicle.PARAMETERS}
        self.ports: dict[str, sp.Expr] = {}
        self.rates: dict[str, str] = {}
        self.otherwise: dict[str, float] = {}
        self.layout = Layout.of(vehicle)
        self._bodies: dict[str, Body] = {}
        self._places: dict[str, list[str]] = {name: [] for name in self.effects}
        self._shared: dict[str, ModuleType] = {}
        self.noise: dict[str, float] = {}
        self.start_variance: dict[str, float] = dict(getattr(vehicle, "START_VARIANCE", {}))
        self._own_states: dict[str, str] = {}
        self._own_starts: dict[str, float | str] = {}
        self._derivatives: dict[str, sp.Expr] = {}
        self._next_values: dict[str, sp.Expr] = {}
        self._reads: list[tuple[str, str]] = []
        self._loops: list[str] = []
        for name, effect in self.effects.items():
            if not place_of(effect):
                self._enter_place(name, "")
                for state in effect.STATES:
                    self.own_state(f"effect '{name}'", state)

    def _declare(self, parameter: Parameter, owner: str) -> None:
        if parameter.name in self.parameters:
            raise ModelError(f"{owner} declares parameter '{parameter.name}', which exists already")
        self.parameters[parameter.name] = parameter

    def _enter_place(self, name: str, place: str) -> None:
        """Declare an effect's parameters at a place on its first site there."""
        effect, first = self.effects[name], place not in self._places[name]
        for p in effect.PARAMETERS:
            declared = parameter_at(p, place)
            if first and self._shared.get(declared.name) is not effect:
                self._declare(declared, f"effect '{name}'")
                if p.shared:
                    self._shared[declared.name] = effect
        if first:
            self._places[name].append(place)
            for variances, export in ((self.noise, "NOISE"), (self.start_variance, "START_VARIANCE")):
                variances |= {stem + suffix(place): value for stem, value in getattr(effect, export, {}).items()}

    def own_state(self, owner: str, name: str, start: float | str | None = None) -> sp.Symbol:
        """Add a state of an effect, or return it if that effect has it; ``start`` as in ``StateSpaceModel.start``."""
        if self._own_states.setdefault(name, owner) != owner or name in self.vehicle.STATES:
            raise ModelError(f"{owner} has a state '{name}', which exists already")
        if name not in self.states:
            self.states.append(name)
        if start is not None:
            self._own_starts[name] = start
        return symbol(name)

    def own_derivative(self, name: str, expr: sp.Expr) -> None:
        """State the derivative of an effect's state; sites that share the state may state the same again."""
        if self._derivatives.get(name) != sp.sympify(expr):
            self.derivative(name, expr)

    def own_loop(self, name: str, expr: sp.Expr) -> sp.Symbol:
        """Publish a quantity of an effect whose definition may lead back to it."""
        self._loops.append(name)
        return self.port(name, expr)

    def add_input(self, name: str, otherwise: float | None = None) -> sp.Symbol:
        """Add an input that an effect needs, or return it if the model has it already."""
        if name not in self.inputs:
            self.inputs.append(name)
            if otherwise is not None:
                self.otherwise[name] = otherwise
        return symbol(name)

    def body(self, name: str, body: Body) -> None:
        """Describe a body to the effects; before the first port of it is published."""
        self._bodies[name] = body

    def body_named(self, name: str, owner: str) -> Body:
        """Return a body by name for an effect."""
        if name not in self._bodies:
            raise ModelError(f"{owner} needs to know how a body moves, which '{self.vehicle_name}' does not say")
        return self._bodies[name]

    def note_read(self, owner: str, name: str) -> None:
        """Remember that ``owner`` reads ``name``; checked when the model is complete."""
        self._reads.append((owner, name))

    def p(self, name: str) -> sp.Symbol:
        """Return a vehicle parameter."""
        if name not in self.parameters:
            raise ModelError(f"vehicle '{self.vehicle_name}' reads undeclared parameter '{name}'")
        return symbol(name)

    def state(self, name: str) -> sp.Symbol:
        """Return a state."""
        if name not in self.states:
            raise ModelError(f"vehicle '{self.vehicle_name}' reads undeclared state '{name}'")
        return symbol(name)

    def input(self, name: str) -> sp.Symbol:
        """Return an input."""
        if name not in self.inputs:
            raise ModelError(f"vehicle '{self.vehicle_name}' reads undeclared input '{name}'")
        return symbol(name)

    def rate(self, name: str) -> sp.Symbol:
        """Return the time derivative of an input; the harness derives it from the samples."""
        derived = f"{name}_rate"
        if derived not in self.inputs:
            self.inputs.append(derived)
            self.rates[derived] = name
        return symbol(derived)

    def port(self, name: str, expr: sp.Expr | float) -> sp.Symbol:
        """Publish a named quantity and return its symbol; effects on this port act here, in order.

        Raises:
            ModelError: If the name is taken (two writers) or not in the table of signals.
        """
        if name in self.ports or name in self.states or name in self.inputs:
            raise ModelError(f"'{name}' has two writers in '{self.vehicle_name}'")
        if name not in SIGNALS and not name.startswith("sensor_"):
            raise ModelError(
                f"port '{name}' is no known signal (models/signals.py, or SIGNALS of the file)"
                f"{registry.closest(name, list(SIGNALS))}"
            )
        value = sp.sympify(expr)
        for effect_name, effect in self.effects.items():
            for site in sites(effect, name, self.layout):
                value = self._changed(effect_name, effect, site, value)
        self.ports[name] = value
        return symbol(name)

    def _changed(self, name: str, effect: ModuleType, site: Site, value: sp.Expr) -> sp.Expr:
        """Return the port's value with an effect, which may be meant for other places only."""
        only = split(name)[1]
        if only is not None and only != site.place:
            return value
        names = {p.name: parameter_at(p, site.place).name for p in effect.PARAMETERS}
        amplitudes = tuple(names[p.name] for p in effect.PARAMETERS if p.neutral is not None)
        flag = symbol(f"has_{split(name)[0]}{site.suffix}") if self.optional and amplitudes else None
        before, base = f"{site.port}_before_{split(name)[0]}", value
        if flag is not None and not value.is_Atom:  # named, because it is read twice, and again by the next effect
            self.ports[before], base = value, symbol(before)
        changed = sp.sympify(effect.apply(EffectContext(self, name, names, site, flag), base))
        if changed is base:  # the effect has nothing to do here, and no place of its own
            self.ports.pop(before, None)
            return value
        self._enter_place(name, site.place)
        if flag is None:
            return changed
        if base is not value:
            self._named.add(before)
        self.flags[flag.name] = amplitudes
        return present(flag, changed, base)

    def tyre(
        self,
        axle: str,
        slip_angle: sp.Expr,
        vertical_load: sp.Expr,
        friction: sp.Expr,
        inclination: sp.Expr = sp.S.Zero,
    ) -> sp.Symbol:
        """Publish slip angle and load of an axle and return its steady lateral force by the chosen tyre.

        Args:
            axle: Of ``AXLES``.
            slip_angle: rad, positive when it makes a force to the left.
            vertical_load: N.
            friction: Of the road.
            inclination: Camber in rad, positive when the wheels lean to the right.
        """
        if self.tyre_file is None:
            raise ModelError(f"vehicle '{self.vehicle_name}' needs a tyre")
        group = self.vehicle.AXLES[axle]
        declared = [replace(p, name=f"{p.name}_{group}") for p in self.tyre_file.PARAMETERS]
        first = not any(p.name in self.parameters for p in declared)
        for p in declared if first else ():
            self._declare(p, f"tyre of axle {axle}")
        before = len(self.ports)
        quantities = {
            "slip_angle": self.port(f"slip_angle_axle_{axle}", slip_angle),
            "vertical_load": self.port(f"vertical_load_axle_{axle}", vertical_load),
            "friction": friction,
            "inclination": inclination,
        }
        context = TyreContext(self, self.tyre_file.PARAMETERS, axle, group, quantities)
        force = self.port(f"steady_lateral_force_axle_{axle}", self.tyre_file.lateral_force(context))
        if first:  # a tyre on a vehicle without camber has no parameters of camber
            read = set().union(*(expr.free_symbols for expr in list(self.ports.values())[before:]))
            for p in declared:
                if symbol(p.name) not in read:
                    del self.parameters[p.name]
        return force

    def derivative(self, state: str, expr: sp.Expr) -> None:
        """State the time derivative of a state."""
        self._state_equation(self._derivatives, "derivative", state, expr)

    def next_value(self, state: str, expr: sp.Expr) -> None:
        """State the value of a state one sample later, in a vehicle given by difference equations ``x(n+1) = ...``."""
        self._state_equation(self._next_values, "next value", state, expr)

    def _state_equation(self, equations: dict[str, sp.Expr], kind: str, state: str, expr: sp.Expr) -> None:
        if state not in self.states:
            raise ModelError(f"'{state}' is not a state of '{self.vehicle_name}'")
        if state in equations:
            raise ModelError(f"the {kind} of '{state}' has two writers in '{self.vehicle_name}'")
        equations[state] = sp.sympify(expr)
        if self._derivatives and self._next_values:
            raise ModelError(
                f"'{self.vehicle_name}' has a derivative for '{next(iter(self._derivatives))}' and a next value for "
                f"'{next(iter(self._next_values))}'; state all of a model by one of the two"
            )

    def finish(self, outputs: Mapping[str, str]) -> StateSpaceModel:
        """Add the sensors, check the wiring and return the model.

        Args:
            outputs: Output name to the signal it measures.
        """
        discrete = bool(self._next_values)
        equations = self._next_values if discrete else self._derivatives
        missing = [s for s in self.states if s not in equations]
        if missing:
            kind = "next value" if discrete else "derivative"
            raise ModelError(f"'{self.vehicle_name}': no {kind} for {', '.join(missing)}")
        sideslip = {f"sideslip_angle{suffix(name)}": body.sideslip_angle for name, body in self._bodies.items()}
        further = {n: e for n, e in sideslip.items() if n not in self.states and n not in self.ports}
        for measured in outputs.values():
            if measured in further:
                self.port(measured, further.pop(measured))
        names = [*self.states, *self.inputs, *self.ports, *further]
        output_expressions: dict[str, sp.Expr] = {}
        for name, measured in outputs.items():
            if measured not in names:
                raise ModelError(
                    f"sensor '{name}' measures '{measured}', which '{self.vehicle_name}' does not publish"
                    f"{registry.closest(measured, names)}"
                )
            output_expressions[name] = self.port(f"sensor_{name}", symbol(measured))
        self._check_effects_act()
        readable = {*self.states, *self.inputs, *self.ports, *self.parameters, *self.flags, "time"}
        for owner, name in self._reads:
            if name not in readable:
                raise ModelError(
                    f"{owner} reads '{name}', which nothing provides{registry.closest(name, sorted(readable))}"
                )
        self._check_symbols(readable)
        solved = solve_loops(self.ports, self._loops)
        self.ports |= {name: expr for steps in solved for name, expr in steps.items()}
        reads_time = any(symbol("time") in e.free_symbols for e in [*self.ports.values(), *equations.values()])
        tyre_name = "" if self.tyre_file is None else "+" + components.name_of(self.tyre_file)
        return StateSpaceModel(
            name=self.vehicle_name + tyre_name,
            states=tuple(self.states),
            inputs=tuple([*self.inputs, "time"] if reads_time else self.inputs),
            parameters=tuple(self.parameters.values()),
            ports=self._optional(_in_order_of_use(self.ports, self.vehicle_name), set().union(*solved)),
            derivatives=tuple(equations[s] for s in self.states),
            outputs=output_expressions,
            valid=dict(self.vehicle.VALID),
            rates=dict(self.rates),
            otherwise=dict(self.otherwise),
            axles=tuple(self.vehicle.AXLES),
            effects=tuple(self.effects),
            start=self._start(),
            start_variance=dict(self.start_variance),
            discrete=discrete,
            noise=dict(self.noise),
            flags=dict(self.flags),
            solved=tuple(map(tuple, solved)),
            bodies=dict(self._bodies),
            further=further,
        )

    def _optional(self, ports: dict[str, sp.Expr], solved: Collection[str]) -> dict[str, sp.Expr]:
        """Let ports that only effects make vary, such as an axle's load, be the constants they are without them."""
        if not self.flags:
            return ports
        parameters = {symbol(n) for n in self.parameters}
        fixed: dict[sp.Symbol, sp.Expr] = {}
        flags: dict[sp.Symbol, set[sp.Symbol]] = {}
        guarded = dict(ports)
        for name, expr in ports.items():
            if name in solved:  # read where its effect is there
                continue
            own = {c.args[0] for c in expr.atoms(present)}
            flags[symbol(name)] = own.union(*(flags.get(s, set()) for s in expr.free_symbols))
            without = expr.replace(present, lambda flag, with_effect, without: without).xreplace(fixed)
            if without.free_symbols <= parameters:
                fixed[symbol(name)] = without
                if flags[symbol(name)] and name not in self._named:
                    guarded[name] = present(any_of(flags[symbol(name)]), expr, without)
        return guarded

    def _check_effects_act(self) -> None:
        """Refuse an effect whose port is not published, or whose place does not exist."""
        for name, effect in self.effects.items():
            published = {site.place for port in self.ports for site in sites(effect, port, self.layout)}
            file, only = split(name)
            if not published:
                port = ports_of(effect)[0]
                raise ModelError(
                    f"effect '{name}' changes port '{port}', which '{self.vehicle_name}' does not publish"
                    f"{registry.closest(port, list(self.ports))}"
                )
            if only is not None and only not in published:
                raise ModelError(
                    f"effect '{file}' has no place '{only}' on '{self.vehicle_name}'"
                    f"{registry.closest(only, sorted(published))}"
                )
            if not self._places[name]:
                raise ModelError(f"effect '{name}' has nothing to act on in '{self.vehicle_name}'")

    def _start(self) -> dict[str, float | str]:
        """Return where states start, refusing a state or a source that does not exist."""
        start: dict[str, float | str] = {**getattr(self.vehicle, "START", {}), **self._own_starts}
        sources = [*self.parameters, *DRIVE_INPUTS]
        for state, source in start.items():
            if state not in self.states:
                raise ModelError(
                    f"START of '{self.vehicle_name}' names '{state}', which is no state"
                    f"{registry.closest(state, self.states)}"
                )
            if isinstance(source, str) and source not in sources:
                raise ModelError(
                    f"START of '{self.vehicle_name}': '{state}' starts at '{source}', which is neither a parameter "
                    f"nor an input of a drive{registry.closest(source, sources)}"
                )
        return start

    def _check_symbols(self, readable: set[str]) -> None:
        """Refuse an equation over a symbol that no part provides (one written without ``p``, ``state``, ...)."""
        equations = {**self.ports, **{f"d/dt {s}": e for s, e in self._derivatives.items()}}
        equations |= {f"next {s}": e for s, e in self._next_values.items()}
        for equation, expr in equations.items():
            for name in sorted(s.name for s in expr.free_symbols if s != symbol(s.name) or s.name not in readable):
                raise ModelError(
                    f"'{self.vehicle_name}': the equation of '{equation}' reads '{name}', which nothing provides"
                    f"{registry.closest(name, sorted(readable))}"
                )


def _in_order_of_use(ports: dict[str, sp.Expr], vehicle: str) -> dict[str, sp.Expr]:
    """Sort ports so that each reads earlier ones only; refuse a cycle, naming it."""
    reads = {name: [s.name for s in expr.free_symbols if s.name in ports] for name, expr in ports.items()}
    ordered: dict[str, sp.Expr] = {}
    visiting: list[str] = []

    def visit(name: str) -> None:
        if name in ordered:
            return
        if name in visiting:
            cycle = " -> ".join([*visiting[visiting.index(name) :], name])
            raise ModelError(f"'{vehicle}': ports read each other in a cycle: {cycle}")
        visiting.append(name)
        for other in sorted(reads[name]):
            visit(other)
        visiting.pop()
        ordered[name] = ports[name]

    for name in ports:
        visit(name)
    return ordered


def assemble(
    vehicle: str | ModuleType,
    tyre: str | ModuleType | None = None,
    effects: Sequence[str] | Mapping[str, ModuleType] = (),
    sensors: str | ModuleType | None = None,
    optional: bool = False,
) -> StateSpaceModel:
    """Build a model from the names of its parts (or from modules that meet the same contract).

    Args:
        vehicle: Name of a vehicle.
        tyre: Name of a tyre; ``None`` for a vehicle without tyres.
        effects: Names of effects, in the order they act; ``crosswind@trailer`` acts at one place only.
        sensors: Name of a set of sensors; ``None`` for a model without outputs.
        optional: Whether kernels shall skip effects that are neutral, at the price of a flag each. For a model in which
            effects are searched for.

    Raises:
        ModelError: If a part is unknown, incomplete or wired wrongly.
    """
    vehicle_file = VEHICLES.load(vehicle) if isinstance(vehicle, str) else vehicle
    tyre_file = TYRES.load(tyre) if isinstance(tyre, str) else tyre
    sensor_file = SENSORS.load(sensors) if isinstance(sensors, str) else sensors
    if sensor_file is not None:
        SIGNALS.learn(sensor_file)
    acting, degradations = apart(effects)
    builder = Builder(vehicle_file, tyre_file, acting, optional)
    vehicle_file.equations(builder)
    return with_degradations(builder.finish({} if sensor_file is None else sensor_file.OUTPUTS), degradations)
