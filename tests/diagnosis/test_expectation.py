"""What was expected of planned drives against what came, and an earlier trace that is gone on from."""

import json
import math

import numpy as np
import pandas as pd
import pytest
from rich.console import Console
from typer.testing import CliRunner

import harness as h
from harness.cli.main import app
from harness.common.errors import UserError
from harness.common.statistics import Interval
from harness.diagnosis.criteria import HORIZONS
from harness.diagnosis.earlier_trace import EarlierTrace, models_left
from harness.diagnosis.measured_study import trace_study
from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.result.expectation import expectation_met
from harness.diagnosis.run import _driven_otherwise
from harness.diagnosis.selection.posterior import Alike, ComparedModel, Posterior
from harness.identification.earlier_result import record_of_recordings, with_absolute_paths
from harness.identification.measured_file import MeasuredStudy
from harness.recordings import load_recording


def compared(names, share, difference):
    alike = tuple(Alike((Hypothesis(n, "effect", (n,)),), (1.0,)) for n in names)
    interval = Interval(difference, difference, difference)
    return ComparedModel(alike, None, 0.0, np.zeros(len(HORIZONS)), interval, share, share)


def added(*names):
    return [[{"name": n, "kind": "effect"}] for n in names]


EARLIER = {
    "confusable": {
        "models": [
            {"added": added("steering_lag"), "share": 0.6},
            {
                "added": [[{"name": "steering_delay", "kind": "effect"}, {"name": "other", "kind": "effect"}]],
                "share": 0.3,
            },
            {"added": [], "share": 0.1},
        ]
    },
    "posterior": {
        "none_of_these": 0.02,
        "models": [
            {"added": added("steering_lag"), "difference": {"value": 0.0}},
            {
                "added": [[{"name": "steering_delay", "kind": "effect"}, {"name": "other", "kind": "effect"}]],
                "difference": {"value": -1.0},
            },
            {"added": [], "difference": {"value": -2.0}},
        ],
    },
}
PLAN = {
    "expected": {
        "stands": 0.9,
        "models": {
            "steering lag": {"share": 0.6, "expected": 0.97, "d2": [0.0, 16.0, 100.0]},
            "steering delay": {"share": 0.3, "expected": 0.9, "d2": [9.0, 0.0, 64.0]},
            "nothing added": {"share": 0.1, "expected": 0.9, "d2": [81.0, 64.0, 0.0]},
        },
    }
}


def met(*models):
    return expectation_met(EARLIER, PLAN, Posterior(models, 0.01, np.zeros(len(HORIZONS))))


def test_a_ratio_is_compared_with_its_normal_distribution():
    found = met(compared(["steering_lag"], 0.98, 0.0), compared(["steering_delay"], 0.02, -11.0))
    delay, nothing = found.ratios
    assert (delay.expected, delay.deviation, delay.realised) == pytest.approx((8.0, 4.0, 10.0))  # 11 less 1 of before
    assert delay.z == pytest.approx(0.5)
    assert math.isnan(nothing.realised)
    assert "nothing added was not fitted" in nothing.words  # and is not out of the question therefore
    assert found.verdict == "as expected"
    assert found.stands
    record = json.loads(json.dumps(found.record, default=str))
    assert record["probability"] == {"before": 0.6, "expected": 0.97, "realised": 0.98}
    assert record["stands"] == {"expected": 0.9, "realised": True}


def test_drives_that_told_less_or_something_else_are_said_to():
    less = met(compared(["steering_delay"], 0.6, 0.0), compared(["steering_lag"], 0.4, -0.4))
    assert less.leading == "steering delay"
    assert less.ratios[0].realised == pytest.approx(1.4)  # it has made good the 1 that it was behind
    assert less.verdict == "undecided"  # 4.5 with a deviation of 3: as near to nothing
    assert not less.stands
    behind = met(compared(["steering_lag"], 0.9, 0.0), compared(["steering_delay"], 0.1, 2.0))
    assert behind.verdict == "less"
    other = met(compared(["crosswind"], 0.9, 0.0), compared(["steering_lag"], 0.1, -2.0))
    assert other.verdict == "another model"
    assert other.likeliest == "crosswind"
    assert not other.stands
    assert expectation_met(EARLIER, PLAN, None) is None


def test_what_was_alike_is_told_apart_by_the_plan_one_by_one():
    """The second model of the trace has two names, which the plan tells apart and the drives did."""
    names = {"steering delay": "steering_delay", "other": "other"}
    alike = {
        words: {"share": 0.5, "expected": 0.9, "d2": [0.0, 25.0], "added": [{"name": name, "kind": "effect"}]}
        for words, name in names.items()
    }
    plan = {"expected": {"stands": 0.9, "models": alike}}
    models = compared(["other"], 0.99, 0.0), compared(["steering_delay"], 0.01, -12.5)
    came = expectation_met(EARLIER, plan, Posterior(models, 0.0, np.zeros(len(HORIZONS))))
    assert came.leading == "other"
    assert came.ratios[0].realised == pytest.approx(12.5)  # neither was ahead of the other before


def test_which_of_two_models_is_out_of_the_question_is_said():
    delay, lag, out = ["steering_delay"], ["steering_lag"], -math.inf
    rival = met(compared(lag, 1.0, 0.0), compared(delay, 0.0, out))
    assert rival.ratios[0].realised == math.inf
    assert "so much that steering delay is out of the question" in rival.ratios[0].words
    leading = met(compared(delay, 0.1, out), compared(lag, 0.0, -2.0))
    assert leading.ratios[0].realised == -math.inf
    assert "out of the question itself" in leading.ratios[0].words
    assert leading.verdict == "less"
    neither = met(compared(["crosswind"], 0.9, 0.0))
    assert neither.verdict == "another model"
    assert all("not fitted" in r.words and math.isnan(r.realised) for r in neither.ratios)
    assert "out of the question" not in neither.words
    both = met(compared(lag, 0.9, out), compared(delay, 0.1, out))
    assert "do not hold" in both.ratios[0].words


def test_no_growth_is_not_as_expected_however_wide_its_deviation():
    def grown(by):  # the lag led by 1; 8 is expected, with a deviation of 4
        return met(compared(["steering_lag"], 0.9, 0.0), compared(["steering_delay"], 0.1, -1.0 - by))

    assert [grown(by).verdict for by in (-0.5, 0.1, 3.9, 4.1, 16.5)] == [
        "less",
        *2 * ["undecided"],
        "as expected",
        "more",
    ]
    said = ["No growth at all would be within two deviations too" in grown(by).words for by in (0.1, 4.1, 16.5)]
    assert said == [True, True, False]


def test_other_drives_than_planned_are_compared_with_no_expectation():
    models = compared(["steering_lag"], 0.98, 0.0), compared(["steering_delay"], 0.02, -11.0)
    found = expectation_met(EARLIER, PLAN, Posterior(models, 0.01, np.zeros(len(HORIZONS))), "calm is not as planned")
    assert (found.verdict, found.ratios) == ("not compared", ())
    assert "calm is not as planned" in found.words
    assert found.record["log_likelihood_ratios"] == []


def recording(path, seed):
    time = np.arange(0.0, 30.0, 0.01)
    noise = np.random.default_rng(seed).normal(size=len(time))
    names = ("time", "yaw_rate", "lateral_acceleration", "steering_wheel_angle", "speed")
    columns = (time, 0.01 * noise, 0.1 * noise, np.sin(time), 15.0 + 0 * time)
    pd.DataFrame(dict(zip(names, columns, strict=True))).to_csv(path, index=False)
    return load_recording(path)


@pytest.fixture
def earlier(tmp_path):
    """Return the folder of a trace with two recordings and a plan."""
    train, test = recording(tmp_path / "train.csv", 1), recording(tmp_path / "test.csv", 2)
    asked = {
        "model": {"vehicle": "car"},
        "free": ["mass"],
        "train": record_of_recordings([train]),
        "test": record_of_recordings([test.drop_attrs().assign_attrs(name="in memory")]),
    }
    (tmp_path / "next-drive").mkdir()
    (tmp_path / "trace.json").write_text(json.dumps({**EARLIER, "asked": asked}))
    (tmp_path / "next-drive" / "next_drive.json").write_text(json.dumps({"result": str(tmp_path), **PLAN}))
    return tmp_path


def test_the_recordings_of_an_earlier_trace_are_read_again(earlier):
    trace = EarlierTrace.read(earlier)
    assert EarlierTrace.read(earlier / "next-drive").folder == earlier
    assert (trace.model, trace.free) == ({"vehicle": "car"}, ("mass",))
    (again,) = trace.recordings("train", [])
    assert again.equals(load_recording(earlier / "train.csv"))
    assert trace.recordings("train", [load_recording(earlier / "train.csv")]) == []  # it is among those stated
    with pytest.raises(UserError, match="from memory"):
        trace.recordings("test", [])
    assert trace.recordings("test", [load_recording(earlier / "test.csv")]) == []
    recording(earlier / "train.csv", 3)
    with pytest.raises(UserError, match="something else than in that trace"):
        trace.recordings("train", [])
    (earlier / "train.csv").unlink()
    with pytest.raises(UserError, match=r"cannot be read again; state it as well, as train"):
        trace.recordings("train", [])


def test_only_what_the_earlier_trace_did_not_have_is_new(earlier):
    trace = EarlierTrace.read(earlier)
    train, test, new = (load_recording(earlier / f"{n}.csv") for n in ("train", "test", "train"))
    new = new.assign(yaw_rate=2.0 * new["yaw_rate"])
    with pytest.raises(UserError, match="has 'train', 'test' already; state what was driven"):
        trace.joined([train], [test])
    with pytest.raises(UserError, match=r"test: 'train' is in .* as train"):
        trace.joined([new], [train])
    fitted, held_out = trace.joined([new], [test])  # from memory there: stated again
    assert [r.attrs["name"] for r in (*fitted, *held_out)] == ["train", "train", "test"]
    assert trace.driven_since([*fitted, *held_out]) == [new]


def test_nothing_that_is_gone_on_from_is_overwritten(earlier, tmp_path):
    trace = EarlierTrace.read(earlier)
    for folder in (earlier, earlier / "next-drive", earlier / "next-drive" / ".."):
        with pytest.raises(UserError, match="name another folder"):
            trace.refuse_folder(folder)
    trace.refuse_folder(earlier / "after")
    line = ["trace", "--after", str(earlier), "--out", str(earlier), "--train", "a.csv", "--test", "b.csv"]
    done = CliRunner().invoke(app, line)
    assert (done.exit_code, "name another folder" in done.stderr) == (2, True)


def test_a_plan_in_a_folder_of_its_own_knows_its_result_from_any_directory(earlier, tmp_path, monkeypatch):
    plan = tmp_path / "plans" / "weave"
    plan.mkdir(parents=True)
    (tmp_path / "results").mkdir()
    (earlier / "trace.json").rename(tmp_path / "results" / "trace.json")
    (plan / "next_drive.json").write_text(json.dumps({"result": "results", **PLAN}))
    monkeypatch.chdir(plan)
    assert EarlierTrace.read(plan).folder.resolve() == tmp_path / "results"
    assert EarlierTrace.read(plan).place == plan


def test_the_confusable_set_is_handed_on_with_its_estimates(earlier):
    trace = EarlierTrace.read(earlier)
    for m in trace.content["confusable"]["models"]:
        m["estimates"] = [{"name": "mass", "value": 1500.0}, {"name": "lost", "value": None}]
    first, second, nothing = trace.models
    assert first.added == ((("effect", "steering_lag"),),)
    assert second.variants == [(("effect", "steering_delay"),), (("effect", "other"),)]
    assert (nothing.added, nothing.estimates) == ((), {"mass": 1500.0})


def test_what_is_no_plan_behind_a_trace_is_refused(earlier, tmp_path):
    plan = earlier / "next-drive" / "next_drive.json"
    plan.write_text(json.dumps({"result": str(earlier), "expected": {"parameters": {}}}))
    with pytest.raises(UserError, match="behind something else than a trace"):
        EarlierTrace.read(earlier)
    plan.write_text(json.dumps({"result": str(earlier), "expected": {"limits": {}}}))
    assert EarlierTrace.read(earlier).plan["expected"] == {"limits": {}}
    plan.write_text(json.dumps({"result": str(earlier), "expected": None}))
    with pytest.raises(UserError, match="planned behind no trace"):
        EarlierTrace.read(earlier)
    plan.write_text("{")
    with pytest.raises(UserError, match="no file of the harness"):
        EarlierTrace.read(earlier)
    plan.unlink()
    with pytest.raises(UserError, match="plan drives first: harness next-drive"):
        EarlierTrace.read(earlier)


def test_a_parameter_file_is_named_so_that_it_holds_elsewhere(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "mine.toml").write_text("")
    stated = with_absolute_paths({"vehicle": "car", "parameters": "mine.toml", "tyre": "linear"})
    assert stated == {"vehicle": "car", "parameters": str(tmp_path / "mine.toml"), "tyre": "linear"}


def test_estimators_and_judging_drives_are_those_of_the_earlier_trace(earlier, tmp_path, monkeypatch):
    content = json.loads((earlier / "trace.json").read_text())
    content["asked"]["test"] = record_of_recordings([load_recording(earlier / "test.csv")])
    content["asked"] |= {"estimators": [], "model": {"vehicle": "car", "parameters": "govindarajan_2018"}}
    (earlier / "trace.json").write_text(json.dumps(content))
    tasks = []
    monkeypatch.setattr("harness.diagnosis.run.run_trace", lambda task, *_: tasks.append(task))
    new = recording(tmp_path / "new.csv", 5)
    h.Diagnosis().fit(None, [new], [], tmp_path / "after", after=earlier)
    h.Diagnosis(estimators=["ekf"]).fit(None, [new], [], tmp_path / "after", after=earlier)
    assert [t.estimators for t in tasks] == [(), ("ekf",)]
    assert [r.attrs["name"] for r in (*tasks[0].train, *tasks[0].test)] == ["train", "new", "test"]
    assert "none of the drives since judges" in _driven_otherwise(tasks[0], tasks[0].after)
    assert tasks[0].asked["estimators"] == []
    with pytest.raises(UserError, match="name another folder"):
        h.Diagnosis().fit(None, [new], [], earlier, after=earlier)


MEASURED_FILE = """
title = "A trace that is gone on from"
recordings = "."
step = "10 ms"
rounds = 3
stated_noise = true
estimators = ["ukf"]
free = ["mass"]

[model]
vehicle = "car"
parameters = "govindarajan_2018"
tyre = "linear"
sensors = "car_series"
noise = { process_scale = 1e-4 }

[[train]]
file = "train.csv"
span = ["2 s", "25 s"]

[[test]]
file = "test.csv"
span = ["3 s", "26 s"]

[[exclude]]
effect = "payload_shift"
reason = "nobody moved in the car"
"""


def test_the_trace_of_a_measured_file_is_gone_on_from_as_it_was_asked(earlier, tmp_path, monkeypatch):
    (tmp_path / "measured.toml").write_text(MEASURED_FILE, encoding="utf-8")
    tasks = []
    monkeypatch.setattr("harness.diagnosis.measured_study.run_trace", lambda task, *_: tasks.append(task))
    monkeypatch.setattr("harness.diagnosis.measured_study._write", lambda *_: None)
    monkeypatch.setattr("harness.diagnosis.run.run_trace", lambda task, *_: tasks.append(task))
    study = MeasuredStudy.read(tmp_path / "measured.toml")
    with pytest.raises(AttributeError):  # there is no outcome
        trace_study(study, study.drives(), tmp_path / "trace", None, Console())
    asked = {"asked": json.loads(json.dumps(tasks[0].asked))}
    content = json.loads((earlier / "trace.json").read_text(encoding="utf-8"))
    (earlier / "trace.json").write_text(json.dumps(content | asked), encoding="utf-8")
    h.Diagnosis().fit(None, [recording(tmp_path / "new.csv", 5)], [], tmp_path / "after", after=earlier)
    first, again = tasks
    assert [r.attrs["name"] for r in (*again.train, *again.test)] == ["train", "new", "test"]
    assert again.train[0].equals(first.train[0])
    assert again.test[0].equals(first.test[0])
    for key in ("spec", "free", "estimators", "excluded", "rounds", "stated_noise"):
        assert getattr(again, key) == getattr(first, key), key
    assert (again.excluded, again.rounds) == ({"payload_shift"}, 3)


def test_what_is_alike_in_a_model_is_left_to_be_told_apart():
    assert models_left(EARLIER) == 3
    alike = {"added": [], "alike": [{"name": "steering_delay"}]}
    assert models_left({"confusable": {"models": [alike]}}) == 2
    assert models_left({"confusable": None}) == 0
