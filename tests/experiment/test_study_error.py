"""Drives for the errors of a study's estimators: the regression, its criterion, and a study of what is then left."""

import json
import math

import numpy as np
import pytest

import harness as h
from harness.common.errors import UserError
from harness.config import build_study, single_drive
from harness.experiment.error_model import squared_error_model
from harness.experiment.limits import Limits
from harness.experiment.rehearsal import Rehearsal
from harness.experiment.run import DesignTask, design_drives
from harness.experiment.study_error import StudyGoal, read_study
from harness.study.run import run_study
from support.identification import CAR

SPREADS = {"stiffness_over_load_front": 0.1, "stiffness_over_load_rear": 0.1, "mass_over_inertia": 0.15}
WEAVE = {"kind": "sine", "speed": 15.0, "amplitude": 0.4, "frequency": 0.5, "duration": 8.0}


def study_of(folder, factors, correlation=None, **keys):
    """Run a study of a car whose parameters are open, and return its folder."""
    design = {"name": "open", "sampling": "population", "samples": 16, "factor": factors}
    content = {
        "name": "open",
        "seed": 3,
        "targets": ["lateral_velocity_rear", "yaw_rate"],
        "plant": {**CAR, "integrator": "rk4"},
        "drive": [{"name": "weave", **WEAVE}],
        "estimator": [{"name": "EKF", "kind": "ekf"}],
        "design": [design if correlation is None else {**design, "correlation": correlation}],
        **keys,
    }
    return run_study(build_study(content, folder.with_suffix(".toml")), folder, jobs=1)


def normal(name, mean, std):
    return {"parameter": name, "distribution": {"kind": "normal", "mean": mean, "std": std}}


def tolerances():
    values = h.model(**CAR).parameters["value"]
    return [normal(n, float(values[n]), share * float(values[n])) for n, share in SPREADS.items()]


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    return study_of(tmp_path_factory.mktemp("study") / "open", tolerances())


@pytest.fixture(scope="module")
def goal(folder):
    return StudyGoal(read_study(folder, {}))


def test_the_regression_finds_floor_and_curvature_of_scattered_squares():
    random = np.random.default_rng(1)
    matrix = np.array([[4.0, 1.0, 0.0], [1.0, 1.0, 0.0], [0.0, 0.0, 0.0]])
    away = random.standard_normal((4096, 3))
    mean = 0.5 + 0.2 * away[:, 0] + np.sum((away @ matrix) * away, axis=1)
    model = squared_error_model(away, mean * random.gamma(10.0, 0.1, len(away)), "test")
    assert model.floor == pytest.approx(0.5, rel=0.05)
    np.testing.assert_allclose(model.curvature, matrix, atol=0.15)
    assert np.linalg.eigvalsh(model.curvature).min() >= -1e-12
    covariance = np.diag([0.01, 0.04, 1.0])
    assert model.expected(covariance) == pytest.approx(0.5 + 4 * 0.01 + 1 * 0.04, rel=0.05)
    with pytest.raises(UserError, match="for 3 parameters 20 are needed"):
        squared_error_model(away[:19], mean[:19], "test")


def test_what_no_error_hangs_on_is_not_worth_a_drive(goal):
    """Information on one parameter alone lowers the expected error by what hangs on that one."""

    def behind(name):
        information = np.zeros_like(goal.before)
        i = goal.names.index(name)
        information[i, i] = 1e6
        return goal.value((information,))

    by_name = {name: behind(name) for name in goal.names}
    assert all(goal.value(None) >= value for value in by_name.values())
    assert by_name["stiffness_over_load_rear"] < by_name["mass_over_inertia"]
    (lateral, yaw) = goal.studied.errors
    i = goal.names.index("stiffness_over_load_rear")
    covariance = np.eye(3)
    covariance[i, i] = 1.0 / (1.0 + 1e6)
    ratios = [min(e.model.expected(covariance) / e.now**2, 1.0) for e in (lateral, yaw)]
    assert by_name["stiffness_over_load_rear"] == pytest.approx(0.5 * math.log(np.mean(ratios)), abs=0.01)


def test_a_study_of_what_a_drive_leaves_has_the_expected_errors(goal, tmp_path):
    rehearsal = Rehearsal(goal.model, goal.model.spec, goal.versions[:1], 1, Limits(lateral_acceleration=9.0))
    drive = {"name": "short", "kind": "step", "speed": 15.0, "amplitude": 0.1, "duration": 5.0}
    (information,) = goal.evidence(rehearsal.of(single_drive(drive, "test")))
    evidence = (0.02 * information,)  # so little that much of the error is left
    covariance, names = goal.covariance(evidence), goal.names
    errors = np.sqrt(np.diagonal(covariance))
    factors = [
        normal(name, f.nominal, float(e * s))
        for name, f, e, s in zip(names, goal.studied.design.factors, errors, goal.studied.spread, strict=True)
    ]
    correlation = covariance / np.outer(errors, errors)
    pairs = [(names[i], names[j], float(correlation[i, j])) for i in range(len(names)) for j in range(i)]
    reached = read_study(study_of(tmp_path / "left", factors, pairs), {})
    for expected, e in zip(goal.expectation(evidence).record["errors"], reached.errors, strict=True):
        rmse = expected["rmse"]
        assert rmse["known"] < 0.9 * rmse["after"]
        assert rmse["after"] < 0.9 * rmse["before"]
        assert e.now == pytest.approx(rmse["after"], rel=0.1)


def test_what_counts_of_the_reached_covariance_is_kept_with_the_expectation(goal):
    """An identification has the same errors from the numbers of a plan as the goal has from its own."""
    information = np.diag([3.0, 1.0, 0.0, *np.zeros(len(goal.before) - 3)])
    covariance = goal.covariance((information,))
    for e in goal.expectation((information,)).record["errors"]:
        square = e["square"]["floor"] + np.sum(np.array(e["square"]["curvature"]) * covariance)
        assert math.sqrt(square) == pytest.approx(e["rmse"]["after"])


def test_the_fit_is_found_whose_posterior_a_design_is_as_long_as_it_says_the_same(goal, tmp_path):
    factors = [f["distribution"] | {"name": f["parameter"]} for f in tolerances()]
    content = {
        "estimates": [{"name": f["name"], "value": f["mean"], "standard_error": f["std"]} for f in factors],
        "correlation": np.eye(len(factors)).tolist(),
    }
    (tmp_path / "fit").mkdir()
    file = tmp_path / "fit" / "identify.json"
    file.write_text(json.dumps(content), encoding="utf-8")
    design = {"name": "open", "sampling": "population", "samples": 16, "posterior": "fit"}
    folder = study_of(tmp_path / "open", [], design=[design])
    studied = read_study(folder, {})
    assert studied.fit == tmp_path / "fit"
    assert StudyGoal(studied).expectation(None).record["fit"] == str(tmp_path / "fit")
    assert goal.expectation(None).record["fit"] is None  # of tolerances
    content["estimates"][0]["value"] *= 1.001
    file.write_text(json.dumps(content), encoding="utf-8")
    assert read_study(folder, {}).fit is None


def test_drives_are_planned_for_one_target_of_a_study(folder):
    limits = Limits(lateral_acceleration=4.0, duration=15.0)
    weights, names = {"lateral_velocity_rear": 1.0}, ("sweep", "circle")
    task = DesignTask(folder, weights, limits=limits, budget=15.0, manoeuvres=names, effort=4, sensors=True, jobs=1)
    designed = design_drives(task)
    (error,) = designed.goal.expectation(designed.plan.evidence).record["errors"]
    assert (error["estimator"], error["target"]) == ("EKF", "lateral_velocity_rear")
    assert error["rmse"]["known"] <= error["rmse"]["after"] < error["rmse"]["before"]
    assert designed.plan.value < 0.0
    assert {e.name for e in designed.equipped} >= {"car_reference"}


@pytest.mark.parametrize(
    ("keys", "said"),
    [
        ({"wanted": {"lateral_velocity_raer": 1.0}}, "closest: lateral_velocity_rear"),
        ({"wanted": {"EKF": 0.0}}, "weight is above zero"),
        ({"criterion": "A"}, "asked of an identification"),
    ],
)
def test_a_bad_request_of_a_study_is_refused(folder, keys, said):
    with pytest.raises(UserError, match=said):
        design_drives(DesignTask(folder, **keys))


def test_a_study_that_does_not_say_what_is_open_is_refused(tmp_path):
    levels = [{"name": "open", "factor": [{"parameter": "mass_over_inertia", "shift": ["-10 %", "10 %"]}]}]
    folder = study_of(tmp_path / "levels", [], design=levels)
    with pytest.raises(UserError, match="sampling = 'population'"):
        design_drives(DesignTask(folder))
    both = [{**tolerances()[0], "of": "both"}]
    tight = {"name": "tight", "sampling": "population", "samples": 16, "factor": [tolerances()[1]]}
    open_ = {"name": "open", "sampling": "population", "samples": 16, "factor": both}
    folder = study_of(tmp_path / "both", [], design=[open_, tight])
    assert read_study(folder, {"tight": 1.0, "EKF": 1.0}).names == ["stiffness_over_load_rear"]
    expectation = StudyGoal(read_study(folder, {"tight": 1.0})).expectation(None)
    assert expectation.record["design"] == "tight"
    assert "'tight'" in expectation.words
    assert any("'open'" in text for text in expectation.open)
    with pytest.raises(UserError, match="believe nothing of what design 'open' varies"):
        design_drives(DesignTask(folder))
