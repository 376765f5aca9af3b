"""What holds for every set of sensors."""

from __future__ import annotations

from types import ModuleType

from harness.common.errors import ModelError
from harness.models.roles import SENSORS, VEHICLES
from harness.models.signals import SIGNALS
from harness.testing.dimensions import assemble_with_units, check_dimensions
from harness.testing.parts import load, model, named, require, tyres_of


def check_sensors(sensors: str | ModuleType) -> None:
    """Check a set of sensors: exports, names, and that some vehicle publishes what it measures.

    Raises:
        AssertionError: If something does not hold; the message says what.
    """
    with named(SENSORS, sensors) as name:
        file = load("sensors", name)
        require(file.__doc__, f"{name}: write a docstring: its first line is what 'harness list' shows")
        require(file.OUTPUTS, f"{name}: OUTPUTS is empty")
        strange = [s for pair in file.OUTPUTS.items() for s in pair if s not in SIGNALS]
        require(not strange, f"{name}: no signals: {', '.join(strange)}; state them in SIGNALS of the file")
        fits, refusals = False, []
        for vehicle in VEHICLES.names():
            for tyre in tyres_of(vehicle):
                try:
                    built = model(vehicle, tyre, name)
                except ModelError as error:
                    refusals.append(f"{vehicle}: {error}")
                    continue
                fits = True
                require(tuple(built.outputs) == tuple(file.OUTPUTS), f"{name}: {vehicle} measures something else")
                for output, measured in file.OUTPUTS.items():
                    same = built.expand(built.outputs[output]) == built.expand(built.resolve(measured))
                    require(same, f"{name}: '{output}' is not '{measured}' of {vehicle}")
                tyre_file = None if tyre is None else load("tyres", tyre)
                check_dimensions(assemble_with_units(load("vehicles", vehicle), tyre_file, sensors=file))
        require(fits, f"{name}: no vehicle publishes what it measures:\n" + "\n".join(refusals))
