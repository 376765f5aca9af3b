"""A study written out with all that its files say is the same study where they are not."""

import shutil
from pathlib import Path

import pytest

from harness.common.files import parse_toml
from harness.config import build_study, load_study
from harness.config.self_contained import self_contained, without_files
from harness.study.layout import root_attributes

ROOT = Path(__file__).parents[2]
SET = """\
vehicle = "car"
tyre = "linear"
[values]
mass = 1500
yaw_inertia = "2500 kg*m^2"
cog_to_front_axle = 1.2
cog_to_rear_axle = 1.5
friction = 0.9
steering_ratio = 16
reference_from_cog = 0
lowest_speed = 1.5
stiffness_peak_front = 1e5
stiffness_load_front = 8000
stiffness_peak_rear = 1.1e5
stiffness_load_rear = 7000
[std]
mass = 100
[process_noise]
lateral_velocity = 4e-6
yaw_rate = 1.2e-7
[measurement_noise]
yaw_rate = 3e-6
lateral_acceleration = 0.01
"""
STUDY = """\
name = "own"
targets = ["lateral_velocity"]
drives = "own.toml"
tuning = "tuned.toml"
estimator = ["ekf", { name = "mine", kind = "ukf", alpha = 0.5 }]
plant = { vehicle = "car", parameters = "own_set.toml", tyre = "linear", sensors = "car_series" }
limits = { lateral_velocity = 0.1 }
[belief]
unknown_parameters = ["mass", { name = "friction", prior = 0.2, walk = "0.1 1/sqrt(h)" }]
considered_parameters = ["yaw_inertia"]
values = { mass = "1.6 t" }
noise = { measurement_scale = 2, process = { yaw_rate = 1e-6 } }
[[design]]
name = "mass"
repeats = 3
factor = [{ parameter = "mass", shift = ["-10 %", "0 %", "0.2 t"] }]
"""
DRIVES = '[[drive]]\nname = "weave"\nkind = "sine"\nduration = "5 s"\namplitude = "20 deg"\n'
TUNING = """\
rule = "by hand"
drives = ["weave"]
budget = 1
[estimator.mine]
process = 0.1
unknown_inputs = 1.5
measurement = 3
"""


@pytest.mark.parametrize("path", sorted((ROOT / "studies").glob("*.toml")), ids=lambda p: p.stem)
def test_every_study_of_the_package(path):
    for quick in (False, True):
        study = load_study(path, quick)
        content = parse_toml(self_contained(study), "text")
        assert (content["drives"], "parameters" in content["plant"] | content["belief"]) == ([], False)
        assert build_study(content, path).hash == study.hash  # recordings are found beside the file


def test_a_study_of_files_without_them(tmp_path):
    folder = tmp_path / "there"
    folder.mkdir()
    for name, text in {"study": STUDY, "own_set": SET, "own": DRIVES, "tuned": TUNING}.items():
        (folder / f"{name}.toml").write_text(text)
    (folder / "study.toml").write_text(STUDY.replace('"own_set.toml"', f'"{(folder / "own_set.toml").as_posix()}"'))
    study = load_study(folder / "study.toml")
    assert study.estimators[1].noise == {"process": 0.1, "unknown_inputs": 1.5, "measurement": 3.0}
    written = self_contained(study)
    shutil.rmtree(folder)
    again = build_study(parse_toml(written, "text"), tmp_path / "study.toml")
    assert again.hash == study.hash
    assert (again.belief.parameter_states, again.tuning) == (study.belief.parameter_states, study.tuning)
    assert (again.limits, again.designs) == (study.limits, study.designs)
    assert self_contained(again) == written
    kept = root_attributes(without_files(study))  # what a store says of a study that the harness makes of its files
    assert ".toml" not in kept["study"]
    assert folder.as_posix() not in str(kept)
    assert kept["study_hash"] == study.hash
