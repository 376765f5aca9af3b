"""A diagnosis as an object: what it hands to the search, and what it says of the outcome."""

import pickle
from types import SimpleNamespace

import numpy as np
import pandas as pd
import pytest

import harness as h
from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.result.answer import Value

TIME = np.round(np.arange(0, 25, 0.02), 9)
SIGNALS = ("steering_wheel_angle", "speed", "yaw_rate", "lateral_acceleration", "lateral_velocity")


def drive(phase):
    """Return a log of a car, in memory."""
    table = {n: 0.1 * np.sin(0.5 * TIME + phase + k) + 20 * (n == "speed") for k, n in enumerate(SIGNALS)}
    return pd.DataFrame({"time": TIME, **table})


@pytest.fixture
def searched(monkeypatch):
    """Stop where the search would begin, return an outcome, and keep what it was asked for."""
    asked = []

    def run_trace(task, folder, console):
        asked.append((task, folder))
        assert folder.parent.is_dir()
        lag = SimpleNamespace(name="steering_lag", kind="effect")
        values = {"steering_lag": (Value("steering_lag", "s", 0.08, 0.002),)}
        amended = h.model("car", "blanco_2021", tyre="linear", sensors="car_navigation", effects=["steering_lag"],
                          values={"steering_lag": 0.08}).spec  # fmt: skip
        return SimpleNamespace(
            verdict="amended",
            answer="The steering lags.",
            added=(lag,),
            values=values,
            amended=amended,
            nominal=task.spec,
        )

    monkeypatch.setattr("harness.diagnosis.run.run_trace", run_trace)
    return asked


@pytest.fixture
def car():
    return h.model("car", "blanco_2021", tyre="linear")


def test_a_diagnosis_hands_over_the_model_of_the_recordings(searched, car, tmp_path):
    found = h.Diagnosis(estimators="ekf", jobs=2).fit(car, [drive(0), drive(1)], drive(2), tmp_path)
    ((task, folder),) = searched
    assert (task.spec.step, task.spec.integrator, task.spec.substeps) == (0.02, "rk4", 2)
    assert task.spec.sensors == "car_navigation"
    assert task.free == ("stiffness_peak_front", "stiffness_peak_rear")
    assert (len(task.train), len(task.test), task.estimators, task.jobs) == (2, 1, ("ekf",), 2)
    assert folder == tmp_path
    assert found.verdict_ == "amended"


def test_the_outcome_is_in_attributes(searched, car):
    found = h.Diagnosis(estimators=()).fit(car, drive(0), drive(1))
    assert found.answer_ == "The steering lags."
    row = found.effects_.loc[("steering_lag", "steering_lag")]
    assert row.tolist() == ["effect", 0.08, 0.002, "s"]
    assert found.amended_.effects == ("steering_lag",)
    assert found.amended_.parameters.value["steering_lag"] == 0.08
    assert found.nominal_.spec == searched[0][0].spec
    assert "steering_lag" in found._repr_html_()


def test_before_the_fit_there_is_nothing(tmp_path):
    fresh = h.Diagnosis()
    assert not hasattr(fresh, "verdict_")
    with pytest.raises(h.UserError, match=r"call fit\(model, train, test\) first"):
        fresh.report(tmp_path)


def test_a_drive_that_is_fitted_is_not_held_out(searched, car):
    with pytest.raises(h.UserError, match="is fitted as well"):
        h.Diagnosis().fit(car, [drive(0), drive(1)], drive(1))
    assert searched == []


@pytest.mark.parametrize(
    ("train", "baseline", "said"),
    [
        (0, (2, 2), "^baseline: .* is in the baseline as well"),  # its drives would seem not to differ at all
        (0, (2, 0), "^train: .* is in the baseline as well"),
        (0, (1, 2), "^test: .* is fitted as well"),
    ],
)
def test_a_drive_of_the_baseline_is_stated_once(searched, car, train, baseline, said):
    with pytest.raises(h.UserError, match=said):
        h.Diagnosis().fit(car, drive(train), drive(1), baseline=[drive(i) for i in baseline])
    assert searched == []


def test_an_unknown_estimator_is_refused_at_once():
    with pytest.raises(h.ModelError, match="closest: ekf"):
        h.Diagnosis(estimators=["ekff"])


def test_a_fitted_diagnosis_is_pickled_with_its_numbers_and_without_figures(searched, car, tmp_path, monkeypatch):
    monkeypatch.setattr("harness.diagnosis.result.record.record", lambda outcome: {"verdict": outcome.verdict})
    fitted = h.Diagnosis(estimators="ekf").fit(car, drive(0), drive(2), tmp_path)
    fitted._outcome.added = (Hypothesis("steering_lag", "effect", ("steering_lag",)),)
    again = pickle.loads(pickle.dumps(fitted))
    assert again == fitted
    assert (again.verdict_, again.answer_, again.record_) == ("amended", "The steering lags.", {"verdict": "amended"})
    assert again.effects_.equals(fitted.effects_)
    assert again.amended_ == fitted.amended_
    assert again != h.Diagnosis(estimators="ekf")
    with pytest.raises(h.UserError, match="report before it is pickled"):
        again.report(tmp_path)
