"""Detection limits: closed forms of their information, and drives that lower that of an effect of a car."""

import math

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.config import resolve_single
from harness.experiment.contract import total
from harness.experiment.detection import DetectionGoal
from harness.experiment.open_trace import AtLevel, DrivesSoFar, OpenTrace, RivalModel
from support.rehearsed import evidence_of

CAR = {"vehicle": "car", "parameters": "blanco_2021", "tyre": "linear", "sensors": "car_series", "integrator": "rk4"}
FREE = ("stiffness_peak_front", "stiffness_peak_rear")
LIMITS = {
    "steering_lag": {"steering_lag": 0.2},
    "mass": {"mass": math.inf},
    "stiffness_peak_front": {"stiffness_peak_front": 1.0},
}


@pytest.fixture(scope="module")
def trace():
    """Return a trace that left the nominal model alone."""
    spec = resolve_single(CAR, "test")
    values = {n: spec.values[n] for n in FREE}
    errors = np.array([0.02 * v for v in values.values()])
    said = AtLevel(0.0, np.zeros(2), np.diag(errors**-2.0))
    rival = RivalModel("nothing added", (), 1.0, values, errors, np.eye(2), dict(spec.measurement_noise), (said,))
    return OpenTrace(spec, (rival,), DrivesSoFar((spec.process_noise,), 80.0, 40.0), 0.0, LIMITS)


@pytest.fixture(scope="module")
def goal(trace):
    return DetectionGoal(trace, ["steering_lag"])


def test_before_any_drive_the_limit_is_that_of_the_trace(goal):
    assert math.exp(goal.value(None)) == pytest.approx(0.2)
    assert math.isinf(DetectionGoal(goal.trace, ["mass"]).expectation(None).record["limits"]["mass"]["before"])


def test_an_amplitude_that_no_drive_shows_does_not_hide_what_they_tell_of_others(trace):
    both = DetectionGoal(trace, ["steering_lag", "mass"])
    lag = total([((np.diag([4.0, 1.0, 9.0, 0.0]),), 2)])
    mass = total([((np.diag([4.0, 1.0, 0.0, 9.0]),), 2)])
    assert both.value(mass) < both.value(lag) < both.value(None)
    expectation = both.expectation(lag)
    assert expectation.record["limits"]["steering_lag"]["after"] == pytest.approx(1.0 / math.sqrt(0.2**-2 + 9.0))
    assert math.isinf(expectation.record["limits"]["mass"]["after"])
    assert expectation.open == ("mass: no drive shows it",)
    assert "mass" not in expectation.words


def test_one_hypothesis_is_tried_at_a_time(trace):
    """What two amplitudes do alike hides neither of them, as a trace has one of them in its model."""
    both = DetectionGoal(trace, ["steering_lag", "mass"])
    alike = np.diag([4.0, 1.0, 9.0, 9.0])
    alike[2, 3] = alike[3, 2] = 9.0
    limits = both.expectation(total([((alike,), 2)])).record["limits"]
    assert limits["steering_lag"]["after"] == pytest.approx(1.0 / math.sqrt(0.2**-2 + 9.0))
    assert limits["mass"]["after"] == pytest.approx(1.0 / 3.0)
    assert limits["mass"]["hypothesis"] == "mass"


def test_half_of_the_drives_are_fitted_and_information_adds_up(goal):
    information = np.array([[4.0, 0.0, 2.0], [0.0, 1.0, 0.0], [2.0, 0.0, 9.0]])
    # Of the last, 9 less 2^2 / 4 is left with the others open; of two drives one is fitted.
    expected = 1.0 / math.sqrt(0.2**-2 + 8.0)
    assert math.exp(goal.value(total([((information,), 2)]))) == pytest.approx(expected)


def test_a_sweep_lowers_the_limit_of_a_lag_and_a_ramp_does_not(goal):
    sweep, ramp = (total([(evidence_of(goal, *d), 2)]) for d in (("sweep", [0.3, 0.3, 0.3, 0.5]), ("ramp", [0.3, 0.3])))
    assert goal.value(sweep) < goal.value(ramp) < goal.value(None)
    limits = goal.expectation(sweep).record["limits"]["steering_lag"]
    assert limits["before"] == pytest.approx(0.2)
    assert limits["after"] < 0.02
    assert goal.expectation(sweep).open == ()


def test_a_calm_drive_tells_nothing(goal):
    lively, calm = (evidence_of(goal, "weave", [0.3, 0.3, 0.3], largest)[0] for largest in (4.0, 0.5))
    assert lively.any()
    assert not calm.any()


def test_what_the_trace_did_not_try_or_has_already_is_refused(trace):
    with pytest.raises(UserError, match="tried no 'steering_leg'; closest: steering_lag"):
        DetectionGoal(trace, ["steering_leg"])
    with pytest.raises(UserError, match="has 'stiffness_peak_front' already"):
        DetectionGoal(trace, ["stiffness_peak_front"])
