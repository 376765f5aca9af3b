"""A trust monitor counted on a study of a car, and printed to C: the same verdicts, and the counts in its header."""

import re
import subprocess
import tomllib

import numpy as np
import pytest
from typer.testing import CliRunner

import harness
from harness.cli.main import app
from harness.common.errors import UserError
from harness.common.files import toml_text, write_files
from harness.config import build_study
from harness.config.specs import MonitorSpec
from harness.engine.simd.lanes import LANES
from harness.realtime.export import run
from harness.remedy.monitor.answer import in_short, sentences
from harness.remedy.monitor.run import count_monitor
from harness.runner.contract import Held, InputSeries
from harness.runner.monitor import REASONS, Watching
from support.exports import COMPILER, made
from support.observers import CONTENT, needs_compiler

LIMITS = {"lateral_velocity": 0.013}
PLACE = {"parameter": "cog_to_front_axle", "shift": ["0 %", "40 %"]}
FULL = {
    **CONTENT,
    "targets": ["lateral_velocity"],
    "estimator": [{"name": "EKF", "kind": "ekf"}],
    "drive": [{**CONTENT["drive"][0], "amplitude": "60 deg"}],
    "design": [{"name": "place", "repeats": 8, "factor": [PLACE]}],
}


def study_of(folder, **changes):
    return build_study({**FULL, **changes}, folder / "study.toml")


@pytest.fixture(scope="module")
def counted(tmp_path_factory):
    return count_monitor(study_of(tmp_path_factory.mktemp("car")), MonitorSpec(LIMITS, 1.0, 60.0, 2.0, 8), jobs=1)


def test_bounds_are_from_runs_as_believed_and_counts_from_others(counted):
    kept = counted.kept[0]
    assert kept.wrong.sum() == 0
    assert counted.calibrated.alarms <= 60.0 * counted.calibrated.hours
    assert 0.9 < kept.samples.sum() / counted.believed[0].samples.sum() <= 1.0
    assert kept.false.sum() < 0.05 * kept.samples.sum()
    monitor = counted.monitor
    assert list(monitor.inputs) == list(monitor.rates)
    assert monitor.inputs["speed"] == (15.0, 15.0)
    assert monitor.rates["speed"] == (0.0, 0.0)
    assert "The speed never changes" in sentences(counted)[-1]
    assert sentences(counted)[-1] in in_short(counted)
    low, high = monitor.rates["steering_wheel_angle"]
    assert -10.0 < low < -0.05
    assert 0.05 < high < 10.0  # rad/s, not per sample
    assert monitor.nis[0] < 0.0 < monitor.nis[1]


def test_hours_of_the_calibration_are_of_samples_where_windows_are_cut(tmp_path):
    cut = count_monitor(study_of(tmp_path), MonitorSpec(LIMITS, 3.0, 60.0, 2.0, 8), jobs=1)  # of drives of 5 s
    kept = cut.kept[0].samples.sum() * cut.monitor.step / 3600.0
    assert cut.calibrated.hours == pytest.approx(kept, rel=0.1)


def test_a_car_with_its_mass_elsewhere_is_in_error_and_said_to_be(counted):
    same, other = counted.levels
    assert same.counts[0].wrong_share == 0.0
    assert np.isnan(same.areas[0].value)
    assert other.counts[0].wrong_share > 0.02
    assert other.counts[0].said_share > 0.9
    assert other.areas[0].lower > 0.8
    assert not other.is_blind(0)
    assert counted.information == ()
    assert counted.delay(other.counts[0]) < 2.0
    text = " ".join(sentences(counted))
    assert "At CoG to front axle +40 % the lateral velocity is wrong by more than 0.013 m/s in" in text
    assert in_short(counted)[0].split()[0] == "Where"


@needs_compiler
@pytest.mark.parametrize("precision", ["double", "float"])
def test_the_c_gives_the_same_verdicts_and_says_the_counts(counted, precision, tmp_path):
    study = study_of(tmp_path)
    (tmp_path / "monitor.toml").write_text(counted.monitor.text)
    exported = run.export(study, None, precision, None, (None, 5.0), monitor=tmp_path / "monitor.toml")
    write_files(tmp_path, exported.files)
    flags = "CFLAGS=-O1 -g -Werror -fsanitize=address,undefined -fno-sanitize-recover=all"
    verdicts = made(tmp_path, "check", flags)
    for column in ("trust", "reasons"):
        assert float(re.search(rf"{column} +(\S+) of its largest", verdicts)[1]) == 0.0
    lines = exported.files["replay.csv"].splitlines()
    assert lines[0].endswith("nis,trust,reasons")
    assert {line.split(",")[-2] for line in lines[1:]} >= {"0.0", "1.0"}
    header = " ".join(exported.files["foreign_ekf.h"].replace("\n *", " ").split())
    assert all(f"| {bit} |" in exported.files["README.md"] for bit in REASONS)
    assert all(" ".join(sentence.split()) in header for sentence in counted.monitor.says)
    assert all(f"= {bit}" in header for bit in REASONS)
    (tmp_path / "use.c").write_text(USE)
    command = [COMPILER, "-std=c99", "-Wall", "-Werror", "use.c", "foreign_ekf.c", "-o", "use", "-lm"]
    subprocess.run(command, cwd=tmp_path, check=True)
    subprocess.run([tmp_path / "use"], check=True)


@needs_compiler
def test_the_c_gives_the_same_verdicts_where_measurements_are_missing(counted, tmp_path):
    (tmp_path / "monitor.toml").write_text(counted.monitor.text)
    exported = run.export(study_of(tmp_path), recorded=(None, 5.0), monitor=tmp_path / "monitor.toml")
    write_files(tmp_path, exported.files)
    head, *lines = exported.files["replay.csv"].splitlines()
    face, table = exported.export.interface, np.array([list(map(float, line.split(","))) for line in lines])
    names = [q.name for q in (*face.inputs, *face.measurements)]
    given = table[:, [head.split(",").index(name) for name in names]]
    inputs, measured = np.split(given, [len(face.inputs)], axis=1)
    measured[100:160, 0] = measured[300:450] = np.nan
    measured[200:260, 1] += 5.0
    rows = (",".join(map(repr, row)) for row in np.column_stack([inputs, measured]).tolist())
    (tmp_path / "gaps.csv").write_text("\n".join([",".join(names), *rows]) + "\n")
    made(tmp_path, "all")
    done = subprocess.run(["./foreign_ekf", "gaps.csv"], cwd=tmp_path, capture_output=True, text=True, check=True)
    header, *verdicts = done.stdout.splitlines()
    columns = [header.split(",").index(name) for name in ("trust", "reasons")]
    in_c = np.array([[float(line.split(",")[c]) for c in columns] for line in verdicts])
    groups = ("parameters", "process_noise", "measurement_noise", "first", "first_variance")
    values = [np.repeat(np.array(exported.export.values(g))[:, None], LANES, axis=1) for g in groups]
    lanes = [np.repeat(each[:, :, None], LANES, axis=2) for each in (inputs, measured)]
    held = Held(*values[:4], first_variance=values[4])
    python = exported.estimator.run(InputSeries(lanes[0]), lanes[1], held, Watching(counted.monitor.bounds))
    assert (in_c == python.verdicts[:, :2, 0]).all()
    assert {0.0, 1.0, 2.0} == set(in_c[:, 0])
    assert (in_c[430:450, 1].astype(int) & 32 > 0).all()


USE = """#include "foreign_ekf.h"
int main(void) {
    static foreign_ekf e;
    foreign_ekf_belief belief;
    foreign_ekf_inputs inputs = {0};
    foreign_ekf_measurements measurements = {0};
    foreign_ekf_outcome outcome;
    foreign_ekf_believe(&belief);
    belief.parameters.mass *= 1.1;
    inputs.speed = 15;
    foreign_ekf_begin(&e, &belief);
    foreign_ekf_step(&e, &inputs, &measurements, &outcome);
    return outcome.trust == FOREIGN_EKF_UNPROVEN && (outcome.reasons & FOREIGN_EKF_OTHER_PARAMETERS) != 0 ? 0 : 1;
}
"""


def test_without_a_monitor_the_c_is_as_before(counted, tmp_path):
    (tmp_path / "monitor.toml").write_text(counted.monitor.text)
    without = run.export(study_of(tmp_path), recorded=(None, 1.0))
    with_it = run.export(study_of(tmp_path), recorded=(None, 1.0), monitor=tmp_path / "monitor.toml")
    assert "trust" not in without.files["foreign_ekf.h"] + without.files["foreign_ekf.c"]
    assert without.export.library.digest != with_it.export.library.digest


@pytest.mark.parametrize(
    ("key", "value", "said"),
    [
        ("window", -3, "window: expected a number above 0, not -3"),
        ("nis", [1.0, 2.0], "nis: expected a number below 0 and one above it"),
        ("nis", [1.0], "nis: expected two numbers"),
        ("inputs", {"speed": [1.0, 2.0]}, "inputs: expected steering_wheel_angle, speed"),
        ("bias", {"yaw_rate": "many", "lateral_acceleration": 3.0}, "expected a number above 0, not 'many'"),
        ("study", "0", "counted on estimator 'EKF' of another study"),
        ("says", "much", "says: expected a list of sentences"),
        ("colour", 1, "key 'colour' is unknown"),
    ],
)
def test_a_file_that_is_no_monitor_of_it_is_refused(key, value, said, counted, tmp_path):
    table = tomllib.loads(counted.monitor.text) | {key: value}
    (tmp_path / "monitor.toml").write_text(toml_text(table))
    with pytest.raises(UserError, match=re.escape(said)):
        run.export(study_of(tmp_path), recorded=(None, 1.0), monitor=tmp_path / "monitor.toml")


def test_what_cannot_be_counted_is_said_in_one_line(tmp_path):
    study = study_of(tmp_path)
    with pytest.raises(UserError, match=r"'foreign' has no \[limits\]"):
        count_monitor(study, MonitorSpec({}))
    with pytest.raises(UserError, match="nothing that a monitor could be calibrated on"):
        count_monitor(study, MonitorSpec({"lateral_velocity": 1e-9}, 1.0, 600.0), jobs=1)
    with pytest.raises(UserError, match="none of that name"):
        count_monitor(study, MonitorSpec(LIMITS), "ukf")
    with pytest.raises(UserError, match="holds no two samples"):
        count_monitor(study, MonitorSpec(LIMITS, 0.01), jobs=1)
    with pytest.raises(UserError, match="window of 1000 s: no drive of study 'foreign' is scored for longer than"):
        count_monitor(study, MonitorSpec(LIMITS, 1000.0), jobs=1)
    with pytest.raises(UserError, match="--limit yaw_speed: study 'foreign' has no such target"):
        harness.count_monitor(
            harness.read_study(write_files(tmp_path, {"study.toml": toml_text(FULL)})[0]),
            limits={"yaw_speed": "1 deg/s"},
        )


def test_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "car.toml").write_text(toml_text({**FULL, "limits": {"lateral_velocity": "0.013 m/s"}}))
    words = ["monitor", "car.toml", "--false-alarms", "60", "--window", "1 s", "--runs", "8", "-j", "1"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0, done.output
    folder = tmp_path / "results/monitor-foreign_ekf"
    assert {f.name for f in folder.iterdir()} == {"monitor.toml", "report.html", "report.pdf"}
    done = CliRunner().invoke(app, ["export", "car.toml", "--monitor", str(folder / "monitor.toml"), "-o", "c"])
    assert done.exit_code == 0, done.output
    assert "FOREIGN_EKF_CONTRADICTED = 2" in (tmp_path / "c/foreign_ekf.h").read_text()
    done = CliRunner().invoke(app, [*words, "--limit", "yaw_rat=1"])
    assert done.exit_code == 2
    assert "--limit yaw_rat: study 'foreign' has no such target" in done.output
