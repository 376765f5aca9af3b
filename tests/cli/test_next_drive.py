"""``harness next-drive``: from a fit to drives that studies and commands take; bad requests in one line."""

import json
import shlex
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest
from typer.testing import CliRunner

import harness as h
from harness.cli.main import app
from harness.common.files import read_toml
from harness.experiment.files import names_of, once_driven, written_to
from harness.experiment.limits import Limits
from harness.experiment.report import answer, limits_words, report
from harness.experiment.run import DesignTask, _Judge, design_drives
from harness.reporting.style import number
from support.identification import CAR

FREE = ["stiffness_over_load_front", "mass_over_inertia"]
RECORDED = " --train RECORDING"


@pytest.fixture(scope="module")
def fit(tmp_path_factory):
    car = h.model(**CAR, integrator="rk4")
    circle = h.drive("steady_circle", duration="10 s", speed="12 m/s", radius="60 m")
    folder = tmp_path_factory.mktemp("results") / "fit"
    h.identify(car, h.simulate(car, circle, seed=1), FREE, settings={"profiles": False, "annealings": 0}).report(folder)
    return folder


def run(*words):
    return CliRunner().invoke(app, ["next-drive", *map(str, words)])


def test_drives_are_planned_written_and_taken(fit, tmp_path):
    out = tmp_path / "plan"
    limits = tmp_path / "limits.toml"
    limits.write_text('lateral_acceleration = "4 m/s^2"\nduration = "15 s"\n')
    done = run(fit, "--out", out, "--for", "mass_over_inertia", "--limits", limits, "--manoeuvre", "circle,sweep",
               "--effort", 8, "--budget", "30 s", "--jobs", 1)  # fmt: skip
    assert done.exit_code == 0, done.output
    assert f"once driven: harness identify --after {out} --train RECORDING" in done.stdout
    assert f"harness identify --after {out} --train RECORDING" in (out / "report.html").read_text()
    plan = json.loads((out / "next_drive.json").read_text())
    assert plan["ranked"][0]["manoeuvre"] == "sweep"
    error = plan["expected"]["parameters"]["mass_over_inertia"]["standard_error"]
    assert error["after"] < 0.5 * error["before"]
    assert plan["seconds"] <= 30.0
    ((name, table),) = [(s["name"], s["drive"]) for s in plan["sequence"]][:1]
    (drive, *_) = read_toml(out / "next_drive.toml")["drive"]
    assert drive == {**table, "name": name}
    car = h.model("car_reference_point", str(fit / "parameters.toml"), sensors="car_reference")
    profile = h.drive(**drive).profile(car)
    robot = pd.read_csv(out / f"{name}.csv")
    np.testing.assert_allclose(robot.steering_wheel_angle, profile.steering_wheel_angle, atol=1e-6)
    np.testing.assert_allclose(robot.road_wheel_angle * car.spec.steering_ratio, robot.steering_wheel_angle, atol=1e-6)
    again = h.drive("from_file", file=str(out / f"{name}.csv"), fade=0.0, cutoff=1000.0).profile(car)
    np.testing.assert_allclose(again.speed, profile.speed, rtol=1e-6)
    largest = np.abs(profile.steering_wheel_angle).max()
    np.testing.assert_allclose(again.steering_wheel_angle, profile.steering_wheel_angle, atol=0.02 * largest)
    assert (out / "report.pdf").stat().st_size > 0
    page = (out / "report.html").read_text().partition("What is expected?")[0]
    assert f"Enter straight ahead at {3.6 * profile.speed[0]:.1f}".removesuffix(".0") in page
    assert f"amplitude {np.degrees(table['amplitude']):.1f}".removesuffix(".0") in page
    assert f"last frequency {number(table['last_frequency'])} Hz" in page
    assert run(fit, "--out", out, "--manoeuvre", "step", "--effort", 2, "--jobs", 1).exit_code == 0
    assert sorted(p.name for p in out.glob("*.csv")) == ["1-step.csv"]


@pytest.mark.parametrize(
    ("record", "baseline", "line"),
    [
        ({"models": {}}, None, "harness trace --after results/truck --train RECORDING --test RECORDING"),
        ({"models": {}}, {"drives": ["monday"]}, ""),  # neither of these does --after take
        ({"limits": {}}, None, "harness trace --after results/truck --train RECORDING --test RECORDING"),
        ({"parameters": {}, "errors": [], "fit": None}, None, ""),  # of a study of tolerances
        ({"parameters": {}, "errors": [], "fit": "f"}, None, "harness identify --after results/truck" + 2 * RECORDED),
    ],
)
def test_how_a_trace_goes_on_from_the_drives_is_said(record, baseline, line, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    Path("results/truck").mkdir(parents=True)
    Path("results/truck/trace.json").write_text(json.dumps({"baseline": baseline}), encoding="utf-8")
    task, plan = SimpleNamespace(folder=Path("results/truck")), SimpleNamespace(sequence=[(None, 2)])
    designed = SimpleNamespace(expectation=SimpleNamespace(record=record), task=task, plan=plan)
    assert once_driven(designed, Path("results/truck/next-drive")) == line
    assert once_driven(designed, Path("weave")) == line.replace("results/truck", "weave")
    plan.sequence = [(None, 2), (None, 4)]
    assert once_driven(designed, Path("weave")).count("--test RECORDING") == (3 if "--test" in line else 0)


def test_drives_of_one_manoeuvre_are_told_apart_and_the_wheel_stands_at_tenths_of_a_degree(fit, tmp_path):
    task = DesignTask(fit, limits=Limits(highest_speed=80.0), budget=60.0, manoeuvres=("weave",), effort=4, jobs=1)
    designed = design_drives(task)
    (drive,) = designed.plan.ranked
    rehearsed = drive.rehearsed
    wheel = rehearsed.profile.steering_wheel_angle.copy()
    wheel[-1] = 2e-16
    still = replace(rehearsed, profile=replace(rehearsed.profile, steering_wheel_angle=wheel))
    options = {**rehearsed.drive.options, "frequency": 0.123}
    slower = replace(still, drive=replace(rehearsed.drive, options=options))
    sequence = tuple((replace(drive, rehearse=lambda r=r: r), 1) for r in (still, slower))
    several = replace(designed, plan=replace(designed.plan, sequence=sequence))
    assert "frequency 0.123 Hz" in answer(several)
    assert answer(several).count("frequency") == 2
    assert "speed" not in answer(several)  # which is the same of both
    assert "highest speed 288 km/h" in limits_words(several)
    report(several, fit, "test").write(tmp_path)
    page = (tmp_path / "report.html").read_text().partition("What is expected?")[0]
    assert page.count("the wheel stands at 0°") == 2
    assert page.index("Record ") < page.index("path from above")


def test_a_plan_that_expects_what_is_known_now_says_so(fit):
    designed = design_drives(DesignTask(fit, budget=10.0, manoeuvres=("step",), effort=2, jobs=1))
    assert "no more than" not in answer(designed)
    assert "no more than" in answer(replace(designed, plan=replace(designed.plan, evidence=None)))


def test_every_drive_of_a_sequence_has_its_command(fit):
    names = ("step", "sweep")
    designed = design_drives(
        DesignTask(fit, limits=Limits(duration=8.0), budget=16.0, manoeuvres=names, effort=4, jobs=1)
    )
    sequence = [(t, 1) for t in designed.plan.ranked]
    several = replace(designed, plan=replace(designed.plan, sequence=tuple(sequence)))
    commands = [shlex.split(line) for line in written_to(several, fit)]
    assert [c[c.index("--drive") + 1] for c in commands] == [t.manoeuvre.kind for t, _ in sequence]
    for words, name in zip(commands, names_of(several), strict=True):
        done = CliRunner().invoke(app, words[1:])
        assert done.exit_code == 0, done.output
        assert (fit / f"{name}-simulated.csv").is_file()


@pytest.mark.parametrize(
    ("words", "said"),
    [
        (("--for", "yaw_inertia"), "is no fitted parameter"),
        (("--manoeuvre", "swep"), "closest: sweep"),
        (("--limit", "road=3"), "no limit 'road'"),
        (("--limit", "road_width=1 mm", "--effort", 1, "--manoeuvre", "step"), "step: road_width"),
        (("--for", "mass_over_inertia=much", "--criterion", "c"), "write the weight as a number"),
        (("--for", "mass_over_inertia=2"), "weights are those of criterion c"),
        (("--for", "mass_over_inertia=0", "--criterion", "c"), "every weight is zero"),
        (("--budget", "1 s", "--effort", 1, "--manoeuvre", "step"), "step: budget"),
    ],
)
def test_a_bad_request_is_one_line(fit, tmp_path, words, said):
    done = run(fit, "--out", tmp_path, "--jobs", 1, *words)
    assert done.exit_code == 2, done.output
    assert said in done.stderr.replace("\n", " ")


def test_a_manoeuvre_without_a_drive_is_named(fit, tmp_path):
    done = run(fit, "--out", tmp_path, "--jobs", 1, "--effort", 2, "--manoeuvre", "circle,step", "--limit",
               "road_length=150 m", "--limit", "road_width=20 m")  # fmt: skip
    assert done.exit_code == 0, done.output
    assert "circle: no drive keeps to the limits and the budget (road_" in done.output


def test_a_file_is_no_result(fit):
    done = run(fit / "parameters.toml")
    assert done.exit_code == 2
    assert "parameters.toml: is a file; name the folder" in done.stderr.replace("\n", " ")


def test_a_folder_without_a_fit_is_refused(tmp_path):
    done = run(tmp_path)
    assert done.exit_code == 2
    assert [name in done.stderr for name in ("identify.json", "trace.json", "scores.zarr")] == [True, True, True]


def test_a_filter_that_has_all_outputs_of_a_set_judges_it_as_its_own_would(fit, monkeypatch):
    monkeypatch.setattr("harness.experiment.run.fitting_sensors", lambda *_: ["car_lateral", "car_reference"])
    asked = DesignTask(fit, budget=10.0, manoeuvres=("step",), effort=2, sensors=True, jobs=1)
    own = design_drives(asked)
    recorded = {e.name: e.expectation.record for e in own.equipped}
    assert recorded["car_reference"] == own.goal.expectation(own.plan.evidence).record  # which recorded the fit
    monkeypatch.setattr("harness.experiment.run._Judge.judges", lambda *_: False)
    for e in design_drives(asked).equipped:
        for name, entry in e.expectation.record["parameters"].items():
            same = pytest.approx(entry["standard_error"]["after"], rel=1e-6)
            assert recorded[e.name]["parameters"][name]["standard_error"]["after"] == same


@pytest.mark.parametrize(
    ("parameters", "outputs", "judged"),
    [
        (["mass"], ["yaw_rate"], True),
        (["mass", "sensor_bias_yaw_rate"], ["yaw_rate"], True),
        (["mass", "sensor_bias_lateral_acceleration"], ["yaw_rate"], False),  # which is refused, or filters without it
        (["mass"], ["yaw_rate", "lateral_velocity"], False),
    ],
)
def test_a_filter_judges_no_outputs_that_it_lacks_or_whose_parameters_they_do_not_show(parameters, outputs, judged):
    spec = SimpleNamespace(model=lambda: SimpleNamespace(outputs={"yaw_rate": None, "lateral_acceleration": None}))
    goal = SimpleNamespace(model=SimpleNamespace(spec=spec, names=parameters))
    assert _Judge(goal, ()).judges(outputs) is judged
