"""``harness new parameters --tyre``: property files in, a parameter file and a page out."""

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import harness as h
from harness.cli.main import app
from harness.cli.tyre_page import four_coefficients, magic_formula
from harness.config.derived import axles_of

FOLDER = Path(__file__).parents[2] / "../shared/tyres"
FILES = sorted(FOLDER.glob("*.tir"))
TIR = """[MODEL]
PROPERTY_FILE_FORMAT = 'PAC2002'
[DIMENSION]
UNLOADED_RADIUS = 0.3
[VERTICAL]
FNOMIN = {load}
FZMIN = 200
FZMAX = {most}
[LATERAL_COEFFICIENTS]
PCY1 = 1.3
PDY1 = 1.0
PDY2 = -0.1
PEY1 = -0.5
PKY1 = -{stiff}
PKY2 = 2.0
PTY1 = 2.0
PTY2 = 2.0
"""


@pytest.fixture
def new(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    for name, load, stiff in (("front", 5000, 20), ("rear", 5000, 25), ("truck", 35000, 11)):
        Path(f"{name}.tir").write_text(TIR.format(load=load, most=2 * load, stiff=stiff), encoding="utf-8")

    def new(*words):
        done = CliRunner().invoke(app, ["new", "parameters", *map(str, words)])
        return done.exit_code, done.output

    return new


def test_a_file_for_each_axle_makes_a_parameter_file_and_a_page(new):
    status, printed = new("mine", "--tyre", "front.tir", "--tyre", "rear.tir")
    assert status == 0, printed
    assert "vehicle: car" in printed
    mine = h.model("car", "mine.toml")
    assert (mine.tyre, mine.effects) == ("magic_formula_61", ("tyre_relaxation",))
    values = mine.parameters.value
    assert (values.pky1_front, values.pky1_rear, values.tyres_front, values.friction) == (20.0, 25.0, 2.0, 1.0)
    load = 2303.1 * 9.81 * 1.4987 / (1.5213 + 1.4987) / 2  # of one front tyre of the Genesis
    length = 2.0 * np.sin(2 * np.arctan(load / (2.0 * 5000))) * 0.3
    assert values.tyre_relaxation_front == pytest.approx(length, rel=1e-9)
    stiffness = 2 * 20.0 * 5000 * np.sin(2 * np.arctan(load / 10000))
    assert f"cornering stiffness of all {stiffness / 1e3:.4g} kN/rad" in printed
    assert "four coefficients" in Path("mine-tyres.html").read_text(encoding="utf-8")
    assert Path("mine-tyres.pdf").stat().st_size > 10_000


def test_axles_by_name_and_twin_tyres(new):
    status, printed = new("truck", "--model", "semitrailer", "--tyre", "11=truck.tir", "--tyre", "2=truck.tir",
                          "--tyre", "12=truck.tir,twin")  # fmt: skip
    assert status == 0, printed
    values = h.model("semitrailer", "truck.toml").parameters.value
    assert [values[f"tyres_{g}"] for g in ("11", "12", "2")] == [2.0, 4.0, 2.0]
    load = axles_of(h.model("semitrailer", "truck.toml").spec).loads(dict(values))["12"] / 4
    length = 2.0 * np.sin(2 * np.arctan(load / (2.0 * 35000))) * 0.3
    assert values.relaxation_length_12 == pytest.approx(length, rel=1e-9)


def test_wheels_of_their_own_have_one_tyre_and_its_camber(new):
    assert new("two", "--model", "car_two_track", "--tyre", "front.tir")[0] == 0
    values = h.model("car_two_track", "two.toml").parameters.value
    assert (values.tyres_front, values.tyres_rear, values.camber_thrust) == (1.0, 1.0, 0.0)
    assert "pvy3_front" in values


def test_a_tyre_of_another_vehicle_is_pointed_out(new):
    status, printed = new("light", "--model", "semitrailer", "--tyre", "front.tir")
    assert status == 0
    assert "11: 36.8 kN is outside the loads of its measurements, 0.2 to 10 kN" in printed


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (
            ["--model", "semitrailer", "--tyre", "front.tir", "--tyre", "rear.tir"],
            "has the tyres 11, 12, 2; give one file",
        ),
        (["--tyre", "rear=rear.tir"], "--tyre front=FILE --tyre rear=FILE"),
        (["--tyre", "front=front.tir", "--tyre", "hind=rear.tir"], "--tyre front=FILE --tyre rear=FILE"),
        (["--model", "car_3dof", "--tyre", "front.tir"], "has no axles with tyres"),
        (["--tyre", "absent.tir"], "absent.tir: there is no such file"),
    ],
)
def test_what_does_not_fit_is_refused(new, words, says):
    status, printed = new("mine", *words)
    assert status == 2
    assert says in " ".join(printed.split())
    assert not Path("mine.toml").exists()


@pytest.mark.skipif(not FILES, reason="needs the property files in ../shared/tyres")
@pytest.mark.parametrize("file", FILES, ids=lambda f: f.stem)
def test_every_public_file_makes_a_model(new, file):
    file = file.resolve()
    vehicle = "semitrailer" if file.stem.startswith(("335", "City", "Generic")) else "car"
    status, printed = new("mine", "--model", vehicle, "--tyre", file)
    assert status == 0, printed
    spec = h.model(vehicle, "mine.toml").spec
    axles = axles_of(spec)
    loads = axles.loads(spec.values)
    for axle, load in loads.items():
        curve = axles.force(axle, spec.values, np.radians([1.0, 5.0, 12.0]), load)
        assert np.all(np.diff(curve) > 0)
        assert 0.3 * load < curve[-1] < 1.2 * load


def test_four_coefficients_come_back():
    slip = np.linspace(0.0, np.radians(15.0), 121)
    found = four_coefficients(slip, magic_formula(slip, 9.0, 1.4, 8000.0, -0.7))
    assert found == pytest.approx((9.0, 1.4, 8000.0, -0.7), rel=1e-3)
