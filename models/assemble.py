"""Put a vehicle, a tyre, effects and sensors together into one ``Model``.

A vehicle states its equations through a ``Builder``. Every quantity worth changing or looking at is published
as a *port*: a named intermediate. An effect changes a port's definition and never the vehicle. Ports are
symbols until the model is complete; then they are put in order of use, and two writers, an unmet read or a
cycle is refused.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from types import ModuleType

import sympy as sp

from models import registry
from models.contracts import DRIVE_INPUTS, ModelError, Parameter
from models.signals import SIGNALS


def symbol(name: str) -> sp.Symbol:
    """Return the SymPy symbol that stands for a signal or parameter."""
    return sp.Symbol(name, real=True)


@dataclass(frozen=True, eq=False)
class Model:
    """A complete set of equations: ``dx/dt = f(x, u, p)``, or ``x(n+1) = f(x, u, p)``; ``y = h(x, u, p)``.

    Attributes:
        name: Name of the vehicle file, with the tyre.
        states: Signal names of the state vector, shape ``(nx,)``.
        inputs: Signal names of the input vector, shape ``(nu,)``.
        parameters: All parameters of vehicle, tyre and effects, shape ``(np,)``.
        ports: Named intermediates in order of use; each expression reads states, inputs, parameters and
            earlier ports only.
        derivatives: Time derivative of each state; of a discrete model its value one sample later.
        outputs: Names and expressions of what is measured.
        valid: Largest magnitude of a state for which the equations hold; beyond it a run counts as diverged.
        rates: Inputs that are time derivatives of other inputs, ``{"speed_rate": "speed"}``.
        axles: Axle names, front to rear.
        effects: Names of the effects in force, in the order they act.
        start: First value of a state that does not start at zero: a number, or the name of a parameter or of an
            input of the drive.
        discrete: Whether the equations lead from sample to sample, so that there is nothing to integrate.
    """

    name: str
    states: tuple[str, ...]
    inputs: tuple[str, ...]
    parameters: tuple[Parameter, ...]
    ports: dict[str, sp.Expr]
    derivatives: tuple[sp.Expr, ...]
    outputs: dict[str, sp.Expr]
    valid: dict[str, float]
    rates: dict[str, str] = field(default_factory=dict)
    axles: tuple[str, ...] = ()
    effects: tuple[str, ...] = ()
    start: dict[str, float | str] = field(default_factory=dict)
    discrete: bool = False

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters in the order of the parameter vector."""
        return tuple(p.name for p in self.parameters)

    def resolve(self, name: str) -> sp.Expr:
        """Return the expression of a state, input or port by name.

        Raises:
            ModelError: If the model has no such quantity (with the closest names).
        """
        if name in self.states or name in self.inputs:
            return symbol(name)
        if name in self.ports:
            return symbol(name)
        known = [*self.states, *self.inputs, *self.ports]
        raise ModelError(f"model '{self.name}' has no quantity '{name}'{registry.closest(name, known)}")

    def expand(self, expr: sp.Expr) -> sp.Expr:
        """Write an expression in states, inputs and parameters only, all ports substituted."""
        for name in reversed(self.ports):
            expr = expr.subs(symbol(name), self.ports[name])
        return expr

    def augment(self, unknown_inputs: Sequence[str]) -> Model:
        """Return the model with inputs moved into the state as random walks (Ziaukas 2.32, 2.33).

        Args:
            unknown_inputs: Inputs the estimator does not know; they are appended to the states in this order.

        Raises:
            ModelError: If one of them is not an input of the model.
        """
        for name in unknown_inputs:
            if name not in self.inputs:
                raise ModelError(f"'{name}' is not an input of '{self.name}'{registry.closest(name, self.inputs)}")
        return replace(
            self,
            states=self.states + tuple(unknown_inputs),
            inputs=tuple(i for i in self.inputs if i not in unknown_inputs),
            derivatives=self.derivatives + tuple(symbol(n) if self.discrete else sp.Integer(0) for n in unknown_inputs),
        )


class _Reader:
    """What every part of a model may do: read signals and parameters by name."""

    def __init__(self, builder: Builder, owner: str, parameters: Sequence[Parameter], suffix: str = "") -> None:
        self._builder, self._owner, self._suffix = builder, owner, suffix
        self._own = {p.name: p.name + suffix for p in parameters}

    def p(self, name: str) -> sp.Symbol:
        """Return one of the part's own parameters."""
        if name not in self._own:
            raise ModelError(
                f"{self._owner} reads parameter '{name}' it does not declare{registry.closest(name, [*self._own])}"
            )
        return symbol(self._own[name])

    def read(self, name: str) -> sp.Symbol:
        """Return a state, input, port, or vehicle parameter; checked once the model is complete."""
        self._builder.note_read(self._owner, name)
        return symbol(name)


class TyreContext(_Reader):
    """What a tyre sees of one axle: slip angle, load, friction, its parameters and its ports."""

    def __init__(
        self,
        builder: Builder,
        owner: str,
        parameters: Sequence[Parameter],
        axle: str,
        group: str,
        quantities: Mapping[str, sp.Expr],
    ) -> None:
        super().__init__(builder, owner, parameters, f"_{group}")
        self.axle = axle
        self.slip_angle = quantities["slip_angle"]
        self.vertical_load = quantities["vertical_load"]
        self.friction = quantities["friction"]

    def port(self, kind: str, expr: sp.Expr) -> sp.Symbol:
        """Publish ``<kind>_axle_<axle>``, e.g. ``cornering_stiffness_axle_11``."""
        return self._builder.port(f"{kind}_axle_{self.axle}", expr)


class EffectContext(_Reader):
    """What an effect may do: read signals, use its parameters and states, know the time."""

    def __init__(self, builder: Builder, effect: ModuleType, name: str) -> None:
        super().__init__(builder, f"effect '{name}'", effect.PARAMETERS)
        self.time = symbol("time")

    def derivative(self, state: str, expr: sp.Expr) -> None:
        """State the time derivative of one of the effect's own states."""
        self._builder.derivative(state, expr)


class Builder:
    """Collects a vehicle's equations; handed to ``equations(v)`` of a vehicle file."""

    def __init__(self, vehicle: ModuleType, tyre: ModuleType | None, effects: Mapping[str, ModuleType]) -> None:
        self.vehicle, self.tyre_file, self.effects = vehicle, tyre, dict(effects)
        self.vehicle_name = vehicle.__name__.rsplit(".", 1)[-1]
        self.states: list[str] = list(vehicle.STATES)
        self.inputs: list[str] = list(vehicle.INPUTS)
        self.parameters: dict[str, Parameter] = {p.name: p for p in vehicle.PARAMETERS}
        self.ports: dict[str, sp.Expr] = {}
        self.rates: dict[str, str] = {}
        self._derivatives: dict[str, sp.Expr] = {}
        self._next_values: dict[str, sp.Expr] = {}
        self._reads: list[tuple[str, str]] = []
        for name, effect in self.effects.items():
            self.states += [s for s in effect.STATES if s not in self.states]
            self._declare(effect.PARAMETERS, "", f"effect '{name}'")

    def _declare(self, parameters: Sequence[Parameter], suffix: str, owner: str) -> None:
        for p in parameters:
            name = p.name + suffix
            if name in self.parameters:
                raise ModelError(f"{owner} declares parameter '{name}', which exists already")
            self.parameters[name] = replace(p, name=name)

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
            raise ModelError(f"port '{name}' is not in models/signals.py{registry.closest(name, list(SIGNALS))}")
        value = sp.sympify(expr)
        for effect_name, effect in self.effects.items():
            if name in _ports_of(effect):
                context = EffectContext(self, effect, effect_name)
                value = sp.sympify(effect.apply(context, value))
        self.ports[name] = value
        return symbol(name)

    def tyre(self, axle: str, slip_angle: sp.Expr, vertical_load: sp.Expr, friction: sp.Expr) -> sp.Symbol:
        """Publish slip angle and load of an axle and return its steady lateral force by the chosen tyre."""
        if self.tyre_file is None:
            raise ModelError(f"vehicle '{self.vehicle_name}' needs a tyre")
        group = self.vehicle.AXLES[axle]
        if not any(name.endswith(f"_{group}") and name in self._tyre_names(group) for name in self.parameters):
            self._declare(self.tyre_file.PARAMETERS, f"_{group}", f"tyre of axle {axle}")
        quantities = {
            "slip_angle": self.port(f"slip_angle_axle_{axle}", slip_angle),
            "vertical_load": self.port(f"vertical_load_axle_{axle}", vertical_load),
            "friction": friction,
        }
        owner = f"tyre of axle {axle}"
        context = TyreContext(self, owner, self.tyre_file.PARAMETERS, axle, group, quantities)
        return self.port(f"steady_lateral_force_axle_{axle}", self.tyre_file.lateral_force(context))

    def _tyre_names(self, group: str) -> set[str]:
        assert self.tyre_file is not None
        return {f"{p.name}_{group}" for p in self.tyre_file.PARAMETERS}

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

    def finish(self, outputs: Mapping[str, str]) -> Model:
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
        unused = {n: e for n, e in self.effects.items() if not set(_ports_of(e)) & set(self.ports)}
        known = [*self.states, *self.inputs, *self.ports]
        output_expressions: dict[str, sp.Expr] = {}
        for name, measured in outputs.items():
            if measured not in known:
                raise ModelError(
                    f"sensor '{name}' measures '{measured}', which '{self.vehicle_name}' does not publish"
                    f"{registry.closest(measured, known)}"
                )
            output_expressions[name] = self.port(f"sensor_{name}", symbol(measured))
        unused = {n: e for n, e in unused.items() if not set(_ports_of(e)) & set(self.ports)}
        if unused:
            name, effect = next(iter(unused.items()))
            raise ModelError(
                f"effect '{name}' changes port '{_ports_of(effect)[0]}', which '{self.vehicle_name}' does not publish"
                f"{registry.closest(_ports_of(effect)[0], list(self.ports))}"
            )
        readable = {*self.states, *self.inputs, *self.ports, *self.parameters, "time"}
        for owner, name in self._reads:
            if name not in readable:
                raise ModelError(
                    f"{owner} reads '{name}', which nothing provides{registry.closest(name, sorted(readable))}"
                )
        self._check_symbols(readable)
        reads_time = any(symbol("time") in e.free_symbols for e in [*self.ports.values(), *equations.values()])
        tyre_name = "" if self.tyre_file is None else "+" + self.tyre_file.__name__.rsplit(".", 1)[-1]
        return Model(
            name=self.vehicle_name + tyre_name,
            states=tuple(self.states),
            inputs=tuple([*self.inputs, "time"] if reads_time else self.inputs),
            parameters=tuple(self.parameters.values()),
            ports=_in_order_of_use(self.ports, self.vehicle_name),
            derivatives=tuple(equations[s] for s in self.states),
            outputs=output_expressions,
            valid=dict(self.vehicle.VALID),
            rates=dict(self.rates),
            axles=tuple(self.vehicle.AXLES),
            effects=tuple(self.effects),
            start=self._start(),
            discrete=discrete,
        )

    def _start(self) -> dict[str, float | str]:
        """Return where states start, refusing a state or a source that does not exist."""
        start: dict[str, float | str] = dict(getattr(self.vehicle, "START", {}))
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


def _ports_of(effect: ModuleType) -> tuple[str, ...]:
    return (effect.PORT,) if isinstance(effect.PORT, str) else tuple(effect.PORT)


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
) -> Model:
    """Build a model from the names of its parts (or from modules that meet the same contract).

    Args:
        vehicle: File in ``models/vehicles``.
        tyre: File in ``models/tyres``; ``None`` for a vehicle without tyres.
        effects: Files in ``models/effects``, acting in this order.
        sensors: File in ``models/sensors``; ``None`` for a model without outputs.

    Raises:
        ModelError: If a part is unknown, incomplete or wired wrongly.
    """
    vehicle_file = registry.load("models.vehicles", vehicle) if isinstance(vehicle, str) else vehicle
    tyre_file = registry.load("models.tyres", tyre) if isinstance(tyre, str) else tyre
    if not isinstance(effects, Mapping):
        effects = {name: registry.load("models.effects", name) for name in effects}
    sensor_file = registry.load("models.sensors", sensors) if isinstance(sensors, str) else sensors
    builder = Builder(vehicle_file, tyre_file, effects)
    vehicle_file.equations(builder)
    return builder.finish({} if sensor_file is None else sensor_file.OUTPUTS)
