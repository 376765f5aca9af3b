"""What was expected of planned drives against what came, and an earlier trace that is gone on from."""

import json
import math

import numpy as np
import pandas as pd
import pytest

from harness.common.errors import UserError
from harness.common.statistics import Interval
from harness.diagnosis.criteria import HORIZONS
from harness.diagnosis.earlier_trace import EarlierTrace
from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.result.expectation import expectation_met, record_of_expectation
from harness.diagnosis.selection.posterior import Alike, ComparedModel, Posterior
from harness.identification.earlier_result import record_of_recordings, with_absolute_paths
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
    assert math.isinf(nothing.realised)  # it was given up
    assert found.verdict == "as expected"
    assert found.stands
    record = json.loads(json.dumps(record_of_expectation(found), default=str))
    assert record["probability"] == {"before": 0.6, "expected": 0.97, "realised": 0.98}
    assert record["stands"] == {"expected": 0.9, "realised": True}


def test_drives_that_told_less_or_something_else_are_said_to():
    less = met(compared(["steering_delay"], 0.6, 0.0), compared(["steering_lag"], 0.4, -0.4))
    assert less.leading == "steering delay"
    assert less.ratios[0].realised == pytest.approx(1.4)  # it has made good the 1 that it was behind
    assert less.verdict == "as expected"  # 4.5 with a deviation of 3
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


def recording(path, seed):
    time = np.arange(0.0, 30.0, 0.01)
    noise = np.random.default_rng(seed).normal(size=len(time))
    pd.DataFrame({"time": time, "yaw_rate": 0.01 * noise, "speed": 15.0 + 0 * time}).to_csv(path, index=False)
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


def test_what_is_no_plan_behind_a_trace_is_refused(earlier, tmp_path):
    plan = earlier / "next-drive" / "next_drive.json"
    plan.write_text(json.dumps({"result": str(earlier), "expected": {"parameters": {}}}))
    with pytest.raises(UserError, match="--for"):
        EarlierTrace.read(earlier)
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
