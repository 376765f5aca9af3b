"""What holds for every file in ``models/parameters``."""

from __future__ import annotations

import re

import pytest

from harness.common.errors import ModelError
from harness.models.assembly.assemble import assemble
from harness.models.contracts import Parameter
from harness.models.roles import ROLES
from support.parts import SENSORS, SETS, load, model, tyres_of


def declared(name: str) -> dict[str, Parameter]:
    """Return every parameter that the set's vehicle has on any tyre."""
    vehicle = load("parameters", name).VEHICLE
    return {p.name: p for tyre in tyres_of(vehicle) for p in model(vehicle, tyre).parameters}


@pytest.mark.parametrize("name", SETS)
def test_exports_and_source(name):
    module = load("parameters", name)
    assert all(hasattr(module, export) for export in ROLES["parameters"].exports)
    assert re.fullmatch(r"[a-z0-9_]+_\d{4}[a-z]?", name), "a set is named author_year"
    assert module.__doc__
    assert len(module.__doc__) > 80, "the docstring says where the values come from"


@pytest.mark.parametrize("name", SETS)
def test_values_are_complete_known_and_inside_their_bounds(name):
    values, known = load("parameters", name).VALUES, declared(name)
    assert sorted(set(known) - set(values)) == []
    assert sorted(set(values) - set(known)) == []
    outside = {n: v for n, v in values.items() if not known[n].lower <= v <= known[n].upper}
    assert outside == {}


@pytest.mark.parametrize("name", SETS)
def test_values_are_possible_together(name):
    module = load("parameters", name)
    vehicle = load("vehicles", module.VEHICLE)
    if not hasattr(vehicle, "check"):
        pytest.skip("this vehicle has no joint check")
    assert vehicle.check(module.VALUES) == []


@pytest.mark.parametrize("name", SETS)
def test_noise_belongs_to_states_and_outputs(name):
    module = load("parameters", name)
    vehicle = load("vehicles", module.VEHICLE)
    assert set(vehicle.STATES) <= set(module.PROCESS_NOISE), "every state needs a process noise"
    assert set(module.PROCESS_NOISE) <= {*vehicle.STATES, *vehicle.INPUTS}
    assert all(q >= 0 for q in module.PROCESS_NOISE.values())
    assert all(r > 0 for r in module.MEASUREMENT_NOISE.values())
    assert 0 < module.NOISE_STEP <= 1
    fitting = set()
    for sensors in SENSORS:
        try:
            fitting |= set(assemble(module.VEHICLE, tyres_of(module.VEHICLE)[0], sensors=sensors).outputs)
        except ModelError:
            continue
    assert fitting <= set(module.MEASUREMENT_NOISE), "every sensor that fits needs a measurement noise"
    publishes = model(module.VEHICLE, tyres_of(module.VEHICLE)[0])
    assert set(module.MEASUREMENT_NOISE) <= {*publishes.states, *publishes.inputs, *publishes.ports}
