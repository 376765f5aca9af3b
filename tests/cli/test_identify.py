"""``harness identify``: files in, a parameter set that studies load out; bad requests in one line."""

import json

import pandas as pd
import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.common.errors import ModelError
from harness.config import load_study, resolve_single
from harness.config.model_choice import complete
from harness.config.parameter_set import set_from_file
from harness.identification.contract import METHODS, load_method, settings_of
from harness.recordings.read.write import write_recording
from support.identification import CAR, model_of, recorded

LINE = ["identify", "--model", "car_reference_point", "--parameters", "sun_2015", "--sensors", "car_reference"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drives")
    for seed, name in ((1, "first"), (2, "second")):
        drive = recorded(model_of(CAR), seed, duration=6.0, speed=15.0, amplitude=0.5)
        write_recording(drive, folder / f"{name}.csv")
    return folder


def run(*words):
    return CliRunner().invoke(app, [*(LINE[:-2] if "--sensors" in words else LINE), *map(str, words)])


def test_a_fit_writes_a_set_that_loads_its_numbers_and_a_report(folder, tmp_path):
    free = "stiffness_over_load_front,stiffness_over_load_rear"
    done = run("--train", folder / "first.csv", "--test", folder / "second.csv", "--free", free,
               "--set", "stiffness_over_load_front=7.5", "--setting", "annealings=0", "--out", tmp_path)  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "Of 2 parameters the recordings leave 2 determined." in done.stdout
    stored = json.loads((tmp_path / "identify.json").read_text())
    estimates = {e["name"]: e for e in stored["estimates"]}
    front = estimates["stiffness_over_load_front"]
    assert f"stiffness_over_load_front: 7.5 to {front['value']:.4g} 1/rad, 95 % interval " in done.stdout
    assert "; determined\n" in done.stdout
    assert front["start"] == pytest.approx(7.5)
    assert front["interval_95"][0] < 8.36 < front["interval_95"][1]
    assert [d["held_out"] for d in stored["drives"]] == [False, True]
    errors = stored["drives"][1]["outputs"]["yaw_rate"]["free_running_rmse"]
    assert errors["after"] < errors["before"]
    table = {
        "vehicle": "car_reference_point",
        "parameters": str(tmp_path / "parameters.toml"),
        "sensors": "car_reference",
    }
    spec = resolve_single(table, "test")
    assert spec.values["stiffness_over_load_front"] == front["value"]
    assert spec.measurement_noise["yaw_rate"] == estimates["measurement_noise yaw_rate"]["value"]
    assert f"next: harness run {tmp_path / 'posterior.toml'} --out {tmp_path / 'posterior'}" in done.stdout
    factors = load_study(tmp_path / "posterior.toml").designs[0].factors
    (factor,) = [f for f in factors if f.parameter == "stiffness_over_load_front"]
    assert factor.marginal.arguments[:2] == (front["value"], front["standard_error"])
    assert (tmp_path / "report.pdf").stat().st_size > 10_000
    assert "second" in (tmp_path / "report.html").read_text()


@pytest.mark.fails_in_part
def test_a_fit_is_kept_where_the_comparison_with_the_recordings_fails(folder, tmp_path, monkeypatch):
    def broken(*_):
        raise ZeroDivisionError("no sample is left")

    monkeypatch.setattr("harness.identification.fit_recordings.judge", broken)
    done = run("--train", folder / "first.csv", "--free", "stiffness_over_load_front", "--setting", "annealings=0",
               "--setting", "iterations=1", "--setting", "profiles=false", "--out", tmp_path)  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "warning: the comparison with the recordings could not be made: ZeroDivisionError" in done.stderr
    assert json.loads((tmp_path / "identify.json").read_text())["drives"] == []
    assert (tmp_path / "parameters.toml").exists()
    assert "the comparison with the recordings could not be made" in (tmp_path / "report.html").read_text()
    assert "no sample is left" in (tmp_path / "errors.txt").read_text()


def test_a_fit_that_makes_the_simulation_worse_says_so_first_and_in_its_file(folder, tmp_path):
    """The drive that is fitted has its steering in another unit and a spike; the one kept aside has not."""
    odd = pd.read_csv(folder / "first.csv")
    odd["steering_wheel_angle"] *= 1.5
    odd.loc[300, "heading"] += 1.0
    odd.to_csv(tmp_path / "odd.csv", index=False)
    done = run("--train", tmp_path / "odd.csv", "--test", folder / "second.csv", "--free", "steering_ratio",
               "--setting", "annealings=0", "--setting", "profiles=false", "--out", tmp_path)  # fmt: skip
    assert done.exit_code == 0, done.output
    assert done.stdout.startswith("The fit failed: with it the simulation error of the drives that were kept aside is")
    assert "warning: odd: " in done.stderr  # what check and trace say of the recording
    assert json.loads((tmp_path / "identify.json").read_text())["failed"].startswith("The fit failed")
    assert set_from_file("parameters.toml", tmp_path, "test").warning.startswith("The fit failed")
    assert "The fit failed" in (tmp_path / "report.html").read_text()
    spec = {"vehicle": "car_reference_point", "parameters": str(tmp_path / "parameters.toml")}
    assert any("The fit failed" in note for note in complete(spec)[1])


@pytest.mark.parametrize(
    ("words", "said"),
    [
        ([], "free: name the parameters to estimate; the model has: stiffness_over_load_front"),
        (["--effect", "dropout"], "error: 'dropout' degrades the sensors of a plant; no estimator believes in it"),
        (["--free", "stiffness_front"], "closest: stiffness_over_load_front"),
        (["--free", "cog_height,cog_height"], "free: 'cog_height' is named 2 times; name it once"),
        (["--free", "cog_height", "-f", "cog_height,"], "free: 'cog_height' is named 2 times; name it once"),
        (["--free", "cog_height", "--method", "likelyhood"], "closest: likelihood"),
        (["--free", "cog_height", "--setting", "stats=2"], "no setting 'stats'; closest: starts"),
        (["--free", "cog_height", "--setting", "starts=0"], "starts: input should be greater than or equal to 1"),
        (["--free", "cog_height", "--setting", "starts=1_0"], "starts: '1_0' means '10'"),
        (["--free", "cog_height", "--set", "cog_height=0,5 m"], "cog_height: '0,5 m' may mean '0.5 m' or '5 m'"),
        (["--free", "cog_height", "--set", "cog_height=1_0"], "cog_height: '1_0' means '10'"),
        (["--free", "cog_height", "--sensors", "car_lateral"], "the recording lacks 'lateral_acceleration'"),
    ],
)
def test_a_wrong_request_is_one_line(folder, tmp_path, words, said):
    done = run("--train", folder / "first.csv", "--out", tmp_path / "out", *words)
    assert done.exit_code == 2
    assert said in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "out").exists()


def test_a_drive_is_not_fitted_and_tested_at_once(folder, tmp_path):
    first = folder / "first.csv"
    done = run("--train", first, "--test", first, "--free", "cog_height", "--out", tmp_path)
    assert done.exit_code == 2
    assert "is fitted as well" in done.stderr


@pytest.mark.parametrize("name", METHODS.names())
def test_every_method_has_settings_with_descriptions(name):
    method = load_method(name)
    settings_of(method, {})
    assert all(field.description for field in method.Settings.model_fields.values())


def test_an_unknown_method_suggests_the_closest():
    with pytest.raises(ModelError, match="closest: likelihood"):
        load_method("likelihod")
