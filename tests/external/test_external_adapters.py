"""Filters of filterpy, Stone Soup and CasADi beside ours: the same algorithm gives the same scores."""

from pathlib import Path

import numpy as np
import pytest

import harness as h
from harness.config import build_study
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator
from harness.study.score_names import OK, STATUS
from support import car_model
from support.observers import CONTENT

MINE = """
import numpy as np
from car_model import Car, slopes


def unscented(values, step, alpha):
    from filterpy.kalman import MerweScaledSigmaPoints, UnscentedKalmanFilter

    class Redrawn(UnscentedKalmanFilter):
        def predict(self, **arguments):
            super().predict(**arguments)
            self.sigmas_f = self.points_fn.sigma_points(self.x, self.P)

    car = Car(values, step)
    points = MerweScaledSigmaPoints(2, alpha, 2.0, 1.0)
    made = Redrawn(2, 2, step, car.output, lambda x, dt, u: car.ahead(x, u), points)
    made.x, made.P, made.Q, made.R = car.first, car.first_P, car.Q, car.R
    return made


def extended(values, step):
    from stonesoup.models.measurement.nonlinear import MeasurementModel
    from stonesoup.models.base import GaussianModel
    from stonesoup.models.transition.base import TransitionModel
    from stonesoup.predictor.kalman import ExtendedKalmanPredictor
    from stonesoup.types.state import GaussianState
    from stonesoup.updater.kalman import ExtendedKalmanUpdater

    car = Car(values, step)

    class Ahead(TransitionModel, GaussianModel):
        ndim_state = 2
        inputs = None
        def function(self, state, noise=False, **_):
            return car.ahead(np.ravel(state.state_vector).astype(float), self.inputs)[:, None]
        def jacobian(self, state, **_):
            return slopes(car.ahead, np.ravel(state.state_vector).astype(float), self.inputs)
        def covar(self, **_):
            return car.Q
        def rvs(self, **_): ...
        def pdf(self, *_, **__): ...

    class Output(MeasurementModel, GaussianModel):
        ndim_meas = 2
        inputs = None
        def function(self, state, noise=False, **_):
            return car.output(np.ravel(state.state_vector).astype(float), self.inputs)[:, None]
        def jacobian(self, state, **_):
            return slopes(car.output, np.ravel(state.state_vector).astype(float), self.inputs)
        def covar(self, **_):
            return car.R
        def rvs(self, **_): ...
        def pdf(self, *_, **__): ...

    first = GaussianState(car.first[:, None], car.first_P)
    return ExtendedKalmanPredictor(Ahead()), ExtendedKalmanUpdater(Output(2, (0, 1))), first


def by_casadi(values, step):
    import casadi as ca

    car = Car(values, step)
    x, P, u_before = ca.MX.sym("x", 2), ca.MX.sym("P", 2, 2), ca.MX.sym("b", 2)
    u, y, dt = ca.MX.sym("u", 2), ca.MX.sym("y", 2), ca.MX.sym("dt")
    def forces(x, u):
        delta, speed = u[0] / car.ratio, ca.fmax(u[1], car.slowest)
        front = -car.cf * ca.cos(delta) * ca.tan(ca.atan((car.lf * x[1] + x[0]) / speed) - delta)
        return front, -car.cr * (x[0] - car.lr * x[1]) / speed
    def ahead(x, u):
        front, rear = forces(x, u)
        return x + dt * ca.vertcat((front + rear) / car.m - u[1] * x[1], (car.lf * front - car.lr * rear) / car.J)
    def output(x, u):
        front, rear = forces(x, u)
        return ca.vertcat(x[1], (front + rear) / car.m)
    predicted = ahead(x, u_before)
    A = ca.jacobian(predicted, x)
    M = ca.MX.sym("M", 2)
    H = ca.substitute(ca.jacobian(output(M, u), M), M, predicted)
    prior = A @ P @ A.T + car.Q
    S = H @ prior @ H.T + car.R
    off = y - output(predicted, u)
    gain = ca.solve(S, H @ prior).T
    begun = dt > 0
    x_next = ca.if_else(begun, predicted + gain @ off, x)
    P_next = ca.if_else(begun, prior - gain @ S @ gain.T, P)
    nis = ca.if_else(begun, off.T @ ca.solve(S, off), 0)
    held = ca.vertcat(x, ca.vec(P), u_before)
    function = ca.Function("filter", [held, u, y, dt], [
        ca.vertcat(x_next, ca.vec(P_next), u), x_next, ca.diag(P_next), nis,
    ])
    return function, np.concatenate([car.first, car.first_P.ravel(), [0.0, 0.0]])
"""

GETS = {
    "kind": "external",
    "inputs": ["steering_wheel_angle", "speed"],
    "measurements": ["yaw_rate", "lateral_acceleration"],
    "estimates": ["lateral_velocity", "yaw_rate"],
}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    folder = tmp_path_factory.mktemp("foreign")
    (folder / "car_model.py").write_text(Path(car_model.__file__).read_text(encoding="utf-8"))
    (folder / "mine.py").write_text(MINE)
    return folder


@pytest.mark.parametrize(
    ("adapter", "settings", "ours", "library"),
    [
        ("FilterPy", {"make": "mine:unscented", "alpha": 0.5}, {"kind": "ukf", "alpha": 0.5, "kappa": 1.0}, "filterpy"),
        ("StoneSoup", {"make": "mine:extended"}, {"kind": "ekf"}, "stonesoup"),
        ("CasADi", {"make": "mine:by_casadi", "gives": 2}, {"kind": "ekf"}, "casadi"),
    ],
)
def test_a_filter_of_another_library_has_the_scores_of_ours(folder, adapter, settings, ours, library):
    pytest.importorskip(library)
    theirs = {
        "name": adapter,
        "python": f"harness.external.estimators.adapters:{adapter}",
        "settings": settings,
        **GETS,
    }
    design = {**CONTENT["design"][0], "repeats": 3}
    study = build_study(
        {**CONTENT, "estimator": [{"name": "ours", **ours}, theirs], "design": [design]}, folder / "s.toml"
    )
    evaluator = StudyEvaluator(study)
    for unit in units(study, study.designs[0]):
        result = evaluator.evaluate(unit)
        assert evaluator.lost() == []
        assert (result[STATUS] == OK).all()
        for name in ("rmse", "bias", "max_error", "nis", "nis_inside"):
            own, other = np.moveaxis(result[name], 2, 0)
            np.testing.assert_allclose(other, own, rtol=1e-12, atol=1e-15, err_msg=name)


def test_single_missing_measurements_are_left_out_as_ours_does(folder, monkeypatch):
    """On a recording with gaps; others of filterpy than unscented ones say that they cannot."""
    pytest.importorskip("filterpy")
    monkeypatch.chdir(folder)
    car = h.model("car", "govindarajan_2018", tyre="linear", sensors="car_series")
    recording = h.simulate(car, h.drive("sine", duration="5 s", amplitude="20 deg"), seed=1)
    recording["lateral_acceleration"][::3] = np.nan
    recording["yaw_rate"][::5] = np.nan
    names = {name: GETS[name] for name in ("inputs", "measurements", "estimates")}
    adapter, settings = "harness.external.estimators.adapters:FilterPy", {"make": "mine:unscented", "alpha": 0.5}
    theirs = h.Estimator("external", python=adapter, settings=settings, **names)
    runs = h.estimate(
        car, recording, {"ours": h.Estimator("ukf", alpha=0.5, kappa=1.0), "theirs": theirs}, inputs="held"
    ).runs
    ours, other = runs[("sine", "ours")], runs[("sine", "theirs")]
    for name in ("lateral_velocity", "lateral_velocity_std", "nis", "nis_degrees"):
        np.testing.assert_allclose(other[name][1:], ours[name][1:], rtol=1e-9, atol=1e-12, err_msg=name)
