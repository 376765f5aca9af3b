"""What holds for every file in ``models/vehicles`` on every tyre."""

from __future__ import annotations

import types

import numpy as np
import pytest
import sympy as sp

from harness.common.errors import ModelError
from harness.models.assembly.assemble import assemble, symbol
from harness.models.assembly.expressions import larger
from harness.models.contracts import Parameter
from harness.models.roles import ROLES
from harness.models.signals import SIGNALS
from support.dimensions import (
    DimensionError,
    assemble_with_units,
    check_dimensions,
    check_parameters,
    dimension,
    dimension_of,
)
from support.parts import (
    COMBINATIONS,
    SENSORS,
    TYRES,
    VEHICLES,
    evaluate,
    load,
    model,
    random_point,
    sets_of,
)


@pytest.mark.parametrize("name", VEHICLES)
def test_exports_are_complete_and_named_as_in_the_table_of_signals(name):
    vehicle = load("vehicles", name)
    assert all(hasattr(vehicle, export) for export in ROLES["vehicles"].exports)
    assert vehicle.__doc__
    assert len(set(vehicle.STATES)) == len(vehicle.STATES) > 0
    assert not [s for s in (*vehicle.STATES, *vehicle.INPUTS) if s not in SIGNALS]
    assert not set(vehicle.STATES) & set(vehicle.INPUTS)
    assert set(vehicle.VALID) <= set(vehicle.STATES)
    assert all(0 < limit < np.inf for limit in vehicle.VALID.values())
    assert set(getattr(vehicle, "START_VARIANCE", {})) <= set(vehicle.STATES)
    assert sets_of(name), f"no file in models/parameters says VEHICLE = '{name}', so nobody can run it"


@pytest.mark.parametrize("name", VEHICLES)
def test_parameters_have_units_bounds_and_a_meaning(name):
    check_parameters(load("vehicles", name).PARAMETERS)


@pytest.mark.parametrize(("vehicle", "tyre"), COMBINATIONS)
def test_every_state_has_a_derivative_of_known_quantities(vehicle, tyre):
    built = model(vehicle, tyre)
    assert len(built.derivatives) == len(built.states)
    known = {*built.states, *built.inputs, *built.parameter_names, *built.ports, "time"}
    read = {s.name for e in (*built.derivatives, *built.ports.values()) for s in e.free_symbols}
    assert read <= known
    assert set(built.rates.values()) <= set(built.inputs)
    for axle in built.axles:
        for port in ("slip_angle", "vertical_load", "steady_lateral_force"):
            assert f"{port}_axle_{axle}" in built.ports


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_every_parameter_is_read(vehicle):
    """On one tyre at least: a linear tyre knows no friction."""
    read, declared = set(), set()
    for name, tyre in COMBINATIONS:
        if name == vehicle:
            built = model(vehicle, tyre)
            declared |= set(built.parameter_names)
            read |= set(built.start.values())
            expressions = (*built.derivatives, *built.ports.values())
            read |= {s.name for e in expressions for s in e.free_symbols}
    assert sorted(declared - read) == []


@pytest.mark.parametrize(("vehicle", "tyre"), COMBINATIONS)
def test_every_equation_is_right_in_its_units(vehicle, tyre):
    tyre_file = None if tyre is None else load("tyres", tyre)
    built = assemble_with_units(load("vehicles", vehicle), tyre_file)
    assert check_dimensions(built) == len(built.ports) + len(built.states)


@pytest.mark.parametrize(("vehicle", "tyre"), COMBINATIONS)
def test_equations_are_finite_wherever_they_are_valid(vehicle, tyre):
    built = model(vehicle, tyre)
    rng = np.random.default_rng(0)
    for _ in range(20):
        found = evaluate(built, list(built.derivatives), random_point(built, vehicle, rng))
        assert np.isfinite(found).all()


@pytest.mark.parametrize(("vehicle", "tyre"), COMBINATIONS)
def test_a_standstill_is_finite(vehicle, tyre):
    built = model(vehicle, tyre)
    point = random_point(built, vehicle, np.random.default_rng(1))
    point |= dict.fromkeys((*built.states, *built.inputs), 0.0)
    assert np.isfinite(evaluate(built, list(built.derivatives), point)).all()


@pytest.mark.parametrize("vehicle", VEHICLES)
def test_some_sensor_set_fits(vehicle):
    fits = []
    for sensors in SENSORS:
        try:
            fits.append(assemble(vehicle, TYRES[0] if load("vehicles", vehicle).AXLES else None, (), sensors))
        except ModelError:
            continue
    assert fits, f"no file in models/sensors measures what '{vehicle}' publishes"


# --- the check of dimensions finds what it is for


def cart(rate) -> types.ModuleType:
    module = types.ModuleType("cart")
    module.STATES, module.INPUTS, module.AXLES, module.VALID = ("speed_tractor",), ("speed",), {}, {}
    module.PARAMETERS = (
        Parameter("mass", "m", "kg", 1.0, 10.0, "mass"),
        Parameter("drag", "k", "N*s/m", 1.0, 10.0, "drag"),
    )
    module.equations = lambda v: v.derivative("speed_tractor", rate(v))
    return module


def test_dimensions_accept_a_right_equation():
    right = cart(lambda v: v.p("drag") / v.p("mass") * (v.input("speed") - v.state("speed_tractor")))
    assert check_dimensions(assemble_with_units(right, None)) == 1


@pytest.mark.parametrize(
    ("rate", "says"),
    [
        (lambda v: v.p("drag") * v.state("speed_tractor"), "instead of"),
        (lambda v: v.p("drag") / v.p("mass") * (v.input("speed") + v.p("mass")), "mixes"),
        (lambda v: v.p("drag") / v.p("mass") * (v.input("speed") + 0.3), "mixes"),
        (lambda v: sp.sin(v.input("speed")), "plain number"),
        (lambda v: larger(v.input("speed"), v.p("mass")), "mixes"),
        (lambda v: v.p("mass") ** v.p("drag"), "plain number"),
        (lambda v: v.p("mass") ** (v.state("speed_tractor") / v.input("speed")), "not fixed"),
        (lambda v: sp.Piecewise((v.input("speed"), v.p("mass") > v.p("drag")), (0, True)), "mixes"),
        (lambda v: sp.gamma(v.input("speed")), "no rule"),
    ],
)
def test_dimensions_refuse_a_wrong_equation(rate, says):
    with pytest.raises(DimensionError, match=says):
        check_dimensions(assemble_with_units(cart(rate), None))


def test_dimensions_of_functions():
    known = {"v": dimension_of("m/s"), "w": dimension_of("km/h"), "n": dimension_of("rad")}
    v, w, n = (symbol(s) for s in "vwn")
    speed, pure = dimension_of("m/s"), dimension_of("")
    assert dimension(sp.sqrt(v**2 + w**2), known) == speed
    assert dimension(sp.Abs(v) + larger(v, 0), known) == speed
    assert dimension(sp.atan2(v, w) + n + sp.atan(v / w) + sp.sign(v), known) == pure
    assert dimension(sp.Piecewise((v, (v > w) & (n > 0)), (0, True)), known) == speed
    assert dimension(sp.Integer(0), known) is None
