"""Placement of effects: the ports of a vehicle that they change, and the places that have parameters of their own.

An effect names its ports by templates. ``external_lateral_force{body}`` is that force of every body,
``external_yaw_moment{leader}`` that of the first, ``slip_angle_axle_{axle}`` every axle's, ``sensor_{output}``
whatever is measured. ``PLACE`` says what its parameters belong to: nothing (one set for the vehicle), ``body``,
``axle``, ``tyre`` (the axles that share a tyre) or ``output``. The name of the place is appended to the names of
its parameters and states, ``crosswind_force_trailer``. In a study ``crosswind`` acts everywhere,
``crosswind@trailer`` there only.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from types import ModuleType

from harness.common.errors import ModelError, closest
from harness.models.contracts import Parameter
from harness.models.roles import DEGRADATIONS, EFFECTS
from harness.models.signals import MAGNITUDE, SIGNALS

OF_SIGNAL = "{signal}"
"""Unit of a parameter that has the unit of the measured signal; its bounds count that unit's usual magnitude."""


@dataclass(frozen=True)
class Layout:
    """The places of a vehicle.

    Attributes:
        bodies: Axles of each body; ``{"": all}`` for a vehicle of one body, whose signals have no suffix.
        tyres: Group of tyre parameters of each axle.
    """

    bodies: Mapping[str, Sequence[str]]
    tyres: Mapping[str, str]

    @staticmethod
    def of(vehicle: ModuleType) -> Layout:
        """Return the layout of a vehicle file."""
        return Layout(getattr(vehicle, "BODIES", {"": tuple(vehicle.AXLES)}), vehicle.AXLES)

    @property
    def leader(self) -> str:
        """The body in front, which is the one that steers."""
        return next(iter(self.bodies))

    def body_of_axle(self, axle: str) -> str:
        """Return the body an axle belongs to."""
        return next((body for body, axles in self.bodies.items() if axle in axles), self.leader)

    def body_of_output(self, output: str) -> str:
        """Return the body a measured signal belongs to by its frame or axle, else the leader."""
        frame = SIGNALS[output].frame if output in SIGNALS else ""
        if frame in self.bodies:
            return frame
        return self.body_of_axle(output.rpartition("_axle_")[2])

    def names(self, place: str) -> tuple[str, ...]:
        """Return every name a kind of place (``PLACE``) can have on this vehicle."""
        kinds = {
            "": ("",),
            "body": tuple(self.bodies),
            "axle": tuple(self.tyres),
            "tyre": tuple(dict.fromkeys(self.tyres.values())),
            "output": tuple(SIGNALS),
        }
        return kinds[place]


@dataclass(frozen=True)
class Site:
    """One port that an effect changes.

    Attributes:
        port: Name of the port.
        place: What the effect's parameters belong to there; ``""`` for the vehicle.
        body: Body of the port.
        axle: Axle of the port; ``""`` if it has none.
        output: Measured signal; ``""`` if the port is no sensor.
    """

    port: str
    place: str
    body: str
    axle: str = ""
    output: str = ""

    @property
    def suffix(self) -> str:
        """What is appended to the names of parameters and states."""
        return suffix(self.place)


def suffix(place: str) -> str:
    """Return what a place appends to a name."""
    return f"_{place}" if place else ""


def ports_of(effect: ModuleType) -> tuple[str, ...]:
    """Return the templates of the ports an effect changes."""
    return (effect.PORT,) if isinstance(effect.PORT, str) else tuple(effect.PORT)


def place_of(effect: ModuleType) -> str:
    """Return the kind of place that has parameters of its own; one set for the vehicle if the file says nothing."""
    return "output" if degrades(effect) else getattr(effect, "PLACE", "")


def degrades(effect: ModuleType) -> bool:
    """Whether it is a degradation of sensors, which has no equations."""
    return hasattr(effect, "degrade")


def sites(effect: ModuleType, port: str, layout: Layout) -> Iterator[Site]:
    """Yield where an effect changes a port: once, or not at all."""
    for template in ports_of(effect):
        head, _, kind = template.rstrip("}").partition("{")
        if not port.startswith(head):
            continue
        site = _site(port, port[len(head) :], kind, layout)
        if site is not None:
            place = {
                "": "",
                "body": site.body,
                "axle": site.axle,
                "tyre": layout.tyres.get(site.axle, ""),
                "output": site.output,
            }
            yield replace(site, place=place[place_of(effect)])
            return


def _site(port: str, rest: str, kind: str, layout: Layout) -> Site | None:
    """Return the site of a port whose name ends in ``rest`` where a template has ``{kind}``."""
    output = port.removeprefix("sensor_") if port.startswith("sensor_") else ""
    if kind in ("body", "leader"):
        bodies = layout.bodies if kind == "body" else (layout.leader,)
        body = rest.removeprefix("_")
        return Site(port, "", body, output=output) if body in bodies and rest == suffix(body) else None
    if kind == "axle":
        return Site(port, "", layout.body_of_axle(rest), axle=rest) if rest in layout.tyres else None
    if kind == "output":
        return Site(port, "", layout.body_of_output(rest), output=rest)
    return Site(port, "", layout.body_of_output(output), output=output) if rest == "" else None


def parameter_at(parameter: Parameter, place: str) -> Parameter:
    """Return a parameter as it is declared at a place: its name, and for a measured signal its unit and bounds."""
    if parameter.shared:
        return parameter
    declared = replace(parameter, name=parameter.name + suffix(place))
    if parameter.unit != OF_SIGNAL:
        return declared
    unit = SIGNALS[place].unit
    scale = MAGNITUDE.get(unit, 1.0)
    grid, natural = (tuple(scale * v for v in values) for values in (parameter.grid, parameter.natural))
    lower, upper = scale * parameter.lower, scale * parameter.upper
    neutral = None if parameter.neutral is None else scale * parameter.neutral
    return replace(declared, unit=unit, lower=lower, upper=upper, grid=grid, natural=natural, neutral=neutral)


def split(name: str) -> tuple[str, str | None]:
    """Split ``effect@place`` into file and place; the place is ``None`` where none is named."""
    file, at, place = name.partition("@")
    return file, place if at else None


def is_degradation(name: str) -> bool:
    """Whether a degradation of sensors has this name, with or without a place."""
    return split(name)[0] in DEGRADATIONS.components()


def load_effect(name: str) -> ModuleType:
    """Return the file of an effect, or degradation of sensors, named with or without a place.

    Raises:
        ModelError: If there is no such file, or an effect that has no places is given one.
    """
    file, place = split(name)
    if not is_degradation(file) and file not in EFFECTS.components():
        names = [*EFFECTS.names(), *DEGRADATIONS.names()]
        raise ModelError(f"unknown effect '{file}'{closest(file, names)}")
    effect = (DEGRADATIONS if is_degradation(file) else EFFECTS).load(file)
    if place is not None and not place_of(effect):
        raise ModelError(f"effect '{file}' acts on the whole vehicle; write '{file}' without '@{place}'")
    return effect


def possible_parameters(effect: ModuleType, vehicle: ModuleType) -> Iterator[Parameter]:
    """Yield every parameter an effect may have on a vehicle, whatever tyre and sensors it gets."""
    if degrades(effect):
        yield from (p for p in effect.PARAMETERS if p.unit != OF_SIGNAL)
    for place in Layout.of(vehicle).names(place_of(effect)):
        for parameter in effect.PARAMETERS:
            yield parameter_at(parameter, place)
