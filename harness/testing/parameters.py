"""What holds for every parameter set."""

from __future__ import annotations

from types import ModuleType

from harness.models.contracts import Parameter
from harness.models.roles import PARAMETERS
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
