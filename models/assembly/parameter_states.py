"""Parameters as states: what an estimator does not know of its model, in addition to what it wants to know.

A parameter ``p`` that is believed to be ``p_0`` at first becomes a state ``z`` that stands still or walks at random
(Jazwinski 1970, ch. 8): ``p = p_0 exp(z)`` for a quantity that cannot be negative, ``p = p_0 + z`` for any other. The
equations read it within the bounds of the parameter only. A quantity of the load moves all parameters that follow from
it. As everything else is derived from the equations, so are the Jacobians to these states.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from math import log
from types import ModuleType

import sympy as sp

from harness.common.errors import ModelError
from harness.models.assembly.expressions import larger, smaller
from harness.models.assembly.model import StateSpaceModel, symbol
from harness.models.contracts import Parameter
from harness.models.signals import SIGNALS, Signal

MARGIN = 1e-6
"""Share of the distance of its bounds by which an estimate stays inside them: at a bound no slope leads back."""

REPORT_UNITS = {"kg": "t", "rad": "deg", "N": "kN", "rad/s": "deg/s"}


@dataclass(frozen=True)
class ParameterState:
    """A parameter, or a quantity of the load, that an estimator holds for uncertain.

    Attributes:
        name: Of the parameter.
        believed: Value it is believed to have, SI.
        prior: Standard deviation with which that is known, SI.
        walk: Standard deviation of its random walk after a second, SI; 0 for a constant.
        considered: Whether its uncertainty is reckoned with and its value left alone (Schmidt 1966).
        logarithmic: Whether its state is a logarithm.
    """

    name: str
    believed: float
    prior: float
    walk: float = 0.0
    considered: bool = False
    logarithmic: bool = True

    @property
    def state(self) -> str:
        """Name of its state."""
        return f"{'log' if self.logarithmic else 'shift'}_{self.name}"

    @property
    def _scale(self) -> float:
        return self.believed if self.logarithmic else 1.0

    @property
    def first_variance(self) -> float:
        """Variance of the state at first; of a logarithm to first order."""
        return (self.prior / self._scale) ** 2

    @property
    def walk_variance(self) -> float:
        """Variance per second that the walk adds to the state."""
        return (self.walk / self._scale) ** 2

    def true_state(self, true: float, believed: float) -> float:
        """Return the state at which the parameter has a true value, for an estimator that believes another."""
        if not self.logarithmic:
            return true - believed
        return log(true / believed) if true > 0 else float("nan")


def is_logarithmic(parameter: Parameter) -> bool:
    """Return whether a parameter is a quantity that cannot be negative."""
    return parameter.lower >= 0


def with_parameters(model: StateSpaceModel, states: Sequence[ParameterState], vehicle: ModuleType) -> StateSpaceModel:
    """Return a model with parameters, or quantities of the load, moved into the state.

    Args:
        model: The model, its unknown inputs among the states already.
        states: What is appended to the states, in this order.
        vehicle: File of the vehicle, which says what follows from its load.

    Raises:
        ModelError: If one of them is no parameter, follows from the load or cannot be estimated.
    """
    load = {p.name: p for p in getattr(vehicle, "LOADING", ())}
    declared = {p.name: p for p in model.parameters} | load
    believed: dict[str, sp.Expr] = {p.name: symbol(p.name) for p in model.parameters}
    if load:
        believed |= vehicle.loading(believed)
    now: dict[str, sp.Expr] = {}
    within: dict[str, sp.Expr] = {}
    for s in states:
        now[s.name] = _value(s, believed[s.name], _inside(s, declared[s.name], believed[s.name]))
        within[s.state] = _inside(s, declared[s.name], believed[s.name], MARGIN)
    changed = {symbol(f"{name}_now"): value for name, value in now.items()}
    follows = {}
    if any(name in load for name in now):
        loads = {name: symbol(f"{name}_now") if name in now else believed[name] for name in load}
        follows = vehicle.loaded({n: believed[n] for n in model.parameter_names}, loads)
        for name, value in follows.items():
            if name in now:
                raise ModelError(f"'{name}' follows from the load, which is uncertain as well; leave one of them out")
            changed[symbol(f"{name}_now")] = value
    names = [*now, *follows]
    instead = {symbol(n): symbol(f"{n}_now") for n in names if n not in load}
    for name in names:
        _announce(declared[name])
    for s in states:
        _announce_state(s, declared[s.name])
    ports = {str(port): value for port, value in changed.items()}
    return replace(
        model,
        states=model.states + tuple(s.state for s in states),
        ports=ports | {name: expr.xreplace(instead) for name, expr in model.ports.items()},
        derivatives=(
            *(expr.xreplace(instead) for expr in model.derivatives),
            *(symbol(s.state) if model.discrete else sp.Integer(0) for s in states),
        ),
        outputs={name: expr.xreplace(instead) for name, expr in model.outputs.items()},
        further={name: expr.xreplace(instead) for name, expr in model.further.items()},
        start_variance=model.start_variance | {s.state: s.first_variance for s in states},
        estimated={name: f"{name}_now" for name in names},
        within=within,
        considered=tuple(s.state for s in states if s.considered),
        relative=tuple(s.state for s in states if s.logarithmic),
    )


def _inside(s: ParameterState, parameter: Parameter, believed: sp.Expr, margin: float = 0.0) -> sp.Expr:
    """Return the state within the bounds of its parameter, narrowed by a margin of their distance."""
    away = margin * (parameter.upper - parameter.lower)
    if s.logarithmic:
        inside = smaller(symbol(s.state), sp.log((parameter.upper - away) / believed))
        lower = parameter.lower + away
        return larger(inside, sp.log(lower / believed)) if lower > 0 else inside
    inside = smaller(symbol(s.state), parameter.upper - away - believed)
    return larger(inside, parameter.lower + away - believed)


def _value(s: ParameterState, believed: sp.Expr, z: sp.Expr) -> sp.Expr:
    return believed * sp.exp(z) if s.logarithmic else believed + z


def _announce(parameter: Parameter) -> None:
    """Let a parameter be a signal like any other."""
    unit = "1" if parameter.unit in ("", "dimensionless") else parameter.unit
    shown = REPORT_UNITS.get(unit, unit)
    SIGNALS.add(Signal(parameter.name, parameter.symbol, unit, shown, "", parameter.meaning))


def _announce_state(s: ParameterState, parameter: Parameter) -> None:
    if s.logarithmic:
        row = Signal(
            s.state, rf"\ln({parameter.symbol})", "1", "1", "", f"logarithm of {s.name} over what is believed at first"
        )
    else:
        unit = "1" if parameter.unit in ("", "dimensionless") else parameter.unit
        shown = REPORT_UNITS.get(unit, unit)
        row = Signal(
            s.state, rf"\Delta {parameter.symbol}", unit, shown, "", f"{s.name} less what is believed at first"
        )
    SIGNALS.add(row)


def true_states(
    states: Sequence[ParameterState], true: Mapping[str, float], believed: Mapping[str, float]
) -> dict[str, float]:
    """Return where the states of parameters would be right, by state; NaN where there is no such parameter."""
    return {
        s.state: s.true_state(true[s.name], believed[s.name]) if s.name in true and s.name in believed else float("nan")
        for s in states
    }
