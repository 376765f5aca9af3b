"""Estimators of somebody else beyond the study's scores: recordings, stores, reports, replays, commands."""

import numpy as np
import pytest
from typer.testing import CliRunner

import harness as h
from harness.cli.main import app
from harness.common.errors import UserError
from harness.config import build_study, load_study
from harness.realtime.measure import contestants, measure
from harness.realtime.outcome import PACES
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from harness.study.replay import Place, Replayer
from harness.study.run import run_study
from harness.study.stored import study_of
from support.observers import CONTENT, OF_THE_LIBRARY, compiled, needs_compiler, source

FILTER = """
import numpy as np

class Filter:
    inputs, measurements, estimates = (), ("yaw_rate",), ("yaw_rate",)
    variances = nis = True

    def reset(self, values, step):
        self.x, self.P = 0.0, values["first_variance.yaw_rate"]
        self.Q, self.R, self.k = values["process_noise.yaw_rate"] + 1e-4, values["measurement_noise.yaw_rate"], 0

    def step(self, u, y, dt):
        self.P += self.Q * (dt > 0.0)
        nis = np.nan
        if not np.isnan(y[0]):
            S, off = self.P + self.R, y[0] - self.x
            nis = off * off / S
            self.x, self.P = self.x + self.P / S * off, self.P - self.P**2 / S
        return self.x, self.P, nis

class Both(Filter):
    estimates = ("yaw_rate", "lateral_velocity")
    def step(self, u, y, dt):
        x, P, nis = super().step(u, y, dt)
        return [x, 0.0], [P, 1.0], nis

class Ends(Filter):
    def step(self, u, y, dt):
        self.k += 1
        if self.k == 101:
            raise ValueError("over")
        return super().step(u, y, dt)
"""

CAR = {"model": "car", "parameters": "govindarajan_2018", "tyre": "linear", "sensors": "car_series"}


@pytest.fixture
def folder(tmp_path, monkeypatch):
    (tmp_path / "walks.py").write_text(FILTER)
    (tmp_path / "observer.py").write_text(source("observer.py"))
    monkeypatch.chdir(tmp_path)
    return tmp_path


@pytest.fixture
def driven():
    car = h.model("car", "govindarajan_2018", tyre="linear", sensors="car_series")
    return car, h.simulate(car, h.drive("sine", duration="5 s", amplitude="20 deg"), seed=1)


def test_on_a_recording_beside_our_filter(folder, driven):
    car, recording = driven
    estimates = h.estimate(car, recording, {"ours": "ekf", "walk": h.Estimator("external", python="walks:Filter")})
    walk = estimates.runs[("sine", "walk")]
    error = walk.error_yaw_rate.values[20:]
    assert np.sqrt(np.mean(error**2)) < 0.01
    assert np.isnan(walk.lateral_velocity).all()
    assert (walk.nees_degrees.values[1:] == 1).all()
    assert 0.01 < np.nanmean(walk.nis) < 10.0
    assert np.isfinite(walk.nees_yaw_rate.values[1:]).all()
    assert np.isnan(walk.attrs["diverged_at"])
    both = h.Estimator("external", python="walks:Both").run(car, recording)  # what two have in common is not stated
    assert np.isfinite(both.nees_lateral_velocity.values[1:]).all()
    assert np.isnan(both.nees.values[1:]).all()
    assert np.isnan(estimates.summary.log_likelihood[("sine", "walk")])


def test_what_ends_on_a_recording_is_said(folder, driven):
    car, recording = driven
    estimates = h.estimate(car, recording, {"ends": h.Estimator("external", python="walks:Ends")})
    assert estimates.runs[("sine", "ends")].attrs["diverged_at"] == pytest.approx(1.0)
    assert any("1 run lost: ValueError: over" in note for note in estimates.notes)


def study(folder, reference="walks:Filter"):
    estimators = [{"name": "EKF", "kind": "ekf"}, {"name": "walk", "kind": "external", "python": reference}]
    design = {**CONTENT["design"][0], "repeats": 2}
    history = {"design": "mass", "drive": "sine", "levels": {"mass": 1000.0}}
    return build_study(
        {**CONTENT, "estimator": estimators, "design": [design], "history": history}, folder / "foreign.toml"
    )


def test_a_result_is_of_the_files_that_it_was_made_with(folder):
    given = study(folder)
    out = run_study(given, folder / "out", jobs=1)
    assert study_of(out).hash == given.hash
    run = Replayer(given).run(Place(0, 0, 0), everything=True)
    assert np.isfinite(run.data.estimate.sel(estimator="walk", target="yaw_rate").values[1:]).all()
    assert np.isfinite(run.data.nis.sel(estimator="walk").values[1:]).all()
    stored = h.open_results(out)
    (folder / "walks.py").write_text(FILTER + "\n# another\n")
    assert study(folder).hash != given.hash
    (folder / "walks.py").unlink()
    assert all(path.is_file() for path in stored.report())
    with pytest.raises(UserError, match=r"needs walks:Filter as it was"):
        study_of(out)


def test_the_nis_of_one_sensor_of_two_compares_with_that_of_both(folder):
    (folder / "walks.py").write_text(FILTER.replace("nis = off * off / S", "nis = 1.0"))
    evaluator = StudyEvaluator(study(folder))
    unit = units(evaluator.study, evaluator.study.designs[0])[0]
    np.testing.assert_allclose(evaluator.evaluate(unit)["nis"][:, :, 1], 2.0)
    np.testing.assert_allclose(evaluator.evaluate(unit)["nis_inside"][:, :, 1], 1.0)
    run = Replayer(evaluator.study).run(Place(0, 0, 0))
    np.testing.assert_allclose(run.data.nis.sel(estimator="walk").values[1:], 2.0)


def test_it_is_listed_with_its_settings():
    done = CliRunner().invoke(app, ["list", "estimators", "external"])
    assert done.exit_code == 0, done.output
    assert "measurements" in done.output


def test_the_command_says_what_was_lost(folder):
    text = (
        'name = "foreign"\ntargets = ["yaw_rate"]\n'
        'plant = { vehicle = "car", parameters = "govindarajan_2018", tyre = "linear", sensors = "car_series" }\n'
        'drive = [{ name = "sine", kind = "sine", duration = "5 s", speed = "15 m/s", amplitude = "20 deg" }]\n'
        'estimator = [{ name = "EKF", kind = "ekf" }, { name = "ends", kind = "external", python = "walks:Ends" }]\n'
        'design = [{ name = "nominal", repeats = 3 }]\n'
    )
    (folder / "foreign.toml").write_text(text)
    assert load_study("foreign.toml").estimators[1].settings["python"] == "walks:Ends"
    done = CliRunner().invoke(app, ["run", "foreign.toml", "--out", "out", "--jobs", "1"])
    assert done.exit_code == 0, done.output
    assert "walks:Ends: 3 runs lost: ValueError: over (walks.py, line 31)" in done.output.replace("\n", " ")


@needs_compiler
def test_single_steps_are_timed_in_their_process(folder):
    compiled(folder, source("observer.c"))
    estimators = [
        {"name": "C", "kind": "external", "library": "libobserver.so", **OF_THE_LIBRARY},
        {"name": "Python", "kind": "external", "python": "observer:Observer"},
        {"name": "EKF", "kind": "ekf"},
    ]
    field = contestants(build_study({**CONTENT, "estimator": estimators}, folder / "study.toml"), "sine", 1.0)
    times = measure(field, 101, 0.002)
    c, python, ekf = (times.step_time.sel(estimator=n, pace=PACES[0]).median().item() for n in ("C", "Python", "EKF"))
    assert 0.0 < c < python < 1e-3
    assert 0.0 < ekf < 1e-3
    np.testing.assert_allclose(field["C"].mean, field["Python"].mean, rtol=1e-9)


def test_what_fails_when_timed_is_an_error_in_one_line(folder):
    estimators = [{"name": "ends", "kind": "external", "python": "walks:Ends"}]
    field = contestants(build_study({**CONTENT, "estimator": estimators}, folder / "study.toml"), "sine", 2.0)
    with pytest.raises(UserError, match=r"its steps cannot be timed: ValueError: over"):
        measure(field, 150, 0.002)
