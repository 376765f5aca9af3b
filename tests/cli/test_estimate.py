"""``harness estimate`` and ``harness tune --data``: estimates, noise and reports out; bad requests in a line."""

import json

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from typer.testing import CliRunner

from harness.cli.main import app
from harness.cli.recordings import _estimator
from harness.common.errors import UserError
from harness.recordings.read.write import write_recording
from support.identification import CAR, model_of, recorded

MODEL = ["--model", "car_reference_point", "--parameters", "sun_2015", "--inputs", "held", "--integrator", "euler"]
SIGNAL = ["--signal", "slip_angle_rear"]
SCALE = ["--process-noise", "yaw_rate=1.2e-9", "--process-noise", "lateral_velocity_rear=2.5e-7"]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("drives")
    for seed, name in ((1, "first"), (2, "second")):
        drive = recorded(model_of(CAR), seed, duration=6.0, speed=15.0, amplitude=0.5)
        gone = drive["yaw_rate"].values
        gone[100:150] = np.nan
        write_recording(drive, folder / f"{name}.csv")
    return folder


def run(*words):
    return CliRunner().invoke(app, list(map(str, words)))


def test_estimates_numbers_and_a_report_are_written(folder, tmp_path):
    done = run("estimate", *MODEL, *SCALE, "--data", folder / "first.csv", "--data", folder / "second.csv",
               "-e", "ekf", "-e", "ukf,alpha=0.5", "--out", tmp_path)  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "of NIS in its 95 % band" in done.stdout
    files = sorted(p.name for p in (tmp_path / "estimates").iterdir())
    assert files == ["first-EKF.csv", "first-UKF_alpha=0.5.csv", "second-EKF.csv", "second-UKF_alpha=0.5.csv"]
    table = pd.read_csv(tmp_path / "estimates" / "first-EKF.csv")
    assert {"time", "yaw_rate", "yaw_rate_std", "nis", "nees"} <= set(table)
    assert "innovation_covariance_lateral_velocity_rear_yaw_rate" in table
    assert table["innovation_yaw_rate"][100:150].isna().all()
    assert table["yaw_rate"].notna().all()
    stored = json.loads((tmp_path / "estimate.json").read_text())
    assert stored["answer"] in done.stdout
    assert len(stored["runs"]) == 4
    assert "all samples of the recording" in stored["comment"]
    assert stored["runs"][0]["errors"]["yaw_rate"]["rmse"] < 0.01
    page = (tmp_path / "report.html").read_text()
    assert "all samples of the recording" in page
    assert "UKF alpha=0.5" in page
    assert (tmp_path / "report.pdf").stat().st_size > 10_000


def stressed(folder, tmp_path, name, change):
    """Return the answer of an estimate on a recording that something happened to."""
    table = pd.read_csv(folder / "first.csv")
    change(table)
    table.to_csv(tmp_path / f"{name}.csv", index=False)
    data = tmp_path / f"{name}.csv"
    done = run("estimate", *MODEL, *SCALE, "--data", data, "-e", "ekf", "-e", "ukf", "--out", tmp_path / name)
    assert done.exit_code == 0, done.output
    runs = json.loads((tmp_path / name / "estimate.json").read_text())["runs"]
    return " ".join(done.output.split()), {r["estimator"]: r for r in runs}


def test_a_filter_that_diverges_is_not_the_nearest_to_the_reference(folder, tmp_path):
    def outlier(table):
        table.loc[300, "yaw_rate"] = 1e6

    said, runs = stressed(folder, tmp_path, "outlier", outlier)
    assert "With EKF and UKF the estimate diverges on outlier." in said
    assert "Smallest RMSE" not in said
    assert runs["EKF"]["diverged_at"] == pytest.approx(3.0, abs=0.02)


def test_two_measurements_say_nothing_of_the_covariance(folder, tmp_path):
    def silent(table):
        table.loc[3:, [c for c in table if c in ("yaw_rate", "heading", "lateral_velocity_rear")]] = np.nan

    said, runs = stressed(folder, tmp_path, "silent", silent)
    assert "only 2 samples with a measurement" in said
    assert runs["UKF"]["samples_with_a_measurement"] == 2


@pytest.mark.parametrize(("speed", "what"), [(0.0, "is slower than 1.5 m/s"), (-3.0, "drives backwards")])
def test_standstill_and_reverse_are_said(folder, tmp_path, speed, what):
    def slow(table):
        table.loc[450:, "speed"] = speed

    said, runs = stressed(folder, tmp_path, "slow", slow)
    assert f"'speed': the vehicle {what} at 25 % of the samples, first 4.50 s after the start" in said
    assert what in (tmp_path / "slow" / "report.html").read_text()
    assert all(np.isfinite(r["log_likelihood"]) or r["diverged_at"] for r in runs.values())


def test_netcdf_keeps_units_and_covariances(folder, tmp_path):
    done = run("estimate", *MODEL, *SCALE, "--data", folder / "first.csv", "-e", "ekf", "--format", "nc",
               *SIGNAL, "--out", tmp_path)  # fmt: skip
    assert done.exit_code == 0, done.output
    with xr.open_dataset(tmp_path / "estimates" / "first-EKF.nc") as kept:
        assert kept["yaw_rate"].attrs["units"] == "rad/s"
        assert kept["slip_angle_rear"].attrs["ancillary_variables"] == "slip_angle_rear_std"
        assert kept["yaw_rate"].attrs["ancillary_variables"] == "yaw_rate_std"
        assert kept["innovation_covariance"].dims == ("time", "output", "other_output")
        assert kept.attrs["Conventions"].startswith("CF-")


def test_noise_is_found_and_estimate_takes_its_file(folder, tmp_path):
    tuned = tmp_path / "tuned.toml"
    done = run("tune", *MODEL, *SCALE, "--measurement-noise", "heading=1e-6", "--data", folder / "first.csv",
               "--out", tuned)  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "the recordings determine" in done.stdout
    assert (tmp_path / "tuned.pdf").stat().st_size > 10_000
    numbers = json.loads((tmp_path / "tuned.json").read_text())
    heading = next(v for v in numbers["variances"] if v["of"] == ["heading"] and v["kind"] == "measurement")
    assert heading["interval_95"][0][0] < model_of(CAR).measurement_noise["heading"] < heading["interval_95"][1][0]
    words = ["estimate", *MODEL, *SIGNAL, "--data", folder / "second.csv", "-e", "ekf", "--out", tmp_path / "est"]
    words[words.index("sun_2015")] = str(tuned)
    assert run(*words).exit_code == 0
    (stored,) = json.loads((tmp_path / "est" / "estimate.json").read_text())["runs"]
    assert stored["nis_inside_95"] == pytest.approx(0.95, abs=0.04)


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (["estimate", "-e", "ekff"], "closest: ekf"),
        (["estimate", "-e", "ukf,beta=1", "-e", "ukf,beta=1.0"], "is asked for twice"),
        (["estimate", "-e", "ukf,alpa=1"], "alpa"),
        (["estimate", "-e", "ekf", "--signal", "yaw_rat"], "no quantity 'yaw_rat'"),
        (["estimate", "-e", "ekf", "--unknown-input", "sped"], "'sped' is no input"),
        (["estimate", "-e", "ekf", "--reference", "yaw_rate=nothing"], "the recording lacks 'nothing'"),
        (["tune", "--by", "unit", "mass"], "leave out the study"),
        (["tune", "--drive", "robustness"], "leave out the study, --drive, --estimator"),
    ],
)
def test_what_cannot_be_is_one_line(folder, tmp_path, words, said):
    out = tmp_path / ("tuned.toml" if words[0] == "tune" else "est")
    done = run(*words, *MODEL, "--data", folder / "first.csv", "--out", out)
    assert done.exit_code == 2
    assert said in " ".join(done.output.split())
    assert "Traceback" not in done.output


def test_tune_needs_a_study_or_recordings(tmp_path):
    done = run("tune", "--out", tmp_path / "tuned.toml")
    assert done.exit_code == 2
    assert "harness tune STUDY --drive" in " ".join(done.output.split())
    done = run("tune", "--data", "lap.csv", "--out", tmp_path / "tuned.toml")
    assert "--data needs --model" in " ".join(done.output.split())


def test_settings_of_an_estimator_may_be_tables_and_lists():
    text = 'imm, hypotheses={mass=["1 t", "2 t"], friction=[0.3,1.0]},dwell=60 s'
    asked = _estimator(text)
    assert (asked.kind, asked.settings) == (
        "imm",
        {"hypotheses": {"mass": ["1 t", "2 t"], "friction": [0.3, 1.0]}, "dwell": "60 s"},
    )
    with pytest.raises(UserError, match=r"--estimator imm, .*: write it as in a study file"):
        _estimator("imm,hypotheses={mass=(8 t)}")


@pytest.mark.parametrize("drive", ["sine", "winding_road"])
def test_a_matched_filter_is_consistent_on_a_simulated_file(tmp_path, drive):
    """A file of ``harness simulate`` is read as any recording: finely integrated, its inputs straight between samples.

    Held inputs and Euler's method gave an NEES of four times the degrees of freedom.
    """
    file = tmp_path / "drive.csv"
    options = ["--option", "speed=15 m/s", "--option", "duration=30 s"]
    done = run("simulate", "semitrailer", "--drive", drive, *options, "--seed", 1, "--out", file)
    assert done.exit_code == 0, done.output
    done = run("estimate", "--model", "semitrailer", "--data", file, "-e", "ekf", "--out", tmp_path / "found")
    assert done.exit_code == 0, done.output
    found = json.loads((tmp_path / "found" / "estimate.json").read_text())["runs"][0]
    assert found["nis_over_degrees"] == pytest.approx(1.0, abs=0.1)
    assert found["nees_over_degrees"] == pytest.approx(1.0, abs=0.25)
    assert found["nees_inside_95"] > 0.9
