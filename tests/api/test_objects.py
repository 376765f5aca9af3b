"""The public objects: compared, pickled, completed; what is raised is what Python calls it."""

import html
import inspect
import pickle
from importlib.metadata import version

import numpy as np
import pandas as pd
import pytest

import harness as h
from harness.api._show import same

TIME = np.arange(0, 60, 0.01)
HEADING = 0.6 * np.sin(0.5 * TIME) + 0.2 * np.sin(2 * TIME)


def again(thing):
    return pickle.loads(pickle.dumps(thing))


def car(**keys):
    return h.model("car", "govindarajan_2018", sensors="car_series", **keys)


def study(levels=("1.5 t", "1.8 t")):
    return h.Study(
        car(),
        targets=["lateral_velocity"],
        drives=[h.drive("sine", duration="5 s", amplitude="20 deg")],
        estimators={"EKF": "ekf"},
        designs=[h.levels("mass", levels, repeats=2)],
    )


def checked(gain=1.0):
    log = pd.DataFrame({"time": TIME, "heading": HEADING, "yaw_rate": gain * np.gradient(HEADING, 0.01)})
    return h.check(log)


@pytest.mark.parametrize(
    ("made", "other"),
    [
        (car, lambda: car(values={"mass": "1.6 t"})),
        (lambda: h.drive("sine", speed="20 m/s"), lambda: h.drive("sine", speed="21 m/s")),
        (lambda: h.Estimator("ukf", alpha=0.5), lambda: h.Estimator("ukf")),
        (study, lambda: study(("1.5 t", "1.9 t"))),
        (checked, lambda: checked(1.3)),
        (h.Diagnosis, lambda: h.Diagnosis(repeats=9)),
    ],
    ids=["model", "drive", "estimator", "study", "check", "diagnosis"],
)
def test_an_object_is_pickled_and_equal_to_what_states_the_same(made, other):
    thing = made()
    assert again(thing) == thing == made()
    assert thing != other()
    assert repr(again(thing)) == repr(thing)
    assert html.escape(repr(thing).splitlines()[0]) in thing._repr_html_()


def test_what_was_looked_up_meanwhile_makes_no_model_another_one():
    one = h.model("car", "govindarajan_2018", sensors="car_series")
    assert one.outputs
    assert one == h.model("car", "govindarajan_2018", sensors="car_series")


@pytest.mark.parametrize(
    ("one", "other", "alike"),
    [
        (np.array([1.0, np.nan]), np.array([1.0, np.nan]), True),
        (np.array([1.0]), np.array([1.0], np.float32), False),
        ({"a": [1, (2.0, np.nan)]}, {"a": [1, (2.0, np.nan)]}, True),
        ({"a": 1, "b": 2}, {"b": 2, "a": 1}, False),
        (pd.DataFrame({"a": [1]}), pd.DataFrame({"a": [2]}), False),
    ],
)
def test_what_is_the_same(one, other, alike):
    assert same(one, other) is alike


def test_the_package_says_its_version_and_its_names_and_no_more():
    assert h.__version__ == version("robustness-harness")
    assert dir(h) == sorted(["__version__", *h.__all__])


def test_errors_are_those_of_python(tmp_path):
    with pytest.raises(ValueError, match="no parameter 'mas'") as wrong:
        car(values={"mas": 1.0})
    assert not isinstance(wrong.value, FileNotFoundError)
    for absent in (
        lambda: h.read_recording(tmp_path / "lap.csv"),
        lambda: h.read_study(tmp_path / "a.toml"),
        lambda: h.open_results(tmp_path),
        lambda: h.model("car", "lost.toml"),
    ):
        with pytest.raises(FileNotFoundError) as missing:
            absent()
        assert isinstance(missing.value, h.UserError)
        assert len(str(missing.value).splitlines()) == 1


@pytest.mark.parametrize(
    ("call", "keywords"),
    [
        (h.factor, {"of", "unit", "levels", "shift", "bands", "range", "distribution", "scale", "band", "labels"}),
        (h.levels, {"of", "unit", "band", "labels", "repeats"}),
        (h.design, {"sampling", "samples", "boxes", "repeats", "sobol_any_n", "scramblings", "correlation", "groups"}),
        (h.model, {"tyre", "unknown_parameters", "considered_parameters", "step", "integrator", "substeps"}),
        (h.Study, {"title", "seed", "tuning", "history", "limits", "report"}),
    ],
)
def test_keywords_complete(call, keywords):
    parameters = inspect.signature(call).parameters
    assert keywords <= set(parameters)
    assert all(parameters[k].annotation is not inspect.Parameter.empty for k in keywords)
    assert not [p for p in parameters.values() if p.kind is p.VAR_KEYWORD]
