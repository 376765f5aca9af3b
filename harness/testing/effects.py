"""What holds for every effect on every vehicle that it fits."""

from __future__ import annotations

import re
import types
from unittest import mock

import numpy as np
import sympy as sp

from harness.common import components
from harness.common.errors import ModelError
from harness.models.assembly.assemble import Builder, StateSpaceModel, assemble
from harness.models.assembly.placement import Layout, possible_parameters
from harness.models.contracts import Parameter
from harness.models.roles import EFFECTS, VEHICLES
from harness.models.signals import SIGNALS
from harness.testing.dimensions import assemble_with_units, check_dimensions, check_parameters
from harness.testing.parts import evaluate, fitting_sensors, load, model, random_point, require


def check_effect(effect: str | types.ModuleType) -> None:
    """Check an effect on every vehicle that it fits.

    Exports, names and units; that it reads what ``READS`` says; that at the neutral values the model is the one without
    it and away from them is not; and that the model has a slope there, by which a test may see the effect.

    Args:
        effect: Its name, or a module that keeps the contract (``harness/models/contracts.py``).

    Raises:
        AssertionError: If something does not hold; the message says what.
    """
    file = EFFECTS.load(effect) if isinstance(effect, str) else effect
    for check in CHECKS:
        check(components.name_of(file), file)


def tyres(vehicle: str) -> list[str | None]:
    """Return two tyres, one that knows its capacity and one that does not: an effect fits on one of them or on none."""
    return ["magic_formula", "linear"] if load("vehicles", vehicle).AXLES else [None]


def most_sensors(vehicle: str) -> str | None:
    """Return the set of sensors that measures most of a vehicle, if any does."""
    return next(iter(fitting_sensors(vehicle, tyres(vehicle)[0])), None)


def plain(vehicle: str, tyre: str | None) -> StateSpaceModel:
    """Return the model without the effect."""
    return model(vehicle, tyre, most_sensors(vehicle))


_FITS: dict[types.ModuleType, list[tuple[str, str | None, StateSpaceModel]]] = {}


def fits(name: str, effect: types.ModuleType) -> list[tuple[str, str | None, StateSpaceModel]]:
    """Return the models that the effect fits: (vehicle, tyre, model)."""
    if effect not in _FITS:
        _FITS[effect] = []
        for vehicle in VEHICLES.names():
            for tyre in tyres(vehicle):
                try:
                    built = assemble(vehicle, tyre, {name: effect}, most_sensors(vehicle))
                except ModelError:
                    continue
                _FITS[effect].append((vehicle, tyre, built))
                break
    return _FITS[effect]


def own_parameters(built: StateSpaceModel, without: StateSpaceModel) -> list[Parameter]:
    """Return the parameters that the effect adds."""
    return [p for p in built.parameters if p.name not in without.parameter_names]


def drawn(parameter: Parameter, rng: np.random.Generator) -> float:
    """Return a value in bounds; a moment in a drive lies in the first minute."""
    return rng.uniform(0, 60) if parameter.per_drive else rng.uniform(parameter.lower, parameter.upper)


def random_drive(built: StateSpaceModel, vehicle: str, rng: np.random.Generator) -> dict[str, float]:
    """Return a random point at which states that follow the speed are near it."""
    point = random_point(built, vehicle, rng)
    follow = [s for s in built.start if built.start[s] == "speed"]
    own = [s for s in follow if s not in load("vehicles", vehicle).STATES]
    # without an input of that name it is a state of the vehicle that begins as the speed
    named = ["speed", *(s for s in follow if s not in own)]
    return point | {s: point[next(n for n in named if n in point)] + point[s] for s in own}


def compare(
    vehicle: str, tyre: str | None, built: StateSpaceModel, point: dict[str, float]
) -> tuple[np.ndarray, np.ndarray]:
    """Return derivatives and outputs that a model shares with the one without the effect: with it, without it."""
    without = plain(vehicle, tyre)
    kept = [built.derivatives[built.states.index(s)] for s in without.states]
    return (
        evaluate(built, [*kept, *built.outputs.values()], point),
        evaluate(without, [*without.derivatives, *without.outputs.values()], point),
    )


def matches(template: str, name: str, layout: Layout) -> bool:
    """Whether a name is that of a template for some body, axle or tyre."""
    bodies = [f"_{b}" if b else "" for b in layout.bodies]
    text = re.escape(template).replace(r"\{body\}", f"({'|'.join(bodies)})").replace(r"\{leader\}", bodies[0])
    for kind, names in (("axle", layout.tyres), ("tyre", set(layout.tyres.values()))):
        text = text.replace(rf"\{{{kind}\}}", "(" + "|".join(names or [""]) + ")")
    return re.fullmatch(text, name) is not None


def check_contract(name: str, effect: types.ModuleType) -> None:
    """Check exports, names, units and that some vehicle has the port."""
    lacking = [export for export in EFFECTS.exports if not hasattr(effect, export)]
    require(not lacking, f"{name}: missing export {', '.join(lacking)} (see {EFFECTS.contract})")
    require(effect.__doc__, f"{name}: write a docstring: its first line is what 'harness list' shows")
    neutral = [p for p in effect.PARAMETERS if p.neutral is not None]
    require(neutral, f"{name}: no parameter says at which value the effect is absent (neutral)")
    outside = [p.name for p in neutral if not p.lower <= p.neutral <= p.upper]
    require(not outside, f"{name}: neutral value outside the bounds: {', '.join(outside)}")
    outside = [p.name for p in effect.PARAMETERS for g in p.grid if not p.lower <= g <= p.upper]
    require(not outside, f"{name}: grid outside the bounds: {', '.join(outside)}")
    others = [p.name for p in effect.PARAMETERS if p.neutral is None and not (p.grid or p.per_drive)]
    require(not others, f"{name}: without a neutral value, a grid to start from is needed: {', '.join(others)}")
    require(fits(name, effect), f"{name}: no vehicle publishes {effect.PORT}")
    for vehicle, tyre, built in fits(name, effect):
        added = own_parameters(built, plain(vehicle, tyre))
        check_parameters(tuple(added))
        possible = {p.name for p in possible_parameters(effect, load("vehicles", vehicle))}
        require({p.name for p in added} <= possible, f"{name}: a parameter of another name on {vehicle}")
        own = set(built.states) - set(plain(vehicle, tyre).states)
        strange = sorted(s for s in own if s not in SIGNALS)
        require(not strange, f"{name}: states that are no signals: {', '.join(strange)}; state them in SIGNALS")
        require(all(s.startswith(effect.STATES) for s in own), f"{name}: STATES do not name its states {sorted(own)}")
        tyre_file = None if tyre is None else load("tyres", tyre)
        sensors = most_sensors(vehicle)
        measured = None if sensors is None else load("sensors", sensors)
        parts = {"effects": {name: effect}, "sensors": measured}
        check_dimensions(assemble_with_units(load("vehicles", vehicle), tyre_file, **parts))


def reads_of(name: str, effect: types.ModuleType, vehicle: str, tyre: str | None) -> list[str]:
    """Return what the effect asked for by name while it was assembled."""
    seen: list[str] = []
    add_input = Builder.add_input

    def added(self: Builder, read: str, *otherwise: float | None) -> sp.Symbol:
        seen.append(read)
        return add_input(self, read, *otherwise)

    with (
        mock.patch.object(Builder, "note_read", lambda self, owner, read: seen.append(read)),
        mock.patch.object(Builder, "add_input", added),
    ):
        assemble(vehicle, tyre, {name: effect}, most_sensors(vehicle))
    return seen


def check_reads(name: str, effect: types.ModuleType) -> None:
    """Check that ``READS`` says what the effect reads, all of it and nothing else."""
    used: set[str] = set()
    for vehicle, tyre, _ in fits(name, effect):
        seen = reads_of(name, effect, vehicle, tyre)
        layout = Layout.of(load("vehicles", vehicle))
        for read in seen:
            template = next((t for t in effect.READS if matches(t, read, layout)), None)
            require(template is not None, f"{name} reads '{read}', which its READS do not name")
            used.add(str(template))
    unread = sorted(set(effect.READS) - used)
    require(not unread, f"{name}: READS names what it never reads: {', '.join(unread)}")


def check_neutral(name: str, effect: types.ModuleType) -> None:
    """Check that at the neutral values the model equals the one without the effect, whatever its states are."""
    rng = np.random.default_rng(0)
    for vehicle, tyre, built in fits(name, effect):
        for _ in range(5):
            point = random_drive(built, vehicle, rng)
            for p in own_parameters(built, plain(vehicle, tyre)):
                point[p.name] = drawn(p, rng) if p.neutral is None else p.neutral
            with_it, without = compare(vehicle, tyre, built, point)
            equal = np.allclose(with_it, without, rtol=1e-12, atol=1e-12 * max(1.0, np.abs(without).max()))
            require(equal, f"{name}: at its neutral values it changes {vehicle}: {with_it} instead of {without}")


def check_presence(name: str, effect: types.ModuleType) -> None:
    """Check that away from the neutral values the effect does something, in some vehicle."""
    rng = np.random.default_rng(0)
    largest = 0.0
    for vehicle, tyre, built in fits(name, effect):
        for _ in range(5):
            point = random_drive(built, vehicle, rng)
            for p in own_parameters(built, plain(vehicle, tyre)):
                point[p.name] = drawn(p, rng)
            with_it, without = compare(vehicle, tyre, built, point)
            largest = max(largest, float(np.abs(with_it - without).max()))
    require(largest > 1e-9, f"{name}: it changes nothing away from its neutral values")


def check_slope(name: str, effect: types.ModuleType) -> None:
    """Check that derivatives to the parameters at the neutral value exist, and that none is zero everywhere.

    A score test sees an effect by them; one that is quadratic in its parameter would be invisible.
    """
    rng = np.random.default_rng(1)
    steepest: dict[str, float] = {}
    for vehicle, tyre, built in fits(name, effect):
        added = own_parameters(built, plain(vehicle, tyre))
        for _ in range(4):
            point = random_drive(built, vehicle, rng)
            point |= {p.name: drawn(p, rng) if p.neutral is None else p.neutral for p in added}
            at_rest, _ = compare(vehicle, tyre, built, point)
            for p in added:
                if p.neutral is None:
                    continue
                size = 1e-8 * (p.upper - p.lower)
                far, near = (
                    (compare(vehicle, tyre, built, {**point, p.name: p.neutral + h})[0] - at_rest) / h
                    for h in (size, size / 2)
                )
                require(np.isfinite(far).all(), f"{name}: at the neutral value of {p.name} the model is not finite")
                rounding = 1e-13 * np.abs(at_rest) / size
                smooth = (np.abs(near - far) <= 0.1 * np.abs(far) + 1e-9 + rounding).all()
                require(smooth, f"{name}: no derivative to {p.name} at its neutral value")
                stem = next(q.name for q in effect.PARAMETERS if p.name.startswith(q.name))
                steepest[stem] = max(steepest.get(stem, 0.0), (p.upper - p.lower) * float(np.abs(far).max()))
    flat = [stem for stem, change in steepest.items() if change <= 1e-6]
    require(steepest and not flat, f"{name}: zero derivative at the neutral value, invisible to a test: {flat}")


CHECKS = (check_contract, check_reads, check_neutral, check_presence, check_slope)
