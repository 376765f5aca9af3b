"""What holds for every file in ``models/effects``; the checks themselves are tried on small effects first."""

from __future__ import annotations

import re
import types
from functools import cache
from unittest import mock

import numpy as np
import pytest
import sympy as sp

from harness.common.errors import ModelError
from harness.models.assembly.assemble import Builder, Model, assemble
from harness.models.assembly.placement import Layout, possible_parameters
from harness.models.contracts import Parameter
from harness.models.roles import ROLES
from harness.models.signals import SIGNALS
from support.dimensions import assemble_with_units, check_dimensions, check_parameters
from support.parts import EFFECTS, SENSORS, VEHICLES, evaluate, load, random_point


@cache
def best_sensors(vehicle: str) -> str:
    """Return the sensor set that measures most of a vehicle."""
    found: dict[str, int] = {}
    for sensors in SENSORS:
        try:
            found[sensors] = len(assemble(vehicle, tyres(vehicle)[0], sensors=sensors).outputs)
        except ModelError:
            continue
    return max(found, key=lambda name: found[name])


def tyres(vehicle: str) -> list[str | None]:
    """Return two tyres, one that knows its capacity and one that does not: an effect fits on one of them or on none."""
    return ["magic_formula", "linear"] if load("vehicles", vehicle).AXLES else [None]


@cache
def plain(vehicle: str, tyre: str | None) -> Model:
    return assemble(vehicle, tyre, (), best_sensors(vehicle))


_FITS: dict[types.ModuleType, list[tuple[str, str | None, Model]]] = {}


def fits(name: str, effect: types.ModuleType) -> list[tuple[str, str | None, Model]]:
    """Return the models that the effect fits: (vehicle, tyre, model)."""
    if effect not in _FITS:
        _FITS[effect] = []
        for vehicle in VEHICLES:
            for tyre in tyres(vehicle):
                try:
                    built = assemble(vehicle, tyre, {name: effect}, best_sensors(vehicle))
                except ModelError:
                    continue
                _FITS[effect].append((vehicle, tyre, built))
                break
    return _FITS[effect]


def own_parameters(built: Model, without: Model) -> list[Parameter]:
    return [p for p in built.parameters if p.name not in without.parameter_names]


def drawn(parameter: Parameter, rng: np.random.Generator) -> float:
    """Return a value in bounds; a moment in a drive lies in the first minute."""
    return rng.uniform(0, 60) if parameter.per_drive else rng.uniform(parameter.lower, parameter.upper)


def random_drive(built: Model, vehicle: str, rng: np.random.Generator) -> dict[str, float]:
    """Return a random point at which states that follow the speed are near it."""
    point = random_point(built, vehicle, rng)
    own = set(built.start) - set(load("vehicles", vehicle).STATES)
    return point | {s: point["speed"] + point[s] for s in own if built.start[s] == "speed"}


def compare(vehicle: str, tyre: str | None, built: Model, point: dict[str, float]) -> tuple[np.ndarray, np.ndarray]:
    """Return derivatives and outputs that a model shares with the one without the effect: with it, without it."""
    without = plain(vehicle, tyre)
    kept = [built.derivatives[built.states.index(s)] for s in without.states]
    return (
        evaluate(built, [*kept, *built.outputs.values()], point),
        evaluate(without, [*without.derivatives, *without.outputs.values()], point),
    )


def matches(template: str, name: str, layout: Layout) -> bool:
    """Whether a name is that of a template for some body or axle."""
    bodies = [f"_{b}" if b else "" for b in layout.bodies]
    text = re.escape(template).replace(r"\{body\}", f"({'|'.join(bodies)})").replace(r"\{leader\}", bodies[0])
    return re.fullmatch(text.replace(r"\{axle\}", "(" + "|".join(layout.tyres or [""]) + ")"), name) is not None


def check_contract(name: str, effect: types.ModuleType) -> None:
    """Check exports, names, units and that some vehicle has the port."""
    assert all(hasattr(effect, export) for export in ROLES["effects"].exports)
    assert effect.__doc__
    neutral = [p for p in effect.PARAMETERS if p.neutral is not None]
    assert neutral, "no parameter says at which value the effect is absent"
    assert all(p.lower <= p.neutral <= p.upper for p in neutral)
    assert all(p.lower <= g <= p.upper for p in effect.PARAMETERS for g in p.grid)
    others = [p for p in effect.PARAMETERS if p.neutral is None]
    assert all(p.grid or p.per_drive for p in others), "a parameter without neutral value needs values to start from"
    assert fits(name, effect), f"no vehicle publishes {effect.PORT}"
    for vehicle, tyre, built in fits(name, effect):
        added = own_parameters(built, plain(vehicle, tyre))
        check_parameters(tuple(added))
        assert {p.name for p in added} <= {p.name for p in possible_parameters(effect, load("vehicles", vehicle))}
        own = set(built.states) - set(plain(vehicle, tyre).states)
        assert not [s for s in own if s not in SIGNALS]
        assert all(s.startswith(effect.STATES) for s in own)
        tyre_file = None if tyre is None else load("tyres", tyre)
        parts = {"effects": {name: effect}, "sensors": load("sensors", best_sensors(vehicle))}
        check_dimensions(assemble_with_units(load("vehicles", vehicle), tyre_file, **parts))


def reads_of(name: str, effect: types.ModuleType, vehicle: str, tyre: str | None) -> list[str]:
    """Return what the effect asked for by name while it was assembled."""
    seen: list[str] = []
    add_input = Builder.add_input

    def added(self: Builder, read: str) -> sp.Symbol:
        seen.append(read)
        return add_input(self, read)

    with (
        mock.patch.object(Builder, "note_read", lambda self, owner, read: seen.append(read)),
        mock.patch.object(Builder, "add_input", added),
    ):
        assemble(vehicle, tyre, {name: effect}, best_sensors(vehicle))
    return seen


def check_reads(name: str, effect: types.ModuleType) -> None:
    """Check that ``READS`` says what the effect reads, all of it and nothing else."""
    used: set[str] = set()
    for vehicle, tyre, _ in fits(name, effect):
        seen = reads_of(name, effect, vehicle, tyre)
        layout = Layout.of(load("vehicles", vehicle))
        for read in seen:
            template = next((t for t in effect.READS if matches(t, read, layout)), None)
            assert template is not None, f"{name} reads '{read}', which its READS do not name"
            used.add(template)
    assert used == set(effect.READS)


def check_neutral(name: str, effect: types.ModuleType) -> None:
    """Check that at the neutral values the model equals the one without the effect, whatever its states are."""
    rng = np.random.default_rng(0)
    for vehicle, tyre, built in fits(name, effect):
        for _ in range(5):
            point = random_drive(built, vehicle, rng)
            for p in own_parameters(built, plain(vehicle, tyre)):
                point[p.name] = drawn(p, rng) if p.neutral is None else p.neutral
            with_it, without = compare(vehicle, tyre, built, point)
            assert with_it == pytest.approx(without, rel=1e-12, abs=1e-12 * max(1.0, np.abs(without).max()))


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
    assert largest > 1e-9


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
                assert np.isfinite(far).all()
                rounding = 1e-13 * np.abs(at_rest) / size
                assert (np.abs(near - far) <= 0.1 * np.abs(far) + 1e-9 + rounding).all(), p.name
                stem = next(q.name for q in effect.PARAMETERS if p.name.startswith(q.name))
                steepest[stem] = max(steepest.get(stem, 0.0), (p.upper - p.lower) * float(np.abs(far).max()))
    assert steepest
    assert all(change > 1e-6 for change in steepest.values()), steepest


CHECKS = [check_contract, check_reads, check_neutral, check_presence, check_slope]


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect(name):
    """All checks of one effect in one test, so that its models are assembled once."""
    for check in CHECKS:
        check(name, load("effects", name))


@pytest.mark.parametrize("vehicle", [v for v in VEHICLES if load("vehicles", v).PARAMETERS])
def test_all_effects_together_are_absent_at_their_neutral_values(vehicle):
    """Also that they can be assembled together: no two share a state or parameter, and none makes a loop."""
    for tyre in tyres(vehicle):
        chosen = {
            n: load("effects", n) for n in EFFECTS if (vehicle, tyre) in {f[:2] for f in fits(n, load("effects", n))}
        }
        if not chosen:
            continue
        built = assemble(vehicle, tyre, chosen, best_sensors(vehicle))
        rng = np.random.default_rng(2)
        for _ in range(5):
            point = random_drive(built, vehicle, rng)
            for p in own_parameters(built, plain(vehicle, tyre)):
                point[p.name] = drawn(p, rng) if p.neutral is None else p.neutral
            with_it, without = compare(vehicle, tyre, built, point)
            assert with_it == pytest.approx(without, rel=1e-12, abs=1e-12 * max(1.0, np.abs(without).max()))


# --- the checks find what they are for


def effect(port="road_wheel_angle", apply=None, unit="dimensionless", neutral=1.0, **more) -> types.ModuleType:
    module = types.ModuleType("gain")
    module.__doc__ = "A gain."
    module.PORT, module.READS, module.STATES = port, (), more.get("states", ())
    module.PARAMETERS = (Parameter("gain", "k", unit, 0.5, 2.0, "gain", neutral),)
    module.apply = apply or (lambda e, value: e.p("gain") * value)
    return module


@pytest.mark.parametrize("check", CHECKS)
def test_a_right_effect_passes(check):
    check("gain", effect())


@pytest.mark.parametrize("port", ["sensor_yaw_rate_trailer", "vertical_load_axle_11"])
def test_effects_on_sensors_and_loads_pass(port):
    check_contract("gain", effect(port))
    check_neutral("gain", effect(port))


@pytest.mark.parametrize(
    ("wrong", "check"),
    [
        (effect(neutral=1.1), check_neutral),
        (effect(neutral=None), check_contract),
        (effect(neutral=3.0), check_contract),
        (effect(unit="N"), check_contract),
        (effect(apply=lambda e, value: value + sp.Float(0.01)), check_neutral),
        (effect(apply=lambda e, value: value), check_presence),
        (effect(port="road_wheel_angel"), check_contract),
        (effect(apply=lambda e, value: e.p("gain") * value + 0 * e.read("speed")), check_reads),
        (effect(apply=lambda e, value: value * (1 + (e.p("gain") - 1) ** 3)), check_slope),
    ],
    ids=["not neutral", "no neutral", "neutral out of bounds", "unit", "offset", "nothing", "port", "reads", "cubic"],
)
def test_a_wrong_effect_is_found(wrong, check):
    with pytest.raises(AssertionError):
        check("gain", wrong)
