"""What holds for every parameter set, set of sensors and reader of recordings."""

from __future__ import annotations

import os
from types import ModuleType

import numpy as np

from harness.common.errors import ModelError
from harness.models.contracts import Parameter
from harness.models.roles import PARAMETERS, SENSORS, VEHICLES
from harness.models.signals import SIGNALS
from harness.recordings.readers import READERS, read_tables, suffixes
from harness.testing.dimensions import assemble_with_units, check_dimensions
from harness.testing.parts import fitting_sensors, load, model, named, require, tyres_of

SHORTEST = 80
"""Characters of a docstring that says where values come from."""


def check_parameter_set(parameters: str | ModuleType) -> None:
    """Check a parameter set: that its values are complete, known, inside their bounds and possible together.

    Raises:
        AssertionError: If something does not hold; the message says what.
    """
    with named(PARAMETERS, parameters) as name:
        file = load("parameters", name)
        require(
            len(file.__doc__ or "") > SHORTEST, f"{name}: say in the docstring where the values come from, in sentences"
        )
        vehicle = load("vehicles", file.VEHICLE)
        declared: dict[str, Parameter] = {
            p.name: p for tyre in tyres_of(file.VEHICLE) for p in model(file.VEHICLE, tyre).parameters
        }
        own = {p.name for p in vehicle.PARAMETERS}
        needed = set(own)
        for tyre in tyres_of(file.VEHICLE):  # of a tyre that the set is not for it has no value at all
            of_tyre = set(model(file.VEHICLE, tyre).parameter_names) - own
            needed |= of_tyre if of_tyre & set(file.VALUES) else set()
        missing, strange = sorted(needed - set(file.VALUES)), sorted(set(file.VALUES) - set(declared))
        require(not missing, f"{name}: no value of {', '.join(missing)}")
        require(not strange, f"{name}: '{file.VEHICLE}' has no parameter {', '.join(strange)} on any tyre")
        for parameter, value in file.VALUES.items():
            p = declared[parameter]
            require(
                p.lower <= value <= p.upper, f"{name}: {parameter} = {value:g} is outside {p.lower:g} to {p.upper:g}"
            )
        std = getattr(file, "STD", {})
        strange = sorted(set(std) - set(file.VALUES))
        require(not strange, f"{name}: STD of what has no value: {', '.join(strange)}")
        require(all(s > 0 for s in std.values()), f"{name}: a standard deviation that is not positive")
        problems = vehicle.check(file.VALUES) if hasattr(vehicle, "check") else []
        require(not problems, f"{name}: {'; '.join(map(str, problems))}")
        _check_noise(name, file, vehicle)


def _check_noise(name: str, file: ModuleType, vehicle: ModuleType) -> None:
    lacking = sorted(set(vehicle.STATES) - set(file.PROCESS_NOISE))
    require(not lacking, f"{name}: every state needs a process noise, {', '.join(lacking)} has none")
    strange = sorted(set(file.PROCESS_NOISE) - {*vehicle.STATES, *vehicle.INPUTS})
    require(not strange, f"{name}: PROCESS_NOISE of what is neither state nor input: {', '.join(strange)}")
    require(all(q >= 0 for q in file.PROCESS_NOISE.values()), f"{name}: a negative process noise")
    require(all(r > 0 for r in file.MEASUREMENT_NOISE.values()), f"{name}: a measurement noise that is not positive")
    require(0 < file.NOISE_STEP <= 1, f"{name}: NOISE_STEP is in s, got {file.NOISE_STEP:g}")
    tyre = tyres_of(file.VEHICLE)[0]
    measured = {o for s in fitting_sensors(file.VEHICLE, tyre) for o in model(file.VEHICLE, tyre, s).outputs}
    lacking = sorted(measured - set(file.MEASUREMENT_NOISE))
    require(not lacking, f"{name}: every sensor that fits needs a measurement noise, {', '.join(lacking)} has none")
    published = model(file.VEHICLE, tyre)
    strange = sorted(set(file.MEASUREMENT_NOISE) - {*published.states, *published.inputs, *published.ports})
    require(not strange, f"{name}: MEASUREMENT_NOISE of what '{file.VEHICLE}' does not publish: {', '.join(strange)}")


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


def check_reader(reader: str | ModuleType, example: str | os.PathLike[str] | None = None) -> None:
    """Check a reader: that its suffixes are its own, and that it reads an example.

    Args:
        reader: Its name, or a module.
        example: A recording of its format.

    Raises:
        AssertionError: If something does not hold; the message says what.
        UserError: If the example cannot be read.
    """
    with named(READERS, reader) as name:
        file = READERS.load(name)
        require(file.__doc__, f"{name}: write a docstring: its first line is what 'harness list' shows")
        require(file.SUFFIXES, f"{name}: SUFFIXES is empty")
        for suffix in file.SUFFIXES:
            right = suffix == "/" or (suffix.startswith(".") and suffix == suffix.lower())
            require(right, f"{name}: suffix '{suffix}' must be lower case with a dot, or '/' for a folder")
            require(suffixes()[suffix] == name, f"{name}: suffix '{suffix}' is that of another reader")
        if example is None:
            return
        for table in read_tables(example):
            lengths = {len(column) for column in table.columns.values()}
            require(len(lengths) == 1, f"{name}: columns of one table have lengths {sorted(lengths)}")
            wrong = [n for n, c in table.columns.items() if np.asarray(c).dtype != np.float64 or np.ndim(c) != 1]
            require(not wrong, f"{name}: no float64 vectors: {', '.join(wrong)}")
