"""What coloured innovations do to a fit: nothing if they are white, wider intervals and a weaker verdict if not."""

import numpy as np
import pytest
from scipy.signal import lfilter

from harness.identification.contract import Problem
from harness.identification.innovations import Innovations
from harness.identification.methods.likelihood import Search, Settings, identify
from harness.identification.result import answer, record
from harness.identification.whiteness import robust_errors
from support.identification import CAR, model_of, recorded

FREE = ("stiffness_over_load_front", "stiffness_over_load_rear", "mass_over_inertia")
QUICK = Settings(profiles=False, annealings=0)


@pytest.fixture(scope="module")
def drive():
    return recorded(model_of(CAR), 7, duration=60.0, speed=15.0, amplitude=0.5)


def problem_of(recording):
    innovations = Innovations(model_of(CAR, stiffness_over_load_front=7.942, stiffness_over_load_rear=7.386), jobs=1)
    return Problem(innovations, (innovations.drive(recording, "drive"),), FREE)


@pytest.fixture(scope="module")
def searched(drive):
    """Return a search over a drive of the right model, and what is known where it ended."""
    search = Search(problem_of(drive), QUICK)
    return search, search.summit(search.climb(search.coordinates.centre).z)


def test_scores_add_up_to_the_gradient(searched):
    search, summit = searched
    z = summit.z + 0.01
    space, drives = search.coordinates, search.problem.drives
    (scores,) = search.problem.innovations.scores(drives, space.candidates(z), space.directions(z))
    found = search.problem.innovations.slopes(drives, space.candidates(z), space.directions(z))
    np.testing.assert_allclose(scores.sum(axis=0), found.gradient, rtol=1e-9, atol=1e-9)


def test_white_innovations_leave_the_errors_of_the_information(searched):
    search, summit = searched
    ratio = robust_errors(summit, search.block_sums(summit.z)) / summit.knowledge.error
    assert np.all(np.abs(np.log(ratio[search.coordinates.kind("parameter")])) < np.log(2.0))  # of twelve blocks
    assert search.colour(summit, lambda _: None) is None


def test_a_coloured_disturbance_widens_the_intervals_and_determines_nothing(drive):
    """What lasts for seconds in the lateral velocity shows in the innovations, and moves the values."""
    white = np.random.default_rng(3).standard_normal(drive.sizes["time"])
    slow = lfilter([1.0], [1.0, -0.995], white) * np.sqrt(1.0 - 0.995**2)
    odd = drive.copy()
    odd["lateral_velocity_rear"] = drive["lateral_velocity_rear"] + 0.1 * slow
    fit = identify(problem_of(odd), QUICK)
    assert "lateral_velocity_rear" in fit.coloured
    truth = model_of(CAR).values
    for name in FREE:
        e = fit.estimate(name)
        assert e.lower < truth[name] < e.upper
        assert e.widened > 1.2
        assert e.verdict != "determined"
    stored = record(fit, [])
    assert stored["answer"] == answer(fit)
    assert "lateral velocity rear" in stored["answer"]
    assert stored["estimates"][0]["widened_by_colour"] == fit.estimates[0].widened


def test_the_steps_of_a_sensor_are_no_colour_that_matters(drive):
    coarse = drive.copy()
    step = np.radians(0.05)
    coarse["heading"] = np.round(drive["heading"] / step) * step
    fit = identify(problem_of(coarse), QUICK)
    assert fit.coloured == ()
    assert {fit.estimate(name).widened for name in FREE} == {1.0}
