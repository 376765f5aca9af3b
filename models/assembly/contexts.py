"""Contexts of tyres and effects while a model is assembled: reading by name, own parameters, own states."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from types import ModuleType
from typing import Protocol

import sympy as sp

from harness.common import registry
from harness.common.errors import ModelError
from harness.models.assembly.algebraic_loops import depends
from harness.models.assembly.expressions import present
from harness.models.assembly.model import Body, symbol
from harness.models.assembly.placement import Layout, Site, suffix
from harness.models.contracts import Parameter


class PartialModel(Protocol):
    """What a part may ask of the model that is being assembled (``assemble.Builder``).

    Attributes:
        vehicle_name: File in ``models/vehicles``.
        layout: Bodies and axles of the vehicle.
        states: Names of the states so far.
        ports: Definitions of the ports published so far.
        parameters: Those declared so far.
        effects: All effects by name.
        optional: Whether each of them may be absent.
    """

    vehicle_name: str
    layout: Layout
    states: list[str]
    ports: dict[str, sp.Expr]
    parameters: dict[str, Parameter]
    effects: dict[str, ModuleType]
    optional: bool

    def note_read(self, owner: str, name: str) -> None:
        """Remember that ``owner`` reads ``name``."""

    def port(self, name: str, expr: sp.Expr | float) -> sp.Symbol:
        """Publish a named quantity."""

    def body_named(self, name: str, owner: str) -> Body:
        """Return a body for an effect."""

    def add_input(self, name: str, otherwise: float | None = None) -> sp.Symbol:
        """Add an input that an effect needs."""

    def own_state(self, owner: str, name: str, start: float | str | None = None) -> sp.Symbol:
        """Add a state of an effect, or return it."""

    def own_derivative(self, name: str, expr: sp.Expr) -> None:
        """State the derivative of an effect's state."""

    def own_loop(self, name: str, expr: sp.Expr) -> sp.Symbol:
        """Publish a quantity of an effect whose definition may lead back to it."""


class _Reader:
    """What every part of a model may do: read signals and parameters by name."""

    def __init__(self, builder: PartialModel, owner: str, parameters: Mapping[str, str]) -> None:
        self._builder, self._owner, self._own = builder, owner, dict(parameters)

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
    """What a tyre sees of one axle: slip angle, load, friction, camber, its parameters and its ports."""

    def __init__(
        self,
        builder: PartialModel,
        parameters: Sequence[Parameter],
        axle: str,
        group: str,
        quantities: Mapping[str, sp.Expr],
    ) -> None:
        super().__init__(builder, f"tyre of axle {axle}", {p.name: f"{p.name}_{group}" for p in parameters})
        self.axle = axle
        self.slip_angle = quantities["slip_angle"]
        self.vertical_load = quantities["vertical_load"]
        self.friction = quantities["friction"]
        self.inclination = quantities["inclination"]

    def port(self, kind: str, expr: sp.Expr) -> sp.Symbol:
        """Publish ``<kind>_axle_<axle>``, e.g. ``cornering_stiffness_axle_11``."""
        return self._builder.port(f"{kind}_axle_{self.axle}", expr)


class EffectContext(_Reader):
    """What an effect may do at one of its sites: read signals, use its parameters and states, know the time.

    Attributes:
        site: The port that is changed, with its place, body and axle.
        time: Time since the start of the drive in s.
    """

    def __init__(
        self, builder: PartialModel, name: str, parameters: Mapping[str, str], site: Site, flag: sp.Symbol | None = None
    ) -> None:
        super().__init__(builder, f"effect '{name}'", parameters)
        self.site, self._flag = site, flag
        self.time = symbol("time")

    @property
    def body(self) -> Body:
        """The body of the site.

        Raises:
            ModelError: If the vehicle does not describe it.
        """
        return self._builder.body_named(self.site.body, self._owner)

    @property
    def mass(self) -> sp.Expr:
        """Mass of the site's body in kg.

        Raises:
            ModelError: If the vehicle's equations have no mass.
        """
        return self._known_mass(self.body)

    @property
    def leader(self) -> Body:
        """The body in front."""
        return self._builder.body_named(self._builder.layout.leader, self._owner)

    @property
    def total_mass(self) -> sp.Expr:
        """Mass of all bodies in kg.

        Raises:
            ModelError: If the vehicle's equations have no mass.
        """
        bodies = [self._builder.body_named(name, self._owner) for name in self._builder.layout.bodies]
        return sp.Add(*(self._known_mass(body) for body in bodies))

    def _known_mass(self, body: Body) -> sp.Expr:
        if body.mass is None:
            raise self.refuse("its equations have no mass")
        return body.mass

    def at_leader(self, stem: str) -> sp.Symbol:
        """Read ``stem`` of the body in front."""
        return self.read(stem + suffix(self._builder.layout.leader))

    def at_body(self, stem: str) -> sp.Symbol:
        """Read ``stem`` of the site's body, e.g. ``yaw_acceleration_trailer``."""
        return self.read(stem + suffix(self.site.body))

    def at_axle(self, stem: str) -> sp.Symbol:
        """Read ``<stem>_axle_<axle>`` of the site's axle."""
        return self.read(f"{stem}_axle_{self.site.axle}")

    def of_effect(self, file: str, stem: str, otherwise: sp.Expr | float) -> sp.Expr | float:
        """Return a state or parameter that another effect has for the site's body, where it acts on that body.

        Args:
            file: The other effect, one of bodies.
            stem: Of the name of the state or parameter.
            otherwise: What is returned where it does not act.
        """
        body, effects = self.site.body, self._builder.effects
        if file not in effects and f"{file}@{body}" not in effects:
            return otherwise
        own = self.at_body(stem)
        return present(symbol(f"has_{file}{suffix(body)}"), own, otherwise) if self._builder.optional else own

    def provides(self, name: str) -> bool:
        """Whether the vehicle or the tyre has published a state or port, or declared a parameter, so far."""
        return name in self._builder.states or name in self._builder.ports or name in self._builder.parameters

    def refuse(self, reason: str) -> ModelError:
        """Return the error of an effect that makes no sense at this site, to be raised."""
        return ModelError(f"{self._owner} does not fit '{self._builder.vehicle_name}': {reason}")

    def input(self, name: str, otherwise: float | None = None) -> sp.Symbol:
        """Return an input that this effect adds to the model, if it does not have it yet.

        Args:
            name: A signal.
            otherwise: Its value in a simulated drive that does not state it; without one such a drive is refused. A
                recording has to hold it in any case.
        """
        return self._builder.add_input(name, otherwise)

    def state(self, stem: str, shared: bool = False, start: float | str | None = None) -> sp.Symbol:
        """Return one of the effect's own states: of the site's place, or one for all places.

        Args:
            stem: Its name in ``STATES``.
            shared: Whether all places share it.
            start: First value where it is not zero, as in ``StateSpaceModel.start``.
        """
        return self._builder.own_state(self._owner, self._state_name(stem, shared), start)

    def derivative(self, stem: str, expr: sp.Expr, shared: bool = False) -> None:
        """State the time derivative of one of the effect's own states."""
        name = self._state_name(stem, shared)
        self._builder.own_state(self._owner, name)
        if self._flag is not None and not shared:  # what places share must not depend on one of them
            expr = present(self._flag, sp.sympify(expr), sp.Integer(0))
        self._builder.own_derivative(name, expr)

    def solved(self, name: str, expr: sp.Expr) -> sp.Symbol:
        """Return a quantity that is defined by an expression which may depend on it.

        Args:
            name: Of the quantity, a signal.
            expr: Reads the quantity through the ports that this effect changes by it (``algebraic_loops``).
        """
        return self._builder.own_loop(name, expr)

    def depends(self, expr: sp.Expr, name: str) -> bool:
        """Whether an expression reads a port that has been published, directly or through others."""
        return depends(self._builder.ports, expr, name)

    def _state_name(self, stem: str, shared: bool) -> str:
        return stem if shared else stem + self.site.suffix
