"""Tyre property files against Pacejka's equations, written here once more from the book and straight from the file."""

import re
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.config.tyre_file import TYRE, read_tyre_file
from harness.models.assembly.assemble import assemble
from harness.models.contracts import Parameter
from harness.testing.parts import evaluate
from harness.testing.tyres import FORCE, STIFFNESS, rig

FOLDER = Path(__file__).parents[2] / "../shared/tyres"
FILES = sorted(FOLDER.glob("*.tir"))
SLIPS = np.linspace(-0.35, 0.35, 29)

# Pacejka 2006, table A3.1 (205/60R15 91V, ISO), made a file of MF 6.1 with a dependence on pressure
BOOK = """[UNITS]\r
FORCE = 'newton'   $ a comment\r
{load table}\r
[MODEL]\r
FITTYP = 61  ! 6.1\r
TYRESIDE = 'LEFT'\r
FNOMIN = 4000\r\nNOMPRES = 220000\r\nINFLPRES = 250000\r\nUNLOADED_RADIUS = 0.313\r
PCY1 = 1.193\r\nPDY1 = -0.990\r\nPDY2 = 0.145\r\nPDY3 = -11.23\r\nPEY1 = -1.003\r\nPEY2 = -0.537\r\nPEY3 = -0.083\r
PEY4 = -4.787\r\nPEY5 = 2.5\r\nPKY1 = -14.95\r\nPKY2 = 2.130\r\nPKY3 = -0.028\r\nPKY4 = 1.9\r\nPKY5 = 0.3\r
PKY6 = -0.92\r\nPKY7 = -0.24\r\nPHY1 = 0.003\r\nPHY2 = -0.001\r\nPVY1 = 0.045\r\nPVY2 = -0.024\r\nPVY3 = -0.532\r
PVY4 = 0.039\r\nPPY1 = -0.6\r\nPPY2 = -0.06\r\nPPY3 = -0.16\r\nPPY4 = 0.22\r\nPPY5 = 0.15\r
LFZO = 0.9\r\nLCY = 1.05\r\nLMUY = 0.8\r\nLEY = 1.1\r\nLKY = 0.95\r\nLKYC = 0.9\r
LATERAL_STIFFNESS = 120000\r\nPCFY1 = 0.1\r\nPCFY2 = 0.02\r\nPCFY3 = 0.3\r
"""


def raw(text):
    """The numbers of a file by key."""
    return {k: float(v) for k, v in re.findall(r"^\s*(\w+)\s*=\s*([-+.\deE]+)(?=\s|$)", text.replace("\r", ""), re.M)}


def single(p, alpha, gamma, load, new, symmetric=False):
    """Lateral force of one tyre in the axes of its file: Pacejka 2012, 4.E19 to 4.E30; Pacejka 2006, 4.E19 to 4.E30."""
    g = dict.fromkeys(("PEY5", "PKY5", "PKY6", "PKY7", "PHY3", *(f"PPY{i}" for i in range(1, 6))), 0.0) | p
    if symmetric:
        g |= dict.fromkeys(("PHY1", "PHY2", "PVY1", "PVY2", "PEY3"), 0.0)
    s = {k: g.get(k, 1.0) for k in ("LFZO", "LCY", "LMUY", "LEY", "LKY", "LKYC", "LGAY")}
    fz0 = g["FNOMIN"] * s["LFZO"]
    df = (load - fz0) / fz0
    dp = (g["INFLPRES"] - g["NOMPRES"]) / g["NOMPRES"] if new else 0.0
    x, y = (np.tan(alpha), gamma) if new else (alpha, gamma * s["LGAY"])
    mu = (g["PDY1"] + g["PDY2"] * df) * (1 + g["PPY3"] * dp + g["PPY4"] * dp**2) * (1 - g["PDY3"] * y**2) * s["LMUY"]
    D, C = mu * load, g["PCY1"] * s["LCY"]
    turn = g.get("PKY4", 2.0) * np.arctan(load / fz0 / ((g["PKY2"] + g["PKY5"] * y**2) * (1 + g["PPY2"] * dp)))
    K = g["PKY1"] * fz0 * (1 + g["PPY1"] * dp) * (1 - g["PKY3"] * abs(y)) * np.sin(turn) * s["LKY"]
    low = 10 * s["LMUY"] / (1 + 9 * s["LMUY"]) if new else s["LMUY"]
    S_Vg = load * (g["PVY3"] + g["PVY4"] * df) * y * low * (s["LKYC"] if new else 1.0)
    S_V = load * (g["PVY1"] + g["PVY2"] * df) * low + S_Vg
    K_g = load * (g["PKY6"] + g["PKY7"] * df) * (1 + g["PPY5"] * dp) * s["LKYC"]
    S_H = g["PHY1"] + g["PHY2"] * df + ((K_g * y - S_Vg) / K if new else g["PHY3"] * y)
    a = x + S_H
    E = (g["PEY1"] + g["PEY2"] * df) * (1 + g["PEY5"] * y**2 - (g["PEY3"] + g["PEY4"] * y) * np.sign(a)) * s["LEY"]
    B = K / (C * D)
    return D * np.sin(C * np.arctan(B * a - np.minimum(E, 1.0) * (B * a - np.arctan(B * a)))) + S_V


def axle(p, slip, gamma, load, tyres, new, symmetric=True):
    """Force to the left of an axle of mirrored tyres; the slip angle of the harness is positive to that side."""

    def f(alpha, camber):
        return single(p, alpha, camber, load / tyres, new, symmetric)

    return tyres / 2 * (f(-slip, gamma) - f(slip, -gamma))


@pytest.fixture(scope="module")
def cambered():
    module = rig()
    module.PARAMETERS += (Parameter("camber", "g", "rad", -1.0, 1.0, "camber"),)

    def equations(v):
        force = v.tyre("11", v.input("road_wheel_angle"), v.p("axle_load"), v.p("friction"), v.p("camber"))
        v.derivative("lateral_force_axle_11", v.input("speed") / v.p("relaxation_length") * force)

    module.equations = equations
    return assemble(module, TYRE)


def force(model, coefficients, slip, gamma, load, tyres=2.0, friction=1.0, wanted=FORCE):
    point = {"lateral_force_axle_11": 0.0, "speed": 10.0, "road_wheel_angle": slip, "axle_load": load, "camber": gamma}
    point |= {"friction": friction, "relaxation_length": 0.4, "tyres_11": tyres}
    return evaluate(model, [model.resolve(wanted)], point | {f"{k}_11": v for k, v in coefficients.items()})[0]


def written(folder, text, name="tyre.tir"):
    (folder / name).write_bytes(text.encode("latin-1"))
    return folder / name


def agrees(model, tyre, numbers, new, tyres=2.0):
    for share in (0.4, 1.0, 1.8):
        load = tyres * share * tyre.coefficients["nominal_load"]
        for gamma in (0.0, 0.06, -0.06):
            for slip in SLIPS:
                there = force(model, tyre.coefficients, slip, gamma, load, tyres)
                assert there == pytest.approx(axle(numbers, slip, gamma, load, tyres, new), rel=1e-10, abs=1e-6 * load)


@pytest.mark.skipif(not FILES, reason="needs the property files in ../shared/tyres")
@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_an_axle_is_twice_its_mirrored_tyres_at_half_the_load(cambered, file):
    tyre, numbers = read_tyre_file(file), raw(file.read_text("latin-1"))
    agrees(cambered, tyre, numbers, new=False)
    load = 2 * tyre.coefficients["nominal_load"]
    # What is asymmetric is left out; of the whole tyres, left and right, the axle differs by so much of its load.
    whole = axle(numbers, SLIPS, 0.0, load, 2, False, symmetric=False)
    assert np.abs(whole - axle(numbers, SLIPS, 0.0, load, 2, False)).max() < 0.0014 * load


@pytest.mark.skipif(not FILES, reason="needs the property files in ../shared/tyres")
def test_relaxation_length_of_the_sedan():
    tyre = read_tyre_file(FOLDER / "Sedan_Pac02Tire.tir")
    # PTY1 sin(2 atan(Fz / (PTY2 Fz0'))) R0 LFZO of its numbers at 4000 N
    expected = 2.1439 * np.sin(2 * np.arctan(4000 / (1.9829 * 4850 * 0.81))) * 0.344 * 0.81
    assert tyre.relaxation(4000.0) == pytest.approx(expected, rel=1e-12)
    assert read_tyre_file(FOLDER / "335_65R22_5_G275MSA_40psi.tir").relaxation(2e4) == 0.0  # all its PTY are zero


def test_mf_61_with_pressure_camber_and_scaling_factors(cambered, tmp_path):
    tyre = read_tyre_file(written(tmp_path, BOOK))
    agrees(cambered, tyre, raw(BOOK), new=True)
    assert tyre.kind == "MF 6.1"
    slope = force(cambered, tyre.coefficients, 0.0, 0.0, 8000.0, wanted=STIFFNESS)
    assert slope == pytest.approx(2 * tyre.stiffness(4000.0), rel=1e-12)
    lateral = 120000 * (1 + 0.1 * (4000 / 3600 - 1) + 0.02 * (4000 / 3600 - 1) ** 2) * (1 + 0.3 * (25 / 22 - 1))
    assert tyre.relaxation(4000.0) == pytest.approx(slope / 2 / lateral, rel=1e-12)


def test_mf_52_with_scaling_factors(cambered, tmp_path):
    old = re.sub("(?m)^(PKY[4567]|PEY5|PPY|LKYC|NOMPRES|INFLPRES).*\r\n", "", BOOK) + "PHY3 = 0.04\r\nLGAY = 0.7\r\n"
    old = old.replace("FITTYP = 61", "FITTYP = 6")
    agrees(cambered, read_tyre_file(written(tmp_path, old)), raw(old), new=False)


def test_published_tyre_has_its_stiffness_and_friction(tmp_path):
    """Pacejka 2006, table A3.1: 14.95 F_z0 sin(2 atan(1 / 2.13)) = 59800 4.26 / 5.5369 N/rad, by hand."""
    plain = "\n".join(
        line for line in BOOK.replace("\r", "").split("\n") if not re.match(r"L|PPY|PKY4|PEY5|PKY5", line)
    )
    tyre = read_tyre_file(written(tmp_path, plain))
    assert tyre.stiffness(4000.0) == pytest.approx(46009.0, abs=1.0)
    assert tyre.coefficients["pdy1"] == 0.990


def test_twin_tyres_carry_a_quarter_each(cambered, tmp_path):
    agrees(cambered, read_tyre_file(written(tmp_path, BOOK)), raw(BOOK), new=True, tyres=4.0)


def test_the_road_scales_the_peak_and_not_the_stiffness(cambered, tmp_path):
    c = read_tyre_file(written(tmp_path, BOOK)).coefficients
    wet, dry = (force(cambered, c, 0.5, 0.0, 8000.0, friction=f) for f in (0.4, 1.0))
    assert wet == pytest.approx(0.4 * dry, rel=0.08)
    wet, dry = (force(cambered, c, 1e-6, 0.0, 8000.0, friction=f) for f in (0.4, 1.0))
    assert wet == pytest.approx(dry, rel=1e-6)


SIGNED = r"(?m)^(PKY1|PDY1|PDY2|PVY\d|PKY6|PKY7) = "


@pytest.mark.parametrize("side", ["LEFT", "RIGHT", "UNKNOWN"])
def test_signs_of_iso_and_adapted_sae_and_either_side_give_one_axle(tmp_path, side):
    """In adapted SAE the force is positive to the right, slip angle and camber are as in ISO."""
    adapted = re.sub(SIGNED, r"\1 = -", BOOK).replace("--", "").replace("'LEFT'", f"'{side}'")
    iso, sae = (read_tyre_file(written(tmp_path, text)).coefficients for text in (BOOK, adapted))
    assert sae == iso
    assert single(raw(adapted), 0.05, 0.02, 4000.0, True) == pytest.approx(-single(raw(BOOK), 0.05, 0.02, 4000.0, True))


def test_units_of_the_file(tmp_path):
    other = BOOK.replace("'newton'", "'kN'\nLENGTH = 'mm'\nPRESSURE = 'bar'").replace("FNOMIN = 4000", "FNOMIN = 4")
    other = other.replace("220000", "2.2").replace("250000", "2.5").replace("0.313", "313").replace("120000", "0.12")
    here, there = (read_tyre_file(written(tmp_path, text)) for text in (other, BOOK))
    assert here.coefficients == pytest.approx(there.coefficients, rel=1e-12)
    assert here.relaxation(5000.0) == pytest.approx(there.relaxation(5000.0), rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "says"),
    [
        ("FITTYP = 61", "FITTYP = 51", "FITTYP = 51; PAC2002 and Magic Formula"),
        ("FITTYP = 61", "PROPERTY_FILE_FORMAT = 'FTIRE'", "PROPERTY_FILE_FORMAT = FTIRE"),
        ("FITTYP = 61", "", "no tyre property file"),
        ("PKY1 = -14.95", "", "no PKY1"),
        ("PKY1 = -14.95", "PKY1 = 0", "the tyre has no force"),
        ("PKY1 = -14.95", "PKY1 = -14,95", r"line 20: PKY1: '-14,95' is no number"),
        ("PKY1 = -14.95", "PKY1 = nan", "is no number"),
        ("LFZO = 0.9", "LFZO = 1e300", "LFZO: 1e300 is larger than"),
        ("LFZO = 0.9", "LFZO = 0", "nominal_load = 0 N lies below"),
        ("FNOMIN = 4000", "FNOMIN = 1e-300", "the tyre has no force"),
        ("PKY1 = -14.95", "PKY1 = -14.95\nPKY1 = -15", "delete the wrong one"),
        ("FORCE = 'newton'", "ANGLE = 'degree'", "counts radians"),
        ("FORCE = 'newton'", "FORCE = 'tonne'", "FORCE = 'tonne' is not read"),
    ],
)
def test_what_is_refused_is_said(tmp_path, old, new, says):
    assert old in BOOK
    with pytest.raises(UserError, match=says):
        read_tyre_file(written(tmp_path, BOOK.replace(old, new)))


def test_no_file(tmp_path):
    with pytest.raises(UserError, match="there is no such file"):
        read_tyre_file(tmp_path / "tyre.tir")
