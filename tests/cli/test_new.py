"""What ``harness new`` writes works as it is; what is there is never written over."""

import os
import re
import subprocess
import sys
from pathlib import Path

import pytest
from typer.testing import CliRunner

import harness as h
from harness.cli.main import app
from harness.cli.new import WRITES, write_new
from harness.common.errors import UserError
from harness.config import build_study, load_study
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from harness.study.run import run_study
from harness.study.score_names import OK, STATUS
from harness.testing import check_estimator, check_tyre, check_vehicle
from support.observers import CONTENT, OF_THE_LIBRARY, needs_compiler
from support.plugins import forget

COMPONENTS = ("vehicle", "effect", "degradation", "tyre", "estimator")


@pytest.fixture(autouse=True)
def nothing_is_left():
    yield
    forget()


@pytest.fixture
def run():
    def run(*arguments):
        done = CliRunner().invoke(app, [str(a) for a in arguments])
        return done.exit_code, done.output

    return run


@pytest.fixture
def lab(tmp_path, monkeypatch):
    """A new project, and the working directory in it."""
    monkeypatch.chdir(tmp_path)
    write_new("project", "truck-lab")
    monkeypatch.chdir(tmp_path / "truck-lab")
    return tmp_path / "truck-lab"


def test_a_new_project_has_a_study_that_loads(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, printed = run("new", "project", "my-lab")
    assert status == 0
    assert "next: cd my-lab && harness run first" in printed
    monkeypatch.chdir(tmp_path / "my-lab")
    assert load_study("studies/first.toml").name == "first"
    status, printed = run("list", "studies")
    assert status == 0
    assert "studies/first.toml" in printed


def test_the_tests_that_come_with_components_pass(lab):
    for kind in COMPONENTS:
        write_new(kind, f"my_{kind}")
    environment = {**os.environ, "PYTHONPATH": str(Path(__file__).parents[2])}
    command = [sys.executable, "-m", "pytest", "-v", "-p", "no:cacheprovider", "tests"]
    done = subprocess.run(command, cwd=lab, env=environment, capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stdout
    for kind in COMPONENTS:
        assert re.search(rf"my_{kind}\S*\.py::\S+ PASSED", done.stdout), done.stdout


def test_the_test_of_an_observer_passes_and_its_gain_must_fit(lab):
    write_new("estimator observer", "watcher")
    check_estimator("watcher")
    study = build_study({**CONTENT, "estimator": [{"kind": "watcher", "gain": [[0.3, 0.1]]}]}, lab / "study.toml")
    with pytest.raises(UserError, match="2 states and 2 outputs"):
        StudyEvaluator(study)


@needs_compiler
def test_estimators_that_run_in_processes_of_their_own_work_as_they_are(run, lab):
    for form in ("python", "library"):
        status, _ = run("new", "estimator", f"in_{form}", "--kind", form)
        assert status == 0
    command = (lab / "studies" / "in_library.c").read_text().split("\n")[2].removeprefix(" *").split()
    subprocess.run(command, cwd=lab / "studies", check=True)
    estimators = [
        {"name": "C", "kind": "external", "library": "libin_library.so", **OF_THE_LIBRARY},
        {"name": "Python", "kind": "external", "python": "in_python:Observer"},
    ]
    study = build_study({**CONTENT, "estimator": estimators}, lab / "studies" / "study.toml")
    (unit, *_) = units(study, study.designs[0])
    result = StudyEvaluator(study).evaluate(unit)
    assert (result[STATUS] == OK).all()


def test_an_estimator_of_its_own_process_needs_no_project(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    assert run("new", "estimator", "mine", "--kind", "library", "--out", "c")[0] == 0
    assert sorted(p.name for p in (tmp_path / "c").iterdir()) == ["harness_estimator.h", "mine.c"]
    assert run("new", "estimator", "mine", "--kind", "python", "--out", "c")[0] == 0
    assert (tmp_path / "c" / "mine.py").is_file()
    assert run("new", "estimator", "mine", "--out", "c")[0] == 2
    status, said = run("new", "estimator", "mine", "--kind", "python")
    assert (status, "--out" in said) == (2, True)


def test_forms_are_of_estimators(run, lab):
    assert run("new", "vehicle", "mine", "--kind", "python")[0] == 2


def test_what_is_said_to_come_next_of_a_vehicle_works(run, lab):
    _, printed = run("new", "vehicle", "truck")
    command = re.search(r"next: .*; harness (simulate .*)", printed)[1]
    status, said = run(*command.split())
    assert status == 0, said
    assert (lab / "sine.csv").is_file()


def test_two_vehicles_and_a_tyre_live_together(lab):
    for kind, name in (("vehicle", "one"), ("vehicle", "two"), ("tyre", "rubber")):
        write_new(kind, name)
    check_vehicle("one")
    check_tyre("rubber", {"rubber_stiffness": 12.0})


def test_a_new_study_runs(lab):
    write_new("study", "second")
    path = lab / "studies" / "second.toml"
    text = path.read_text().replace("repeats = 10", "repeats = 1").replace('"20 s"', '"5 s"')
    path.write_text(text.replace('["lateral_velocity", "yaw_rate"]', '["lateral_velocity"]'))  # compiled for others too
    assert (run_study(load_study(path), lab / "out", jobs=1) / "scores.zarr").is_dir()


@pytest.mark.parametrize("kind", ["project", "study"])
def test_nothing_is_written_through_a_link(run, kind, tmp_path, monkeypatch):
    (tmp_path / "elsewhere").mkdir()
    (tmp_path / "lab").mkdir()
    (tmp_path / "lab" / "studies").symlink_to(tmp_path / "elsewhere")
    if kind == "study":
        (tmp_path / "lab" / "harness.toml").write_text("")
    monkeypatch.chdir(tmp_path / "lab" if kind == "study" else tmp_path)
    status, output = run("new", kind, "lab")
    assert status != 0
    assert "lab/studies: is a link" in output.replace("\n", "")
    assert list((tmp_path / "elsewhere").iterdir()) == []


@pytest.mark.parametrize("kind", [k for k in WRITES if k != "project"])
def test_nothing_is_written_over(kind, lab):
    write_new(kind, "mine")
    before = {p: p.read_text() for p in lab.rglob("*") if p.is_file()}
    with pytest.raises(UserError, match="is there already"):
        write_new(kind, "mine")
    assert {p: p.read_text() for p in lab.rglob("*") if p.is_file()} == before


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("effect", "crosswind"), "'crosswind' is there already: .*crosswind.py \\(harness\\)"),
        (("effect", "My-Effect"), "small letters, digits and _: my_effect"),
        (("vehicle", "class"), "does not do as a name"),
        (("study", "a/b"), "does not do as a name"),
        (("project", "."), "harness.toml: is there already"),
    ],
)
def test_names_that_do_not_do_are_refused(arguments, says, lab):
    with pytest.raises(UserError, match=says):
        write_new(*arguments)


def test_a_parameter_file_of_a_vehicle_that_there_is_says_what_every_value_means(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, printed = run("new", "parameters", "mine", "--model", "car", "--tyre", "linear")
    assert status == 0, printed
    assert "next: write your own values into it, then: --parameters mine.toml" in " ".join(printed.split())
    text = (tmp_path / "mine.toml").read_text()
    assert "mass = 2303.1 # kg, 0.5 to 5000; mass of the car\n" in text
    (tmp_path / "mine.toml").write_text(text.replace("mass = 2303.1", "mass = 1500"))
    mine = h.model("car", "mine.toml")
    assert mine.parameters.value["mass"] == 1500
    assert mine.stated.get("tyre") is None
    assert "# (rad/s)^2 a step" in text
    status, printed = run("new", "parameters", "mine", "--model", "car")
    assert status == 2
    assert "is there already" in printed


@pytest.mark.parametrize(
    ("arguments", "says"),
    [
        (("parameters", "mine"), "say the vehicle by --model; there are: car, "),
        (("parameters", "mine", "--model", "cra"), "closest: car"),
        (("parameters", "../mine", "--model", "car"), "'../mine' does not do as a name"),
        (("parameters", "../../mine.toml", "--model", "car"), "'../../mine' does not do as a name"),
        (("effect", "mine", "--model", "car"), "--model, --parameters and --tyre are for parameters"),
        (("parameters", "mine", "--model", "car", "--out", "x.toml"), "--out is for channels"),
    ],
)
def test_what_a_parameter_file_needs_is_said(arguments, says, run, lab):
    status, printed = run("new", *arguments)
    assert status == 2
    assert says in " ".join(printed.split())


def test_outside_a_project_the_way_in_is_said(run, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    status, printed = run("new", "effect", "mine")
    assert status == 2
    assert "make a project first: harness new project NAME" in " ".join(printed.split())
    assert not list(tmp_path.iterdir())


def test_a_channel_map_goes_where_maps_are_found(run, lab):
    lines = "\n".join(f"{0.01 * k:.2f},{0.1 * (k % 7):.1f}" for k in range(100))
    (lab / "lap.csv").write_text(f"time [s],YawRate [deg/s]\n{lines}\n")
    status, printed = run("new", "channels", "lap.csv")
    assert status == 0
    assert "yaw_rate: 'YawRate [deg/s]' in deg/s" in printed
    assert (lab / "channels" / "lap.toml").is_file()
    assert run("new", "channels", "lap.csv")[0] == 2
    assert run("new", "channels", "nowhere.csv")[0] == 2
    assert run("new", "effect", "mine", "--out", "x")[0] == 2
    for name in ("new.csv", "new.mf4", "lap.csv"):
        assert run("new", "channels", "lap.csv", "--out", name)[0] == 2
    assert not (lab / "new.csv").exists()
    assert (lab / "lap.csv").read_text().startswith("time [s]")
    assert run("new", "channels", "lap.csv", "--out", "new.toml")[0] == 0
    assert run("new", "channels", "lap.csv", "--database", "a.dbc", "--out", "b.toml")[0] == 2
