"""The posterior Cramer-Rao bound: the Kalman covariance on a linear model, and what studies show of it."""

import json

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.config import build_study
from harness.estimation.information import smallest_covariance
from harness.study import bound, bound_file
from harness.study.bound import KnownRuns
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.report import write_report
from harness.study.report.analysis import Analysis
from harness.study.results import read
from harness.study.run import run_study
from harness.study.run_noise import Case

LINEAR = {
    "name": "linear",
    "seed": 3,
    "targets": ["example_state"],
    "drive": [{"name": "straight", "kind": "sine", "amplitude": "0 deg", "duration": "5 s"}],
    "plant": {"vehicle": "scalar_example", "parameters": "kit_2015a", "sensors": "example"},
    "estimator": [{"name": "KF", "kind": "ekf"}],
    "design": [{"name": "one", "repeats": 8}],
    "report": {"bound": True},
}


@pytest.fixture(scope="module")
def study():
    return build_study(LINEAR, "linear")


def test_on_a_linear_model_it_is_the_kalman_covariance():
    rng = np.random.default_rng(1)
    f, h = np.array([[1.0, 0.1], [-0.2, 0.9]]), np.array([[1.0, 0.0]])
    q, r, p = np.diag([0.0, 0.04]), np.array([[0.3]]), np.diag([2.0, 1.0])
    steps = 40
    found = smallest_covariance(np.tile(f, (steps, 1, 1)), np.tile(h, (steps + 1, 1, 1)), q, r, p)
    for k in range(steps):
        prior = f @ p @ f.T + q
        p = prior - prior @ h.T @ np.linalg.inv(h @ prior @ h.T + r) @ h @ prior
        np.testing.assert_allclose(found[k + 1], p, rtol=1e-9, atol=1e-14)
    x, z, errors = np.zeros((2, 4000)), np.zeros((2, 4000)), []  # and it is what a filter with this gain reaches
    x = np.sqrt(np.diag([2.0, 1.0])) @ rng.standard_normal(x.shape)
    for k in range(steps):
        x = f @ x + np.sqrt(q) @ rng.standard_normal(x.shape)
        y = h @ x + np.sqrt(r) * rng.standard_normal((1, 4000))
        z = f @ z
        z = z + found[k + 1] @ h.T / r * (y - h @ z)
        errors.append(np.mean((x - z) ** 2, axis=1))
    np.testing.assert_allclose(errors[-1], np.diag(found[-1]), rtol=0.1)


def test_the_recursion_is_that_of_the_information_where_process_noise_has_an_inverse():
    rng = np.random.default_rng(2)
    f, h = np.eye(3) + 0.1 * rng.standard_normal((9, 3, 3)), rng.standard_normal((10, 2, 3))
    q, r = np.diag([0.1, 0.2, 0.3]), np.diag([0.5, 0.7])
    found = smallest_covariance(f, h, q, r, np.eye(3))
    inverse, information = np.linalg.inv(q), np.eye(3)
    for k in range(9):  # Tichavsky, Muravchik and Nehorai 1998, (21) with (34) to (36)
        d11, d12, d22 = f[k].T @ inverse @ f[k], -f[k].T @ inverse, inverse + h[k + 1].T @ np.linalg.inv(r) @ h[k + 1]
        information = d22 - d12.T @ np.linalg.inv(information + d11) @ d12
        np.testing.assert_allclose(found[k + 1], np.linalg.inv(information), rtol=1e-8)


def test_of_a_study_it_is_what_the_kalman_filter_states(study):
    evaluator, unit = StudyEvaluator(study), Unit(0, 0, 0, 0, 1)
    cases = [Case(0, r) for r in range(8)]
    batch, believed = evaluator.simulate(unit, cases), evaluator.held(unit, cases, "belief")
    stated = evaluator.estimate(0, unit, cases, batch, believed, keep=True).kept[1:, 1, 0, 0]
    (found,) = bound.smallest_rmse(evaluator, unit)
    assert found == pytest.approx(np.sqrt(np.mean(stated**2)), rel=1e-9)


def test_on_a_linear_model_the_smoother_is_that_of_rauch_tung_and_striebel(study):
    """x(n+1) = 0.5 x + u + v, y = x + w with unit variances (KIT 2015a); some measurements are missing."""
    evaluator = StudyEvaluator(study)
    known = KnownRuns.of_unit(evaluator, Unit(0, 0, 0, 0, 1))
    known.measurements[7:9] = np.nan
    found = bound.smoothed(evaluator, known)[:, 0]
    y, u = known.measurements[:, 0], known.inputs[:, 0]
    x, P = known.mean[0], known.first[:, 0]
    filtered, predicted = [(x, P)], [(x, P)]
    for k in range(1, len(y)):
        prior = 0.5 * x + u[k - 1], 0.25 * P + 1.0
        gain = np.where(np.isnan(y[k]), 0.0, prior[1] / (prior[1] + 1.0))
        x, P = prior[0] + gain * (np.nan_to_num(y[k]) - prior[0]), (1 - gain) * prior[1]
        filtered.append((x, P))
        predicted.append(prior)
    right = [filtered[-1][0]]
    for k in range(len(y) - 2, -1, -1):
        x, P = filtered[k]
        right.insert(0, x + 0.5 * P / predicted[k + 1][1] * (right[0] - predicted[k + 1][0]))
    np.testing.assert_allclose(found, right, atol=1e-9)


def test_what_the_smoother_reaches_is_below_the_bound_of_filters(study):
    evaluator, unit = StudyEvaluator(study), Unit(0, 0, 0, 0, 1)
    truth = KnownRuns.of_unit(evaluator, unit)
    states = bound.smoothed(evaluator, truth)[:, 0]
    row = evaluator.compiled.truth_names.index("example_state")
    (found,) = bound.smoothed_rmse(evaluator, unit)
    assert found == pytest.approx(np.sqrt(np.mean((states - truth.truth[:, row])[1:] ** 2)), rel=1e-12)
    assert 0.8 < found / bound.smallest_rmse(evaluator, unit)[0] < 1.0


def test_a_report_shows_it_and_a_run_keeps_it(study, tmp_path):
    run_study(study, tmp_path, jobs=1)
    kept = json.loads((tmp_path / bound_file.FILE).read_text())
    store = read(tmp_path)
    assert store.bounds["one"]["example_state"] == kept["rmse"]["one"]["example_state"]
    assert store.smoothed["one"]["example_state"] == kept["smoothed"]["one"]["example_state"]
    write_report(Analysis(store))
    assert "Dotted: a smoother" in (tmp_path / "report.html").read_text()
    assert "posterior Cramér" in (tmp_path / "report.html").read_text()
    (tmp_path / bound_file.FILE).write_text(json.dumps({**kept, "study_hash": "another"}))
    assert (read(tmp_path).bounds, read(tmp_path).smoothed) == ({}, {})
    (tmp_path / bound_file.FILE).write_text("{")
    with pytest.raises(UserError, match=r"bound\.json"):
        read(tmp_path)


def test_it_decides_no_score(study):
    assert build_study({k: v for k, v in LINEAR.items() if k != "report"}, "linear").hash == study.hash
