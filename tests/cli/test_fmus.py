"""``harness list fmu`` and ``harness new plant``."""

from dataclasses import replace

import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.common.files import read_toml
from harness.external.fmu.read import describe
from support.fmus import SPRING, make, needs_compiler

pytestmark = needs_compiler

TRUCK = replace(
    SPRING,
    inputs={"lenkradwinkel": "deg", "v_x": "km/h", "wind.force": "N", "brake": "", "yawMoment": ""},
    outputs={"yawRate": "deg/s", "psi_dot": "", "ay": "m/s2", "temperature": "degC", "beta": "rad"},
    code="y[0] = u[0] * p[0]; dx[0] = 0; dx[1] = 0;",
)


@pytest.fixture
def run(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def run(*arguments):
        done = CliRunner().invoke(app, [str(a) for a in arguments])
        return done.exit_code, done.output

    return run


def test_a_listing_shows_variables_with_units_and_bounds(run, tmp_path):
    make(tmp_path, TRUCK, 3, "me")
    status, printed = run("list", "fmu", "truck_3_me.fmu")
    assert status == 0
    assert "3.0, model-exchange" in printed
    row = next(line for line in printed.splitlines() if line.startswith("body.m"))
    assert row.split()[1:] == ["kg", "2", "1", "3", "tunable"]
    assert "written by: tests" in printed


def test_a_proposed_map_works_as_it_is(run, tmp_path):
    path = make(tmp_path, TRUCK)
    status, printed = run("new", "plant", path.name)
    assert status == 0
    assert 'plant = { fmu = "truck_2_cs.fmu", map = "truck_2_cs.toml" }' in printed
    described = describe(path, read_toml(tmp_path / "truck_2_cs.toml"))
    assert {p.signal: p.variable for p in described.inputs} == {"steering_wheel_angle": "lenkradwinkel", "speed": "v_x"}
    outputs = {p.signal: p.variable for p in described.outputs}
    assert outputs == {"yaw_rate": "yawRate", "lateral_acceleration": "ay", "sideslip_angle": "beta"}
    assert [(p.signal, p.variable, p.unit) for p in described.disturbances] == [
        ("wind_force", "wind.force", "N"),
        ("yawmoment", "yawMoment", "N*m"),
    ]
    text = (tmp_path / "truck_2_cs.toml").read_text()
    for open_question in ("Not used: input brake", "Not used: output temperature in degC", "2 parameters are factors"):
        assert open_question in text


def test_a_plant_steered_at_its_road_wheels_is_steered_at_its_steering_wheel(run, tmp_path):
    path = make(tmp_path, replace(TRUCK, inputs={"road_wheel_angle": "rad", "speed": "", "a": "", "b": ""}))
    assert run("new", "plant", path, "--out", "map.toml")[0] == 0
    steering, speed = describe(path, read_toml(tmp_path / "map.toml")).inputs
    assert {steering.signal, speed.signal} == {"steering_wheel_angle", "speed"}
    assert sorted([steering.scale, speed.scale]) == [1.0, 16.0]
    assert "SI is assumed" in (tmp_path / "map.toml").read_text()


def test_what_cannot_be_proposed_is_one_line(run, tmp_path):
    path = make(tmp_path, replace(TRUCK, outputs=dict.fromkeys("abcde", "")))
    for arguments, words in (
        (("new", "plant", path.name), "none of its 5 outputs is a signal"),
        (("new", "plant", "nobody.fmu"), "there is no such FMU"),
        (("list", "fmu", "nobody.fmu"), "there is no such FMU"),
        (("list", "fmu"), "harness list fmu FILE"),
    ):
        status, printed = run(*arguments)
        assert status == 2
        assert words in " ".join(printed.split())
    assert not (tmp_path / "truck_2_cs.toml").exists()


def test_nothing_is_written_over(run, tmp_path):
    path = make(tmp_path, TRUCK)
    (tmp_path / "truck_2_cs.toml").write_text("mine")
    status, printed = run("new", "plant", path.name)
    assert status == 2
    assert "--out" in printed
    assert (tmp_path / "truck_2_cs.toml").read_text() == "mine"
