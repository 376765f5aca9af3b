"""What holds for every file in ``models/sensors``."""

from __future__ import annotations

import pytest

from harness.common.errors import ModelError
from harness.models.assembly.assemble import assemble
from harness.models.roles import ROLES
from harness.models.signals import SIGNALS
from support.dimensions import assemble_with_units, check_dimensions
from support.parts import COMBINATIONS, SENSORS, load


@pytest.mark.parametrize("name", SENSORS)
def test_exports_and_names(name):
    module = load("sensors", name)
    assert all(hasattr(module, export) for export in ROLES["sensors"].exports)
    assert module.__doc__
    assert module.OUTPUTS
    assert not [s for pair in module.OUTPUTS.items() for s in pair if s not in SIGNALS]


@pytest.mark.parametrize("name", SENSORS)
def test_some_vehicle_publishes_what_is_measured(name):
    fits, refusals = [], []
    for vehicle, tyre in COMBINATIONS:
        try:
            built = assemble(vehicle, tyre, sensors=name)
        except ModelError as error:
            refusals.append(str(error))
            continue
        fits.append(vehicle)
        assert tuple(built.outputs) == tuple(load("sensors", name).OUTPUTS)
        for output, measured in load("sensors", name).OUTPUTS.items():
            assert built.expand(built.outputs[output]) == built.expand(built.resolve(measured))
        tyre_file = None if tyre is None else load("tyres", tyre)
        parts = assemble_with_units(load("vehicles", vehicle), tyre_file, sensors=load("sensors", name))
        check_dimensions(parts)
    assert fits, "\n".join(refusals)
