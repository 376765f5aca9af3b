"""Criteria of optimal design against closed forms, and what manoeuvres tell of a car against textbooks."""

import math
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.experiment.contract import total
from harness.experiment.design import TriedDrive, design, greedy
from harness.experiment.information import EstimationGoal, KeptFit, log_error, open_covariance
from harness.experiment.limits import Limits
from harness.experiment.manoeuvres import SearchRange, chosen
from harness.experiment.rehearsal import Rehearsal
from harness.experiment.rival_filter import Parabolas
from harness.simulation.drives import profile_of
from support.identification import CAR, model_of

FREE = ("stiffness_over_load_front", "stiffness_over_load_rear", "mass_over_inertia")
PLACES = np.linspace(-1.0, 1.0, 21)


def measured_at(degree):
    """Return measurements of a polynomial with unit noise, one at each place, each of one second."""
    rows = np.vander(PLACES, degree + 1, increasing=True)
    return [
        TriedDrive(None, 1.0, (np.outer(r, r),), 1, 0.0, 0.0, False, partial(SimpleNamespace, place=x))
        for x, r in zip(PLACES, rows, strict=True)
    ]


class Polynomial:
    """The coefficients of a polynomial, of which next to nothing is known."""

    enough, turns = -math.inf, 1

    def __init__(self, degree, criterion="D", rows=None):
        self.degree, self.criterion = degree, criterion
        self.rows = list(range(degree + 1)) if rows is None else rows

    def value(self, evidence):
        information = 1e-6 * np.eye(self.degree + 1) + (0.0 if evidence is None else evidence[0])
        return log_error(open_covariance(information, self.rows), self.criterion, np.ones(len(self.rows)))

    preference = value


def chosen_places(goal, seconds):
    sequence = greedy(goal, measured_at(goal.degree), seconds)
    return {round(t.rehearsed.place, 6): times for t, times in sequence}, total([(t.evidence, n) for t, n in sequence])


def test_a_line_is_best_measured_at_its_ends():
    places, evidence = chosen_places(Polynomial(1), 20.0)
    assert places == {-1.0: 10, 1.0: 10}
    np.testing.assert_allclose(np.linalg.det(evidence[0]), 20.0**2, rtol=1e-9)  # the most there is


def test_a_parabola_is_best_measured_at_its_ends_and_in_the_middle():
    places, evidence = chosen_places(Polynomial(2), 30.0)
    assert places == {-1.0: 10, 0.0: 10, 1.0: 10}
    np.testing.assert_allclose(np.linalg.det(evidence[0]), 4.0 * 10.0**3, rtol=1e-9)


def test_the_slope_of_a_line_whose_level_is_open_has_the_error_of_both_ends():
    _, evidence = chosen_places(Polynomial(1, "c", [1]), 20.0)
    np.testing.assert_allclose(open_covariance(evidence[0], [1]), [[1.0 / 20.0]], rtol=1e-9)


def test_of_what_is_not_known_the_error_is_infinite():
    information = np.diag([4.0, 0.0])
    assert math.isinf(log_error(open_covariance(information, [0, 1]), "D", np.ones(2)))
    assert log_error(open_covariance(information, [0]), "A", np.ones(1)) == pytest.approx(math.log(0.5))


def test_the_discrimination_of_box_and_hill_goes_to_that_of_hunter_and_reiner():
    """Of models whose predictions are certain the largest difference discriminates best, whatever the noise.

    With uncertain ones it is the difference over its own standard deviation (Box and Hill 1967, (3.10); Hunter and
    Reiner 1965); what the rival takes up by its parameter is that uncertainty.
    """
    x = np.linspace(0.05, 3.0, 60)
    difference, slope, noise = np.exp(-x) - 1.0 + 0.5 * x, x, 0.1

    def left(std):
        parts = [(d / noise, s / noise) for d, s in zip(difference, slope, strict=True)]
        return np.array([
            (p := Parabolas(np.array([w**2]), np.array([[w * j]]), np.array([[[j**2 + std**-2.0]]]))).at(*p.best())
            for w, j in parts
        ]).ravel()  # fmt: skip

    def box_hill(std):
        certain, rival = noise**2, noise**2 + (slope * std) ** 2
        apart = (rival - certain) ** 2 / (certain * rival) + difference**2 * (1 / certain + 1 / rival)
        return apart, difference**2 / rival

    hunter_reiner = int(np.argmax(np.abs(difference)))
    for std in (1e-4, 0.02, 0.3):
        np.testing.assert_allclose(left(std), box_hill(std)[1], rtol=1e-6)
    assert np.argmax(left(1e-4)) == np.argmax(box_hill(1e-4)[0]) == hunter_reiner


def fitted(**keys):
    spec = model_of({**CAR, "integrator": "rk4"})
    estimates = {n: (spec.values[n], 0.3 * spec.values[n], "weakly determined") for n in FREE}
    return KeptFit(spec, {**estimates, **keys}, np.eye(len(estimates) + len(keys)))


def best_errors(goal, manoeuvres):
    limits = Limits(lateral_acceleration=4.0, duration=15.0)
    rehearsal = Rehearsal(goal.model, goal.fit.spec, goal.versions[:2], 1, limits)
    plan = design(goal, rehearsal, SearchRange.of(goal.fit.spec, limits), chosen(manoeuvres), 15.0, effort=10, jobs=1)
    return {t.manoeuvre.name: math.exp(t.value) for t in plan.ranked}


def test_the_circle_tells_the_steady_state_and_quick_steering_the_yaw_inertia():
    steady = {"stiffness_over_load_front": 1.0, "stiffness_over_load_rear": -1.0}  # the understeer gradient to both
    gradient = best_errors(EstimationGoal(fitted(), steady, "c"), ["circle", "sweep", "ramp"])
    inertia = best_errors(EstimationGoal(fitted(), {"mass_over_inertia": 1.0}), ["circle", "sweep", "ramp"])
    assert min(gradient, key=gradient.get) == "circle"
    assert min(inertia, key=inertia.get) == "sweep"
    assert inertia["ramp"] > 3.0 * inertia["sweep"]


def test_braking_in_a_turn_tells_what_braking_takes_from_the_lateral_force():
    table = {"vehicle": "car", "parameters": "blanco_2021", "tyre": "linear", "sensors": "car_series"}
    name = "combined_slip_braking_front"
    spec = model_of({**table, "integrator": "rk4", "effects": ["combined_slip"]}, **{name: 1.0})
    goal = EstimationGoal(KeptFit(spec, {name: (1.0, 1.0, "weakly determined")}, np.eye(1)))
    errors = best_errors(goal, ["circle", "brake"])
    assert min(errors, key=errors.get) == "brake"
    assert errors["circle"] > 10.0 * errors["brake"]


def test_a_spline_is_no_worse_than_the_drives_it_begins_with():
    goal = EstimationGoal(fitted())
    errors = best_errors(goal, ["spline", "circle", "weave"])
    assert errors["spline"] < 1.05 * min(errors["circle"], errors["weave"])


def test_another_seed_steers_otherwise_at_random():
    spec = model_of({**CAR, "integrator": "rk4"})
    (manoeuvre,) = chosen(["random"])
    drives = [manoeuvre.drive(np.full(4, 0.5), SearchRange.of(spec, Limits(), seed=seed), "random") for seed in (0, 1)]
    wheels = [profile_of(spec, drive).steering_wheel_angle for drive in drives]
    assert np.abs(wheels[0] - wheels[1]).max() > 0.1 * np.abs(wheels[0]).max()


def test_the_fit_is_the_prior_and_a_parameter_at_its_bound_stays():
    noise = {"measurement_noise yaw_rate": (1e-6, math.inf, "at its bound"), "process_noise m/s": (1.0, 0.5, None)}
    goal = EstimationGoal(fitted(**noise))
    assert goal.names == [*FREE, "process_noise m/s"]
    np.testing.assert_allclose(goal.before, np.diag([0.3**-2] * 3 + [0.5**-2]), rtol=1e-9)
    assert goal.value(None) == pytest.approx(math.log(0.3))
    bound = KeptFit(
        goal.fit.spec, {**goal.fit.estimates, FREE[0]: (8.0, math.inf, "at its bound")}, goal.fit.correlation
    )
    held = EstimationGoal(bound)
    assert list(held.wanted) == list(FREE[1:])
    assert any("at its bound" in text for text in held.expectation(None).open)
    with pytest.raises(UserError, match="ended at its bound"):
        EstimationGoal(bound, {FREE[0]: 1.0})
    with pytest.raises(UserError, match="closest: mass_over_inertia"):
        EstimationGoal(fitted(), {"mass_over_inertja": 1.0})
