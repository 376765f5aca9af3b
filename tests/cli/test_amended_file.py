"""The file of an amended model, as a trace writes it, goes into every command and into studies as it is."""

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import harness as h
from harness.cli.main import app

SINE = ["--drive", "sine", "--option", "amplitude=15 deg", "--option", "duration=8 s"]

STUDY = """
name = "amended"
targets = ["lateral_velocity"]
plant = {{ vehicle = "car", parameters = "{plant}", sensors = "car_series" }}
belief = {{ parameters = "{belief}" }}
estimator = [{{ name = "EKF", kind = "ekf" }}]
drive = [{{ name = "sine", kind = "sine", amplitude = "15 deg", duration = "4 s" }}]
design = [{{ name = "level", repeats = 1, factor = [{{ parameter = "mass", levels = ["2.2 t"] }}] }}]
"""


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """A folder with the nominal and the amended model, which reads the bank of the road."""
    monkeypatch.chdir(tmp_path)
    car = h.model("car", "govindarajan_2018", tyre="linear", sensors="car_series")
    car.write("nominal.toml")
    effects = {"effects": ["steering_lag", "road_bank_measured"], "values": {"steering_lag": 0.05, "bank_share": 0.9}}
    car.replace(**effects).write("amended.toml")
    return tmp_path


def run(*words):
    return CliRunner().invoke(app, list(map(str, words)))


def test_it_is_simulated_on_a_flat_road_and_estimated_on_a_recording_of_its_bank(folder):
    done = run("simulate", "car", "--parameters", "amended.toml", *SINE, "--seed", 1, "--out", "drive.csv")
    assert done.exit_code == 0, done.output
    table = pd.read_csv("drive.csv")
    assert (table["bank_angle"] == 0).all()
    words = ["estimate", "--model", "car", "--parameters", "amended.toml", "-e", "ekf", "--out", "est"]
    table.assign(bank_angle=0.1 * np.sin(table["time"])).to_csv("lap.csv", index=False)
    done = run(*words, "--data", "lap.csv")
    assert done.exit_code == 0, done.output
    lateral = pd.read_csv("est/estimates/lap-EKF.csv")["lateral_velocity"]
    pd.read_csv("lap.csv").assign(bank_angle=0.0).to_csv("flat.csv", index=False)
    assert run(*words, "--data", "flat.csv").exit_code == 0
    assert np.abs(lateral - pd.read_csv("est/estimates/flat-EKF.csv")["lateral_velocity"]).max() > 0.01


@pytest.mark.parametrize("command", ["estimate", "tune"])
def test_a_recording_without_the_bank_says_how_to_get_one(folder, command):
    assert run("simulate", "car", "--parameters", "nominal.toml", *SINE, "--out", "lap.csv").exit_code == 0
    words = ["--model", "car", "--parameters", "amended.toml", "--data", "lap.csv"]
    words += ["-e", "ekf", "--out", "est"] if command == "estimate" else ["--out", "tuned.toml"]
    done = run(command, *words)
    assert done.exit_code == 2
    assert "--bank-map" in " ".join(done.output.split())


@pytest.mark.parametrize(
    "sides", [("amended", "nominal"), ("nominal", "amended"), ("amended", "amended")], ids="-".join
)
def test_a_study_takes_it_on_either_side(folder, sides):
    plant, belief = (f"{side}.toml" for side in sides)
    (folder / "amended-study.toml").write_text(STUDY.format(plant=plant, belief=belief))
    study = h.read_study("amended-study.toml")
    effects = {side: () if side == "nominal" else ("steering_lag", "road_bank_measured") for side in sides}
    assert (study.spec.plant.effects, study.spec.belief.effects) == tuple(effects[side] for side in sides)
    results = study.run("results", jobs=1)
    assert set(results.to_dataframe().status) == {"ok"}
    assert results.to_dataframe().rmse.max() < 0.1
