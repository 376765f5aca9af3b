"""What holds for every file in ``models/effects``; the checks themselves are tried on small effects first."""

from __future__ import annotations

import types

import numpy as np
import pytest
import sympy as sp
from _dimensions import assemble_with_units, check_dimensions
from _parts import COMBINATIONS, EFFECTS, SENSORS, evaluate, load, model, random_point
from test_vehicles import check_parameters

from models.assemble import Model, assemble
from models.contracts import EXPORTS, ModelError, Parameter
from models.signals import SIGNALS


def with_effect(name: str, effect: types.ModuleType) -> list[tuple[str, str | None, str | None, Model]]:
    """Return the models that the effect fits: (vehicle, tyre, sensors, model)."""
    found = []
    for vehicle, tyre in COMBINATIONS:
        for sensors in (None, *SENSORS):
            try:
                built = assemble(vehicle, tyre, {name: effect}, sensors)
            except ModelError:
                continue
            found.append((vehicle, tyre, sensors, built))
    return found


def check_contract(name: str, effect: types.ModuleType) -> None:
    """Check exports, names, units and that some vehicle has the port."""
    assert all(hasattr(effect, export) for export in EXPORTS["effects"])
    assert effect.__doc__
    check_parameters(effect.PARAMETERS)
    ports = [effect.PORT] if isinstance(effect.PORT, str) else list(effect.PORT)
    assert ports
    assert not [p for p in ports if p.removeprefix("sensor_") not in SIGNALS]
    assert not [r for r in (*effect.READS, *effect.STATES) if r not in SIGNALS and r != "time"]
    neutral = [p for p in effect.PARAMETERS if p.neutral is not None]
    assert neutral, "no parameter says at which value the effect is absent"
    assert all(p.lower <= p.neutral <= p.upper for p in neutral)
    fits = with_effect(name, effect)
    assert fits, f"no vehicle publishes {ports}"
    for vehicle, tyre, sensors, _ in fits:
        tyre_file = None if tyre is None else load("tyres", tyre)
        parts = assemble_with_units(
            load("vehicles", vehicle),
            tyre_file,
            effects={name: effect},
            sensors=None if sensors is None else load("sensors", sensors),
        )
        check_dimensions(parts)


def check_neutral(name: str, effect: types.ModuleType) -> None:
    """Check that at the neutral values the model equals the one without the effect."""
    rng = np.random.default_rng(0)
    for vehicle, tyre, sensors, built in with_effect(name, effect):
        plain = model(vehicle, tyre) if sensors is None else assemble(vehicle, tyre, (), sensors)
        kept = [built.derivatives[built.states.index(s)] for s in plain.states]
        for _ in range(10):
            point = random_point(built, vehicle, rng)
            for p in effect.PARAMETERS:
                point[p.name] = rng.uniform(p.lower, p.upper) if p.neutral is None else p.neutral
            with_it = evaluate(built, [*kept, *built.outputs.values()], point)
            without = evaluate(plain, [*plain.derivatives, *plain.outputs.values()], point)
            assert with_it == pytest.approx(without, rel=1e-12, abs=1e-12)


def check_presence(name: str, effect: types.ModuleType) -> None:
    """Check that away from the neutral values the effect does something, in some vehicle."""
    rng = np.random.default_rng(0)
    largest = 0.0
    for vehicle, tyre, sensors, built in with_effect(name, effect):
        plain = model(vehicle, tyre) if sensors is None else assemble(vehicle, tyre, (), sensors)
        kept = [built.derivatives[built.states.index(s)] for s in plain.states]
        for _ in range(10):
            point = random_point(built, vehicle, rng)
            for p in effect.PARAMETERS:
                point[p.name] = rng.uniform(p.lower, p.upper)
            with_it = evaluate(built, [*kept, *built.outputs.values()], point)
            without = evaluate(plain, [*plain.derivatives, *plain.outputs.values()], point)
            largest = max(largest, float(np.abs(with_it - without).max()))
    assert largest > 1e-9


@pytest.mark.parametrize("name", EFFECTS)
@pytest.mark.parametrize("check", [check_contract, check_neutral, check_presence])
def test_every_effect(name, check):
    check(name, load("effects", name))


# --- the checks find what they are for


def effect(port="road_wheel_angle", apply=None, unit="dimensionless", neutral=1.0, **more) -> types.ModuleType:
    module = types.ModuleType("gain")
    module.__doc__ = "A gain."
    module.PORT, module.READS, module.STATES = port, (), more.get("states", ())
    module.PARAMETERS = (Parameter("gain", "k", unit, 0.5, 2.0, "gain", neutral),)
    module.apply = apply or (lambda e, value: e.p("gain") * value)
    return module


@pytest.mark.parametrize("check", [check_contract, check_neutral, check_presence])
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
    ],
    ids=["not neutral", "no neutral", "neutral out of bounds", "unit", "offset", "nothing", "port"],
)
def test_a_wrong_effect_is_found(wrong, check):
    with pytest.raises(AssertionError):
        check("gain", wrong)
