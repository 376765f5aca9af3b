import math
import os
import subprocess
import sys

import pytest

from harness.common import units
from harness.common.errors import UserError
from harness.common.units import plain_number, refuse_misread, scale, to_si


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
        ("−36 km/h", "m/s", -10.0),  # the minus of typography
        ("- 10 %", "", -0.1),
        ("5 m s⁻²", "m/s^2", 5.0),
        ("2 (m/s)**2", "m^2/s^2", 2.0),
        ("5 1/min", "1/s", 1 / 12),
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
        ("0.3 g", "m/s^2", "'g' is the gram, standard gravity is 'g_0'"),
        ("3 ton", "kg", "short ton; write 't'"),
        ("5", "kg", "has no unit; write e.g. '5 kg'"),
        ("0.9", "", "has no unit; write it without quotes"),
        ("5 foo", "kg", "'foo' is not defined"),
        ("heavy", "kg", "not a number with a unit; write e.g. '24 t'"),
        ("kg", "kg", "not a number with a unit"),
        ("", "kg", "not a number with a unit"),
        ("1/0 kg", "kg", "cannot read"),
        ("1e3,5 kg", "kg", "cannot read '1e3,5 kg' as one number with one unit"),
        ("2**3 m", "m", "as one number"),
        ("5 m + 3 m", "m", "as one number"),
        ("5(3) m", "m", "as one number"),
        ("5±1 m", "m", "as one number"),
        ("5 10 m", "m", "as one number"),
        ("1 .5 m", "m", "as one number"),
        ("1²m", "m", "as one number"),
        ("5 kg,", "kg", "as one number"),
        ("1.5.3 kg", "kg", "as one number"),
        ("１５ kg", "kg", "not a number with a unit"),
        ("nan", "kg", "'nan' is not a finite number"),
        ("-inf", "", "'-inf' is not a finite number"),
        ("1e999 kg", "kg", "not a finite number"),
        ("1e160 kg", "kg", "'1e160 kg' is too large to be squared; write 0, or a size from 1e-150 to 1e150"),
        (-5e-324, "", "-5e-324 is too small to be squared"),
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


@pytest.mark.parametrize(
    ("text", "readings"),
    [
        ("1,5 m/s", ["1.5 m/s", "15 m/s"]),
        ("24,5 t", ["24.5 t", "245 t"]),
        ("-0,5 m", ["-0.5 m", "-5 m"]),
        ("−1,5e-3 m", ["-1.5e-3 m", "-15e-3 m"]),
        (",5 m", ["0.5 m", "5 m"]),
        ("1,5", ["1.5", "15"]),
        ("1.500,5 kg", ["1500.5 kg", "15005 kg"]),
        ("1 500,5 kg", ["1500.5 kg", "15005 kg"]),
        ("1,500.5 kg", ["1500.5 kg"]),
        ("1,500,000 kg", ["1500000 kg"]),
        ("1.500.000 kg", ["1500000 kg"]),
        ("1 500 kg", ["1500 kg"]),
        ("1\u202f500 kg", ["1500 kg"]),
        ("1_500 kg", ["1500 kg"]),
        ("1_5", ["15"]),
        ("1'500 kg", ["1500 kg"]),
        ("1’500 kg", ["1500 kg"]),
        ("5 000/min", ["5000/min"]),
    ],
)
def test_separators_are_refused_with_what_may_be_meant(text, readings):
    """Pint alone makes 15 m/s of the first, 500 kg of ``1 500 kg`` and 0 of ``1 000 000 kg``."""
    with pytest.raises(UserError) as error:
        to_si(text, "kg", "study.toml, key")
    assert str(error.value).startswith(f"study.toml, key: {text!r} m")
    assert " or ".join(f"'{r}'" for r in readings) + "; write" in str(error.value)
    assert "decimal point, no thousands separator" in str(error.value)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize(
    ("text", "number"), [("1.5", 1.5), (" -2e3 ", -2e3), ("−2", -2.0), (".5", 0.5), ("inf", math.inf)]
)
def test_plain_numbers(text, number):
    assert plain_number(text) == number


@pytest.mark.parametrize("text", ["1_500", "1,5", "１５", "5 m", "", "sine", "1 500"])
def test_what_is_no_plain_number(text):
    assert plain_number(text) is None


@pytest.mark.parametrize("wrong", ["1,5", "1_000", "1 500", "nan", math.inf, [1.0, "2,5"], {"a": (math.nan,)}])
def test_settings_hold_no_number_that_pydantic_would_misread(wrong):
    with pytest.raises(UserError, match=r"^settings\.size"):
        refuse_misread({"size": wrong}, "settings")


def test_other_settings_pass():
    refuse_misread({"network": "2024_09_16.npz", "a": ["x, y", 1.5, True], "b": {"c": "1.5"}, "d": None}, "settings")


def test_scale_between_units():
    assert scale("deg/s", "rad/s", "map") == pytest.approx(math.pi / 180)
    assert scale("km/h", "m/s", "map") == pytest.approx(1 / 3.6)
    assert scale("", "", "map") == 1.0
    with pytest.raises(UserError, match="map: '1 deg' does not fit"):
        scale("deg", "m", "map")


def test_common_conversions_are_those_of_pint_to_the_bit():
    quantity = units.registry().Quantity
    for number in ("24.3", "1e-3", "-7", "123456789"):
        for unit, target in (("t", "kg"), ("deg", "rad"), ("km/h", "m/s"), ("%", "dimensionless"), ("kN/deg", "N/rad")):
            assert to_si(f"{number} {unit}", target, "x") == float(quantity(f"{number} {unit}").to(target).magnitude)


def test_a_second_process_reads_units_without_pint_and_what_it_reads_is_not_kept(tmp_path):
    """What is kept does not depend on data, so that no file makes the cache grow."""
    code = (
        "import sys; from harness.common.units import to_si; print(to_si('24 t', 'kg', 'x'), 'pint' in sys.modules); "
        "print(to_si('3 furlong', 'm', 'x') > 600)"
    )
    said = []
    for _ in range(2):
        environment = {**os.environ, "HARNESS_CACHE": str(tmp_path)}
        said.append(subprocess.run([sys.executable, "-c", code], env=environment, capture_output=True, text=True))
    assert [done.stdout.split() for done in said] == [["24000.0", here, "True"] for here in ("True", "False")]
    assert len(list((tmp_path / "conversions").iterdir())) == 1
