"""What holds for every file in ``models/tyres``, on a rig that sets slip and load."""

from __future__ import annotations

import types

import numpy as np
import pytest

from harness.models.assembly.assemble import Model, assemble
from harness.models.contracts import Parameter
from harness.models.roles import ROLES
from support.dimensions import assemble_with_units, check_dimensions, check_parameters
from support.parts import SETS, TYRES, evaluate, load

FORCE, STIFFNESS, CAPACITY = (
    f"{kind}_axle_11" for kind in ("steady_lateral_force", "cornering_stiffness", "lateral_force_capacity")
)
LOADS = (0.05, 0.5, 1.0, 2.0)
"""Axle loads over the load at which the set's cornering stiffness is largest: a model car is no truck."""

SLIPS = np.concatenate([np.geomspace(1e-6, 0.2, 12), [0.5, 1.0, 1.4]])


def rig() -> types.ModuleType:
    """Return a vehicle of one axle whose slip angle, load and friction are given."""
    module = types.ModuleType("rig")
    module.STATES, module.INPUTS = ("lateral_force_axle_11",), ("road_wheel_angle", "speed")
    module.AXLES, module.VALID = {"11": "11"}, {}
    module.PARAMETERS = (
        Parameter("axle_load", "F_z", "N", 1e2, 1e6, "load"),
        Parameter("friction", r"\mu", "dimensionless", 0.01, 2.0, "friction"),
        Parameter("relaxation_length", r"\ell", "m", 0.01, 2.0, "lag"),
    )

    def equations(v):
        steady = v.tyre("11", v.input("road_wheel_angle"), v.p("axle_load"), v.p("friction"))
        rate = v.input("speed") / v.p("relaxation_length") * (steady - v.state("lateral_force_axle_11"))
        v.derivative("lateral_force_axle_11", rate)

    module.equations = equations
    return module


def tables(tyre: str) -> list[dict[str, float]]:
    """Return the tyre's parameters of every axle group of every parameter set, renamed to the rig's axle."""
    names = [p.name for p in load("tyres", tyre).PARAMETERS]
    found = []
    for file in SETS:
        values, module = load("parameters", file).VALUES, load("parameters", file)
        groups = sorted(set(load("vehicles", module.VEHICLE).AXLES.values()))
        complete = [g for g in groups if all(f"{n}_{g}" in values for n in names)]
        found += [{f"{n}_11": values[f"{n}_{g}"] for n in names} for g in complete]
    return found


def loads(table: dict[str, float]) -> list[float]:
    """Return axle loads in N that suit a tyre."""
    return [share * table["stiffness_load_11"] for share in LOADS]


def force(built: Model, table, slip, load_, friction=0.9, wanted=(FORCE,)) -> np.ndarray:
    point = {"lateral_force_axle_11": 0.0, "speed": 10.0, "road_wheel_angle": slip, "axle_load": load_}
    point |= {"friction": friction, "relaxation_length": 0.4, **table}
    return evaluate(built, [built.resolve(name) for name in wanted], point)


@pytest.fixture(scope="module", params=TYRES)
def tyre(request):
    found = tables(request.param)
    assert found, f"no parameter set has values for tyre '{request.param}'"
    return assemble(rig(), request.param), found


@pytest.mark.parametrize("name", TYRES)
def test_exports_and_units(name):
    module = load("tyres", name)
    assert all(hasattr(module, export) for export in ROLES["tyres"].exports)
    assert module.__doc__
    check_parameters(module.PARAMETERS)
    assert check_dimensions(assemble_with_units(rig(), module)) >= 4


def test_no_slip_no_force_and_the_force_is_odd(tyre):
    built, found = tyre
    for table in found:
        for load_ in loads(table):
            assert force(built, table, 0.0, load_) == 0.0
            for slip in SLIPS:
                left, right = force(built, table, slip, load_), force(built, table, -slip, load_)
                assert left == pytest.approx(-right, rel=1e-12)
                assert left > 0  # to its own side


def test_the_slope_is_the_published_cornering_stiffness(tyre):
    built, found = tyre
    if STIFFNESS not in built.ports:
        pytest.skip("this tyre publishes no cornering stiffness")
    for table in found:
        for load_ in loads(table):
            stiffness = force(built, table, 0.0, load_, wanted=[STIFFNESS])[0]
            slope = force(built, table, 1e-8, load_)[0] / 1e-8  # a brush bends from the first slip on
            assert stiffness > 0
            assert slope == pytest.approx(stiffness, rel=1e-6)


def test_the_force_stays_within_the_published_capacity(tyre):
    built, found = tyre
    if CAPACITY not in built.ports:
        pytest.skip("this tyre has no limit")
    for table in found:
        for load_ in loads(table):
            for friction in (0.2, 0.9):
                at = [force(built, table, s, load_, friction, [FORCE, CAPACITY]) for s in SLIPS]
                reached, limit = np.array(at).T
                assert limit == pytest.approx(np.full(len(SLIPS), friction * load_))
                assert (np.abs(reached) <= limit * (1 + 1e-12)).all()
                assert reached.max() > 0.5 * limit[0]  # and the limit is one it comes near


def test_magic_formula_publishes_its_limit_and_linear_is_its_tangent():
    magic, linear = assemble(rig(), "magic_formula"), assemble(rig(), "linear")
    assert {CAPACITY, STIFFNESS} <= set(magic.ports)
    for table in tables("magic_formula"):
        straight = {n: table[n] for n in linear.parameter_names if n in table}
        for load_ in loads(table):
            for slip in (1e-4, 1e-3):
                curve, tangent = force(magic, table, slip, load_)[0], force(linear, straight, slip, load_)[0]
                # F = C tan(a) (1 - O(B^2 a^2)): the gap falls with the square of the slip.
                stiffness = force(linear, straight, 0.0, load_, wanted=[STIFFNESS])[0]
                bent = (stiffness / (0.9 * load_) * slip) ** 2
                assert -1e-15 <= 1 - curve / tangent < bent
