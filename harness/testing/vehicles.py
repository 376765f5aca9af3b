"""What holds for every vehicle on every tyre."""

from __future__ import annotations

from types import ModuleType

import numpy as np

from harness.models.assembly.plan import Planner
from harness.models.roles import VEHICLES
from harness.models.signals import SIGNALS
from harness.testing.dimensions import assemble_with_units, check_dimensions, check_parameters
from harness.testing.parts import (
    evaluate,
    fitting_sensors,
    load,
    model,
    named,
    random_point,
    require,
    sets_of,
    tyres_of,
)


def check_vehicle(vehicle: str | ModuleType) -> None:
    """Check a vehicle: exports, names, units of every equation, bounds, and that every state has a derivative.

    Args:
        vehicle: Its name, or a module that keeps the contract (``harness/models/contracts.py``). A parameter set and
            a set of sensors for it must be there, because nobody can run it without.

    Raises:
        AssertionError: If something does not hold; the message says what.
        ModelError: If it cannot be assembled.
    """
    with named(VEHICLES, vehicle) as name:
        _check_exports(name)
        check_parameters(load("vehicles", name).PARAMETERS)
        for tyre in tyres_of(name):
            _check_equations(name, tyre)
            _check_numbers(name, tyre)
        _check_every_parameter_is_read(name)
        fits = fitting_sensors(name, tyres_of(name)[0])
        require(fits, f"no set of sensors measures what '{name}' publishes; add one")
        usual = getattr(load("vehicles", name), "USUAL", {})
        for what, there in (("parameters", sets_of(name)), ("sensors", fits)):
            require(
                usual.get(what, there[0]) in there, f"{name}: USUAL names {what} that do not fit; there are {there}"
            )


def _check_exports(name: str) -> None:
    file = load("vehicles", name)
    require(file.__doc__, f"{name}: write a docstring: its first line is what 'harness list' shows")
    require(len(file.STATES) > 0, f"{name}: STATES is empty")
    require(len(set(file.STATES)) == len(file.STATES), f"{name}: STATES names one twice")
    model(name, tyres_of(name)[0])  # brings its signals
    strange = [s for s in (*file.STATES, *file.INPUTS) if s not in SIGNALS]
    require(not strange, f"{name}: no signals: {', '.join(strange)}; state them in SIGNALS of the file")
    both = set(file.STATES) & set(file.INPUTS)
    require(not both, f"{name}: states and inputs at once: {', '.join(sorted(both))}")
    require(set(file.VALID) <= set(file.STATES), f"{name}: VALID names what is no state")
    require(all(0 < limit < np.inf for limit in file.VALID.values()), f"{name}: VALID must be positive and finite")
    _check_outline(name)
    first = set(getattr(file, "START_VARIANCE", {}))
    require(first <= set(file.STATES), f"{name}: START_VARIANCE names what is no state")
    require(sets_of(name), f"{name}: no parameter set says VEHICLE = '{name}', so nobody can run it")


def _check_outline(name: str) -> None:
    """Check that bodies that the vehicle has the ends of hold their axles."""
    file = load("vehicles", name)
    if not hasattr(file, "outline"):
        return
    for fitting in sets_of(name):
        values = load("parameters", fitting).VALUES
        plan = Planner(model(name, tyres_of(name)[0]), file).plan(values)
        require(plan is not None, f"{name}: outline, but the equations do not say where the axles stand")
        assert plan is not None
        strange = sorted(set(file.outline(dict(values))) - set(plan.outlines))
        require(not strange, f"{name}: outline names {', '.join(strange)}, which BODIES has not")
        for axle, at in plan.axles.items():
            ends = plan.outlines[at.body]
            require(
                not ends.stated or (ends.back <= at.x <= ends.front and ends.width > 0),
                f"{name}: axle {axle} lies {at.x:.2f} m ahead of the CoG, outside the outline of its body",
            )


def _check_equations(name: str, tyre: str | None) -> None:
    built = model(name, tyre)
    require(len(built.derivatives) == len(built.states), f"{name}: not every state has one derivative")
    provided = {*built.states, *built.inputs, *built.parameter_names, *built.ports, "time"}
    read = {s.name for e in (*built.derivatives, *built.ports.values()) for s in e.free_symbols}
    require(read <= provided, f"{name}: equations read what nothing provides: {', '.join(sorted(read - provided))}")
    require(set(built.rates.values()) <= set(built.inputs), f"{name}: a rate of what is no input")
    for axle in built.axles:
        for port in ("slip_angle", "vertical_load", "steady_lateral_force"):
            require(f"{port}_axle_{axle}" in built.ports, f"{name}: publishes no {port}_axle_{axle}; call v.tyre(...)")
    tyre_file = None if tyre is None else load("tyres", tyre)
    checked = check_dimensions(assemble_with_units(load("vehicles", name), tyre_file))
    require(checked == len(built.ports) + len(built.states), f"{name}: not every equation has a unit")


def _check_numbers(name: str, tyre: str | None) -> None:
    """Check that equations are finite wherever they hold, and at a standstill."""
    built = model(name, tyre)
    if not any(set(built.parameter_names) <= set(load("parameters", s).VALUES) for s in sets_of(name)):
        return  # a tyre that nobody has values for
    rng = np.random.default_rng(0)
    still = random_point(built, name, rng) | dict.fromkeys((*built.states, *built.inputs), 0.0)
    for point in (still, *(random_point(built, name, rng) for _ in range(20))):
        rates = evaluate(built, list(built.derivatives), point)
        at = "at a standstill" if point is still else f"at {point}"
        bad = [s for s, rate in zip(built.states, rates, strict=True) if not np.isfinite(rate)]
        require(not bad, f"{name}: the derivative of {', '.join(bad)} is not finite {at}")


def _check_every_parameter_is_read(name: str) -> None:
    """On one tyre at least: a linear tyre knows no friction."""
    read: set[str] = set()
    declared: set[str] = set()
    for tyre in tyres_of(name):
        built = model(name, tyre)
        declared |= set(built.parameter_names)
        read |= {source for source in built.start.values() if isinstance(source, str)}
        read |= {s.name for e in (*built.derivatives, *built.ports.values()) for s in e.free_symbols}
    require(declared <= read, f"{name}: parameters that nothing reads: {', '.join(sorted(declared - read))}")
