import math

import pytest

from harness.errors import UserError
from harness.units import scale, to_si


@pytest.mark.parametrize(
    ("value", "unit", "expected"),
    [
        (24, "kg", 24.0),
        (0.5, "", 0.5),
        ("24 t", "kg", 24e3),
        ("24 metric_ton", "kg", 24e3),
        ("5 %", "", 0.05),
        ("5 %", "dimensionless", 0.05),
        ("60 deg", "rad", math.pi / 3),
        ("60°", "rad", math.pi / 3),
        ("-36 km/h", "m/s", -10.0),
        ("0.2 Hz", "Hz", 0.2),
        ("60 rpm", "rad/s", 2 * math.pi),
        ("8.5e5 N/rad", "N/rad", 8.5e5),
        ("8 kN/deg", "N/rad", 8e3 * 180 / math.pi),
        ("10 kg*m**2", "kg*m^2", 10.0),
        ("2 min", "s", 120.0),
        ("20 degC", "K", 293.15),
    ],
)
def test_converts(value, unit, expected):
    assert to_si(value, unit, "study.toml, key") == pytest.approx(expected, rel=1e-12)


@pytest.mark.parametrize(
    ("value", "unit", "message"),
    [
        ("60 deg", "m/s", "does not fit; a quantity in m/s is expected"),
        ("60 deg", "", "does not fit; a quantity without a unit"),
        ("5 %", "rad", "does not fit"),
        ("60 rpm", "Hz", "does not fit"),
        ("3 ton", "kg", "short ton; write 't'"),
        ("5", "kg", "has no unit; write e.g. '5 kg'"),
        ("0.9", "", "has no unit; write it without quotes"),
        ("5 foo", "kg", "'foo' is not defined"),
        ("heavy", "kg", "not a number with a unit; write e.g. '24 t'"),
        ("kg", "kg", "not a number with a unit"),
        ("", "kg", "not a number with a unit"),
        ("1/0 kg", "kg", "cannot read"),
        ("1e999 kg", "kg", "not a finite number"),
        (float("nan"), "kg", "not a finite number"),
        (True, "kg", "expected a number in kg"),
        ([1], "kg", "expected a number in kg"),
        (None, "", "expected a number without a unit"),
    ],
)
def test_refuses_and_says_where(value, unit, message):
    with pytest.raises(UserError) as error:
        to_si(value, unit, "study.toml, plant.values.trailer_mass")
    assert str(error.value).startswith("study.toml, plant.values.trailer_mass: ")
    assert message in str(error.value)


def test_scale_between_units():
    assert scale("deg/s", "rad/s", "map") == pytest.approx(math.pi / 180)
    assert scale("km/h", "m/s", "map") == pytest.approx(1 / 3.6)
    assert scale("", "", "map") == 1.0
    with pytest.raises(UserError, match="map: '1 deg' does not fit"):
        scale("deg", "m", "map")
