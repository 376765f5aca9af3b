"""The folder of an exported estimator: it builds, replays a recorded run, and takes part in a study again."""

import dataclasses
import re
import shutil
import subprocess
import tomllib
from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

import harness as h
from harness.cli.main import app
from harness.common.errors import UserError
from harness.common.files import write_files
from harness.config import build_study
from harness.config.parameter_set import set_text
from harness.realtime.export import run
from harness.realtime.export.interface import TAKEN
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from support.exports import COMPILER, made
from support.observers import CONTENT, needs_compiler

EKF = {"name": "EKF, bold", "kind": "ekf"}
TUNED = {"rule": "by hand", "estimator": {"EKF, bold": {"process": 3.0, "unknown_inputs": 1.0, "measurement": 0.5}}}
FULL = {**CONTENT, "estimator": [EKF, {"name": "PF", "kind": "particle"}], "tuning": TUNED}


def study_of(folder, **changes):
    return build_study({**FULL, **changes}, folder / "study.toml")


def exported(folder, precision="double", **changes):
    """Return an exported estimator whose files are in a folder."""
    made_of = run.export(study_of(folder, **changes), None, precision, None, (None, 3.0))
    write_files(folder, made_of.files)
    return made_of


@needs_compiler
@pytest.mark.parametrize("precision", ["double", "float"])
def test_the_folder_builds_by_itself_and_replays_a_recorded_run(precision, tmp_path):
    name = exported(tmp_path, precision).export.name
    assert name == "foreign_ekf_bold"
    said = made(tmp_path, "check", "CFLAGS=-O1 -g -Werror -fsanitize=address,undefined -fno-sanitize-recover=all")
    assert "301 samples" in said
    memory = re.search(r"has (\d+)\s+\*?\s*bytes of memory", (tmp_path / f"{name}.h").read_text())
    assert f"{memory[1]} bytes of memory: as recorded" in said
    off = [float(x) for x in re.findall(r"(\S+) of its largest", said)]
    assert len(off) == 5
    assert 0 < max(off) < (1e-12 if precision == "double" else 1e-4)


@needs_compiler
def test_a_replay_that_differs_fails(tmp_path):
    name = exported(tmp_path).export.name
    lines = (tmp_path / "replay.csv").read_text().splitlines()
    cells = lines[200].split(",")
    cells[lines[0].split(",").index("estimate_yaw_rate")] = "0.5"
    lines[200] = ",".join(cells)
    (tmp_path / "replay.csv").write_text("\n".join(lines) + "\n")
    made(tmp_path, "all")
    done = subprocess.run([f"./{name}", "check", "replay.csv"], cwd=tmp_path, capture_output=True, check=False)
    assert done.returncode == 1
    assert b"FAILED" in done.stdout


@needs_compiler
def test_a_replay_without_results_or_samples_is_no_check(tmp_path):
    name = exported(tmp_path).export.name
    text = (tmp_path / "replay.csv").read_text()
    (tmp_path / "renamed.csv").write_text(text.replace("estimate_yaw_rate", "yaw_rate_estimate"))
    (tmp_path / "empty.csv").write_text(text.splitlines()[0] + "\n")
    made(tmp_path, "all")
    done = [
        subprocess.run([f"./{name}", "check", file], cwd=tmp_path, capture_output=True, text=True, check=False)
        for file in ("renamed.csv", "empty.csv")
    ]
    assert [each.returncode for each in done] == [2, 1]
    assert "has no column 'estimate_yaw_rate' to compare with" in done[0].stderr
    assert "0 samples" in done[1].stdout
    assert "FAILED" in done[1].stdout


@needs_compiler
def test_a_csv_of_ones_own(tmp_path):
    name = exported(tmp_path).export.name
    made(tmp_path, "all")
    rows = ["yaw_rate,speed,lateral_acceleration,steering_wheel_angle", "0,15,0,0.1", "0.02,15,,0.1", "nan,15,0.3,0.1"]
    (tmp_path / "own.csv").write_text("\n".join(rows) + "\n")
    done = subprocess.run([f"./{name}", "own.csv"], cwd=tmp_path, capture_output=True, text=True, check=True)
    header, *lines = done.stdout.splitlines()
    told = np.array([[float(x) for x in line.split(",")] for line in lines])
    assert header.split(",")[:2] == ["estimate_lateral_velocity", "estimate_yaw_rate"]
    assert header.endswith("nis,outside")
    assert told[0, 0] == 0.0
    assert told[1, 1] > 0.0
    (tmp_path / "own.csv").write_text("yaw_rate,speed\n0,15\n")
    done = subprocess.run([f"./{name}", "own.csv"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert done.returncode == 2
    assert "no column 'steering_wheel_angle'" in done.stderr
    (tmp_path / "own.csv").write_text("yaw_rate;speed;steering_wheel_angle\n0;15;0\n")
    done = subprocess.run([f"./{name}", "own.csv"], cwd=tmp_path, capture_output=True, text=True, check=False)
    assert (done.returncode, "commas separate columns" in done.stderr) == (2, True)


@needs_compiler
def test_a_csv_as_spreadsheets_write_it_and_what_is_refused_of_one(tmp_path):
    name = exported(tmp_path).export.name
    made(tmp_path, "all")

    def ran(text):
        (tmp_path / "own.csv").write_bytes(text.encode())
        return subprocess.run([f"./{name}", "own.csv"], cwd=tmp_path, capture_output=True, text=True, check=False)

    head, rows = "time,steering_wheel_angle,speed,yaw_rate,lateral_acceleration", ["0,0.1,15,,", "0.01,0.1,15,0.02,0.3"]
    plain = ran("\n".join([head, *rows]) + "\n")
    assert plain.returncode == 0
    times = [line.split(",")[0] for line in plain.stdout.splitlines()]
    assert times == ["time", "0", "0.01"]
    quoted = [" , ".join(f'"{cell}"' for cell in line.split(",")) for line in (head, *rows)]
    assert ran("\ufeff" + "\r\n".join([*quoted, "", ""])).stdout == plain.stdout
    for text, word in (
        ([head, rows[0], "0.02,0.1,15,0.02,0.3"], "line 3: time does not go on by the estimator's step in s"),
        ([head, *(f"{0.0109 * i},0.1,15,0.02,0.3" for i in range(20))], "line 14: time does not go on by"),
        ([f"{head}\r{rows[0]}\r{rows[1]}"], "line 1: has carriage returns within"),
        ([head], "line 1: there is no sample"),
        ([head, rows[0], "0.01,0.1,15,0.02 rad/s,0.3"], "line 3: is no number: 0.02 rad/s"),
        ([head, rows[0], "0.01,0.1,inf,0.02,0.3"], "line 3: is no number: inf"),
        ([head, rows[0], "0.01,0.1,,0.02,0.3"], "line 3: there is no number of the input speed"),
        ([head, rows[0], "0.01,0.1"], "line 3: has more or fewer cells than the first line"),
        ([f"{head},speed", f"{rows[0]},1"], "line 1: there are two columns speed"),
        ([head + ",x" * 40000, rows[0]], "line 1: is too long"),
        ([head + ",x" * 1000, rows[0]], "line 1: has too many cells"),
    ):
        done = ran("\n".join(text) + "\n")
        assert done.returncode == 2
        assert word in done.stderr
    jittering = [head, *(f"{0.01 * i + 0.0004 * (-1) ** i},0.1,15,0.02,0.3" for i in range(500))]
    assert ran("\n".join(jittering) + "\n").returncode == 0
    without = ran("steering_wheel_angle,speed,yaw_rate\n0.1,15,0\n")
    assert without.returncode == 0
    assert "no column 'lateral_acceleration': this measurement is missing throughout" in without.stderr


@needs_compiler
@pytest.mark.skipif(shutil.which("cmake") is None, reason="there is no CMake")
def test_cmake_builds_and_tests_it(tmp_path):
    exported(tmp_path)
    for command in (["cmake", "-B", "build"], ["cmake", "--build", "build"], ["ctest", "--test-dir", "build"]):
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, check=False)
        assert done.returncode == 0, done.stdout + done.stderr
    assert "1/1 Test" in done.stdout


@needs_compiler
def test_the_header_is_one_of_cpp_as_well(tmp_path):
    name = exported(tmp_path).export.name
    if shutil.which("g++") is None:
        pytest.skip("there is no C++ compiler")
    (tmp_path / "use.cpp").write_text(f'#include "{name}.h"\nint main() {{ {name}_belief b; {name}_believe(&b); }}\n')
    made(tmp_path, "all")
    subprocess.run([COMPILER, "-c", f"{name}.c"], cwd=tmp_path, check=True)
    subprocess.run(["g++", "-Wall", "-Werror", "use.cpp", f"{name}.o", "-lm"], cwd=tmp_path, check=True)


@needs_compiler
def test_the_library_has_the_scores_of_the_estimator_that_it_was_printed_from(tmp_path):
    kernel = exported(tmp_path)
    made(tmp_path, "all")
    table = tomllib.loads((tmp_path / "estimator.toml").read_text())["estimator"]
    study, with_c = study_of(tmp_path), study_of(tmp_path, estimator=table, tuning=None)
    both = dataclasses.replace(study, estimators=(study.estimators[0], *with_c.estimators))
    assert both.estimators[0].noise  # it is tuned, and what it was told is in the library
    evaluator = StudyEvaluator(both)
    for index in range(evaluator.kernels):
        evaluator.warm_up(index)
    results = [evaluator.evaluate(unit) for design in both.designs for unit in units(both, design)]
    assert evaluator.lost() == []
    for name in ("rmse", "max_error", "nis", "nis_inside", "status"):
        ours, c = np.moveaxis(np.concatenate([r[name] for r in results]), 2, 0)
        assert np.isfinite(ours).all()
        np.testing.assert_allclose(c, ours, rtol=1e-9, atol=0)
    assert kernel.export.factors["process_noise"][0] == pytest.approx(3.0)


def test_the_header_has_every_quantity_with_unit_and_frame(tmp_path):
    files = exported(tmp_path).files
    text = files["foreign_ekf_bold.h"]
    for line in (
        r"steering_wheel_angle; /\* rad; frame \w+; ",
        r"yaw_rate; /\* rad/s; frame \w+; ",
        r"lateral_velocity; /\* \(m/s\)\^2 \*/",
        r"mass; /\* kg; ",
    ):
        assert re.search(rf"foreign_ekf_bold_real {line}", text), line
    assert study_of(tmp_path).hash in text
    assert set(files) > {"Makefile", "CMakeLists.txt", "README.md", "replay.csv", "estimator.toml"}
    assert all("@" not in content.replace("$@", "").replace("@dataclass", "") for content in files.values())


def test_another_setting_is_another_digest_of_the_study(tmp_path):
    one, other = (exported(tmp_path / str(i), seed=i).export for i in (1, 2))
    assert one.study != other.study
    assert one.library.digest == other.library.digest


def test_what_cannot_be_exported_is_said_in_one_line(tmp_path):
    study = study_of(tmp_path)
    with pytest.raises(UserError, match=r"estimator 'PF' \(particle\) cannot be exported: it draws random numbers"):
        run.export(study, "PF")
    with pytest.raises(UserError, match="none of that name; there are: EKF, bold, PF"):
        run.export(study, "pf")
    with pytest.raises(UserError, match="no such drive"):
        run.export(study, recorded=("circle", 3.0))
    noisy = study_of(tmp_path, belief={"noise": {"input": {"speed": "0.01 m^2/s^2"}}})
    with pytest.raises(UserError, match="noise of inputs"):
        run.export(noisy)


@needs_compiler
def test_a_parameter_file_is_the_belief(tmp_path):
    study = study_of(tmp_path)
    spec = dataclasses.replace(study.belief, values={**study.belief.values, "mass": 1400.0})
    further = {"sensors": "car_lateral", "unknown_parameters": [{"name": "mass", "prior": "200 kg"}]}
    (tmp_path / "belief.toml").write_text(set_text(spec, "a test", {}, further=further))
    believed = run.believing(study, tmp_path / "belief.toml")
    assert believed.belief.values["mass"] == 1400.0
    name, files = (made_of := run.export(believed, None, recorded=(None, 3.0))).export.name, made_of.files
    write_files(tmp_path, files)
    assert "estimate_mass" in made(tmp_path, "check")
    measured = files[f"{name}.h"].split("measured at a sample")[1].split(f"{name}_measurements;")[0]
    assert "lateral_acceleration" in measured
    assert "yaw_rate" not in measured
    with pytest.raises(UserError, match="no such file"):
        run.believing(study, tmp_path / "nothing.toml")


def test_no_export_is_called_as_a_function_of_a_template():
    templates = Path(run.__file__).parent / "templates"
    texts = [path.read_text() for path in templates.glob("*.[ch]")]
    functions = {name for text in texts for name in re.findall(r"^static [^=;]*?(\w+)\(", text, re.MULTILINE)}
    assert {"advance", "read_line"} < functions
    assert functions - TAKEN - {n for n in functions if n.startswith(("get_", "set_"))} == set()
    types = {name for text in texts for name in re.findall(r"^} (\w+);", text, re.MULTILINE)}
    assert types - TAKEN - {n for n in types if n.startswith("fmi")} == set()


def test_the_command(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    study = h.Study(
        plant=h.model("car", "govindarajan_2018", tyre="linear", sensors="car_series"),
        targets=CONTENT["targets"],
        drives=[h.drive(**CONTENT["drive"][0])],
        estimators=["ekf"],
        designs=[h.design("nominal")],
        name="car",
    )
    (tmp_path / "car.toml").write_text(study.spec.text)
    for name in ("my filter", "printf", "double", "class", "3d", "model"):
        done = CliRunner().invoke(app, ["export", "car.toml", "--name", name])
        assert done.exit_code == 2
        assert f"--name '{name}'" in done.output
    done = CliRunner().invoke(app, ["export", "car.toml", "--duration", "1 h", "--name", "my_filter"])
    assert done.exit_code == 0, done.output
    assert "5 s of drive 'sine', which is no longer" in " ".join(done.output.split())
    assert (tmp_path / "results/export-my_filter/my_filter.c").is_file()
    (tmp_path / "mine").mkdir()
    (tmp_path / "mine/Makefile").write_text("all:\n")
    for folder in ("mine", "results/export-my_filter"):  # of the user's own, and of another estimator
        done = CliRunner().invoke(app, ["export", "car.toml", "--duration", "2 s", "--out", folder])
        assert done.exit_code == 2
        assert "would be written over; take another folder" in done.output
    assert (tmp_path / "mine/Makefile").read_text() == "all:\n"
    done = CliRunner().invoke(app, ["export", "car.toml", "-e", "UKF"])
    assert done.exit_code == 2
