"""What holds for every file in ``models/tyres``, on a rig that sets slip and load."""

from __future__ import annotations

import types

import pytest

from harness.models.assembly.assemble import assemble
from harness.models.contracts import Parameter
from harness.models.roles import TYRES
from harness.testing import check_tyre
from harness.testing.tyres import CAPACITY, STIFFNESS, force, loads, rig, tables


@pytest.mark.parametrize("name", TYRES.names())
def test_every_tyre(name):
    check_tyre(name)


@pytest.mark.parametrize("name", TYRES.names())
def test_some_parameter_set_has_values(name):
    assert tables(name)


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


# --- the check finds what it is for


def tyre(force, unit="N/rad") -> types.ModuleType:
    module = types.ModuleType("straight")
    module.__doc__ = "Force over slip angle."
    module.PARAMETERS = (Parameter("slope", "C", unit, 1e2, 1e6, "slope of the force"),)
    module.lateral_force = force
    return module


def test_a_right_tyre_passes():
    check_tyre(tyre(lambda t: t.p("slope") * t.slip_angle), {"slope": 1e5})


@pytest.mark.parametrize(
    ("wrong", "says"),
    [
        (tyre(lambda t: -t.p("slope") * t.slip_angle), "not to its own side"),
        (tyre(lambda t: t.p("slope") * (t.slip_angle + t.slip_angle**2)), "to the right"),
        (tyre(lambda t: t.p("slope") * (t.slip_angle + 0.01)), "a force without slip"),
        (tyre(lambda t: t.p("slope") * t.slip_angle, "N"), None),
        (tyre(lambda t: t.p("slope") * t.slip_angle, "N*s"), "instead of"),
    ],
)
def test_a_wrong_tyre_is_found(wrong, says):
    if says is None:  # an angle is a plain number
        check_tyre(wrong, {"slope": 1e5})
        return
    with pytest.raises(AssertionError, match=says):
        check_tyre(wrong, {"slope": 1e5})
