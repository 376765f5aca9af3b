"""A complete set of equations, and the symbols it is written in."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import sympy as sp

from harness.common import registry
from harness.common.errors import ModelError
from harness.models.assembly.expressions import larger
from harness.models.contracts import Parameter

SLIDING = math.pi / 4
"""Slip angle in rad beyond which a wheel moves more sideways than it rolls.

Tyres are measured to 15 to 20 degrees and keep their largest force up to there, so a vehicle at its friction limit
stays well below; one that spins or jackknifes passes this angle on its way to 90 degrees, whatever its tyres are.
"""

LOWEST_SPEED = 0.3
"""m/s at least, of which a sideslip angle is, so that a standstill stays finite."""


def symbol(name: str) -> sp.Symbol:
    """Return the SymPy symbol that stands for a signal or parameter."""
    return sp.Symbol(name, real=True)


@dataclass(frozen=True)
class Body:
    """How a rigid body moves, which effects may ask; all expressions in SI.

    Attributes:
        speed: Longitudinal velocity of the CoG in m/s.
        lateral_velocity: Lateral velocity of the CoG in m/s.
        yaw_rate: rad/s.
        mass: kg; ``None`` where the vehicle's equations have none.
        wheelbase: m, between the points that carry the body.
    """

    speed: sp.Expr
    lateral_velocity: sp.Expr
    yaw_rate: sp.Expr
    mass: sp.Expr | None
    wheelbase: sp.Expr

    @property
    def centripetal_acceleration(self) -> sp.Expr:
        """Yaw rate times speed in m/s^2: the lateral acceleration of quasi-steady driving, known without any force."""
        return self.yaw_rate * self.speed

    @property
    def sideslip_angle(self) -> sp.Expr:
        """Direction of motion of the CoG in rad, left of the x axis (ISO 8855)."""
        return sp.atan(self.lateral_velocity / larger(self.speed, LOWEST_SPEED))


@dataclass(frozen=True, eq=False)
class StateSpaceModel:
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
        valid: Largest magnitude of a state for which the equations hold; a vehicle beyond it is out of control, an
            estimate beyond it has diverged.
        rates: Inputs that are time derivatives of other inputs, ``{"speed_rate": "speed"}``.
        otherwise: Value of an effect's input in a simulated drive that does not state it.
        axles: Axle names, front to rear.
        effects: Names of the effects in force, in the order they act.
        start: First value of a state that does not start at zero: a number, or the name of a parameter or of an
            input of the drive.
        start_variance: Variance of a first state that an estimator begins with, where it is not the process noise.
        discrete: Whether the equations lead from sample to sample, so that there is nothing to integrate.
        noise: Variance per second of the process noise that a state of an effect has by its definition.
        flags: Of a model whose effects may be absent (``harness.models.assembly.expressions.present``): a flag for each
            effect and place, which is set if one of these parameters is not at its neutral value.
        solved: Ports of each algebraic loop that solve it, step by step.
        estimated: Port that holds the present value of a parameter that is a state, or follows from one.
        within: States of parameters, which are the last ones, each brought within the bounds of its parameter.
        considered: Those of them whose uncertainty is reckoned with and whose value is left alone.
        relative: Those of them that are logarithms.
        bodies: How each body moves, as far as the vehicle says it.
        further: What follows from states and ports and is computed only where it is asked for, by signal: the sideslip
            angle of each body that has no state or port for it.
        opaque: Whether its equations are not known, because it is a plant of somebody else.
        degradations: What degrades which output, in the order they act; of a simulated drive only.
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
    otherwise: dict[str, float] = field(default_factory=dict)
    axles: tuple[str, ...] = ()
    effects: tuple[str, ...] = ()
    start: dict[str, float | str] = field(default_factory=dict)
    start_variance: dict[str, float] = field(default_factory=dict)
    discrete: bool = False
    noise: dict[str, float] = field(default_factory=dict)
    flags: dict[str, tuple[str, ...]] = field(default_factory=dict)
    solved: tuple[tuple[str, ...], ...] = ()
    estimated: dict[str, str] = field(default_factory=dict)
    within: dict[str, sp.Expr] = field(default_factory=dict)
    considered: tuple[str, ...] = ()
    relative: tuple[str, ...] = ()
    bodies: dict[str, Body] = field(default_factory=dict)
    further: dict[str, sp.Expr] = field(default_factory=dict)
    opaque: bool = False
    degradations: tuple[tuple[str, str], ...] = ()

    @property
    def parameter_names(self) -> tuple[str, ...]:
        """Names of the parameters in the order of the parameter vector."""
        return tuple(p.name for p in self.parameters)

    @property
    def limits(self) -> np.ndarray:
        """Largest magnitude of each state for which the equations hold ``(nx,)``, infinite where they always do."""
        return np.array([self.valid.get(name, np.inf) for name in self.states])

    @property
    def largest_slip_angles(self) -> dict[str, float]:
        """Largest slip angle in rad of each axle of a vehicle under control, by its port; see ``SLIDING``."""
        ports = (p for p in self.ports if p.startswith("slip_angle_") and "_before_" not in p)
        return dict.fromkeys(ports, SLIDING)

    @property
    def published(self) -> tuple[str, ...]:
        """Names of states, inputs, ports and what follows from them."""
        return (*self.states, *self.inputs, *self.ports, *self.further)

    def resolve(self, name: str) -> sp.Expr:
        """Return the expression of a published quantity or estimated parameter by name.

        Raises:
            ModelError: If the model has no such quantity (with the closest names).
        """
        if name in self.states or name in self.inputs:
            return symbol(name)
        if name in self.ports:
            return symbol(name)
        if name in self.estimated:
            return symbol(self.estimated[name])
        if name in self.further:
            return self.further[name]
        names = [*self.published, *self.estimated]
        raise ModelError(f"model '{self.name}' has no quantity '{name}'{registry.closest(name, names)}")

    def expand(self, expr: sp.Expr) -> sp.Expr:
        """Write an expression in states, inputs and parameters only, all ports substituted."""
        expanded: dict[sp.Symbol, sp.Expr] = {}
        for name, port in self.ports.items():
            expanded[symbol(name)] = port.xreplace(expanded)
        return expr.xreplace(expanded)

    def augment(self, unknown_inputs: Sequence[str]) -> StateSpaceModel:
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
