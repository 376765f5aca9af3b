"""What holds for every file in ``models/vehicles`` on every tyre."""

from __future__ import annotations

import types

import pytest
import sympy as sp

from harness.models.assembly.assemble import symbol
from harness.models.assembly.expressions import larger
from harness.models.contracts import Parameter
from harness.models.roles import VEHICLES
from harness.testing import check_vehicle
from harness.testing.dimensions import (
    DimensionError,
    assemble_with_units,
    check_dimensions,
    dimension,
    dimension_of,
)


@pytest.mark.parametrize("name", VEHICLES.names())
def test_every_vehicle(name):
    check_vehicle(name)


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
