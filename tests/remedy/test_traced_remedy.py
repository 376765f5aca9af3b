"""Remedies after a trace: the vehicle is the amended model, the belief the nominal one."""

from types import SimpleNamespace

import pandas as pd
import pytest
from typer.testing import CliRunner

from harness.cli.main import app
from harness.common.errors import UserError
from harness.config import build_study
from harness.remedy import choices
from harness.remedy.choices import AS_IT_IS, Remedy
from harness.remedy.report import belief_text
from harness.remedy.run import named, remedies, traced_study
from harness.study.worst_case import box_of

NOMINAL = """\
vehicle = "car"
tyre = "linear"
[values]
mass = 982.0
yaw_inertia = 1605.0
cog_to_front_axle = 1.33
cog_to_rear_axle = 1.07
friction = 0.9
steering_ratio = 1.0
reference_from_cog = 0.0
lowest_speed = 1.5
stiffness_peak_front = 249762.0
stiffness_load_front = 30000.0
stiffness_peak_rear = 347915.0
stiffness_load_rear = 30000.0
[process_noise]
lateral_velocity = 2.5e-06
yaw_rate = 1.4e-07
[measurement_noise]
yaw_rate = 3.0e-06
lateral_acceleration = 0.01
"""
AMENDED = (
    NOMINAL.replace('tyre = "linear"', 'tyre = "linear"\neffects = ["steering_lag"]')
    .replace("[process_noise]", "steering_lag = 0.12\n[process_noise]\nsteering_lagged = 0.0")
    .replace("[values]\n", "[values]\n")
)
CONTENT = {
    "name": "car",
    "targets": ["lateral_velocity"],
    "drive": [{"name": "sine", "kind": "sine", "speed": "15 m/s", "amplitude": "1.5 deg", "duration": "10 s"}],
    "plant": {"vehicle": "car", "parameters": "nominal.toml", "sensors": "car_series"},
    "estimator": [{"name": "EKF", "kind": "ekf"}],
    "design": [{"name": "level", "factor": [{"parameter": "mass", "of": "plant", "levels": [900.0, 1000.0]}]}],
}


@pytest.fixture
def folder(tmp_path):
    (tmp_path / "nominal.toml").write_text(NOMINAL)
    (tmp_path / "amended.toml").write_text(AMENDED)
    return tmp_path


@pytest.fixture
def study(folder):
    return build_study(CONTENT, folder / "car")


def run(*words):
    return CliRunner().invoke(app, list(map(str, words)))


def test_the_plant_has_what_the_trace_named_and_the_belief_lacks_it(study, folder):
    found = traced_study(study, folder)
    assert named(found) == ["steering_lag"]
    assert found.plant.values["steering_lag"] == 0.12
    assert found.belief.effects == ()
    assert (found.targets, found.seed, found.drives) == (study.targets, study.seed, study.drives)
    assert not choices.parameters(found)
    assert box_of(found, found.designs[0], 8).samples == 8  # what is wrong is no factor


def test_filters_that_need_no_model_of_it_are_tried_and_the_amended_belief_is_the_ideal(study, folder):
    found = traced_study(study, folder)
    some = list(remedies([], considers=True, tunable=True))
    assert [r.words for r in some] == [
        "tune for the worst case",
        "adapt the process noise to the innovations",
        "filter against the worst disturbance",
    ]
    assert not list(remedies([], considers=False, tunable=False))
    adapted = choices.applied(found, some[1], "EKF")
    assert [(e.name, e.kind) for e in adapted.estimators] == [("EKF", "innovation_ekf")]
    assert adapted.belief.effects == ()
    ideal = choices.applied(found, Remedy(amended=True), "EKF")
    assert ideal.belief.effects == ("steering_lag",)
    assert ideal.belief.values == ideal.plant.values
    assert choices.applied(found, AS_IT_IS, "EKF").designs == found.designs


def test_a_trace_that_named_nothing_is_refused(study, folder):
    (folder / "amended.toml").write_text(NOMINAL)
    with pytest.raises(UserError, match="no effect that the nominal one lacks"):
        traced_study(study, folder)
    (folder / "amended.toml").unlink()
    with pytest.raises(UserError, match=r"there is no amended\.toml"):
        traced_study(study, folder)


def test_a_recording_is_estimated_with_the_belief_that_is_written(study, folder):
    """The vehicle on the recording has half as much mass again; the belief estimates it from 982 kg on."""
    remedy = Remedy(estimated=("mass",))
    best = SimpleNamespace(study=choices.applied(study, remedy, "EKF"), remedy=remedy)
    (folder / "belief.toml").write_text(belief_text(SimpleNamespace(best=best, study=study)))
    assert "unknown_parameters" in (folder / "belief.toml").read_text()
    drive = ["--drive", "random_sequence", "--option", "speed=15 m/s", "--option", "amplitude=1 deg"]
    made = ["--parameters", folder / "nominal.toml", "--set", "mass=1473", "--sensors", "car_series", "--seed", 3]
    done = run("simulate", "car", *drive, "--option", "duration=30 s", *made, "--out", folder / "drive.csv")
    assert done.exit_code == 0, done.output
    given = [
        "--model",
        "car",
        "--parameters",
        folder / "belief.toml",
        "--data",
        folder / "drive.csv",
        "--inputs",
        "held",
    ]
    done = run("estimate", *given, "--estimator", "ekf", "--out", folder / "out")
    assert done.exit_code == 0, done.output
    table = pd.read_csv(folder / "out" / "estimates" / "drive-EKF.csv")
    found, deviation = table["mass"].iloc[-1], table["mass_std"].iloc[-1]
    assert abs(found - 1473) < min(4 * deviation, 200)
