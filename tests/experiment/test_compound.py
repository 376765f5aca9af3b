"""Compound of T- and D-optimality: its limits, and drives that learn more where the set is settled either way."""

import math
from dataclasses import replace

import numpy as np
import pytest

from harness.config import resolve_single
from harness.experiment.compound import TraceGoal
from harness.experiment.contract import total
from harness.experiment.open_trace import AtLevel, DrivesSoFar, OpenTrace, RivalModel
from harness.experiment.separation import SeparationGoal
from support.rehearsed import evidence_of

CAR = {"vehicle": "car", "parameters": "blanco_2021", "tyre": "linear", "sensors": "car_series", "integrator": "rk4"}
FREE = ("stiffness_peak_front", "stiffness_peak_rear")
LIMITS = {
    "steering_delay": {"steering_delay": 0.05},
    "brake_pull": {"brake_pull": 0.05},
    "sensor_drift@yaw_rate": {"sensor_drift_yaw_rate": math.inf},
    "forced_steering@21": {"forced_steering_21": 0.01},  # of a signal that a planned drive has not
}


@pytest.fixture(scope="module")
def trace():
    """Return a trace that left a lag of the steering and a relaxation of the front tyres."""
    spec = resolve_single(CAR, "test")
    rivals = []
    for name, size, p in (("steering_lag", 0.05, 0.6), ("tyre_relaxation_front", 0.6, 0.4)):
        values = {**{n: spec.values[n] for n in FREE}, name: size}
        errors = np.array([0.02 * spec.values[n] for n in FREE] + [0.1 * size])
        at = AtLevel(0.0, np.zeros(3), np.diag(errors**-2.0))
        rivals.append(RivalModel(name, (), p, values, errors, np.eye(3), dict(spec.measurement_noise), (at,)))
    return OpenTrace(spec, tuple(rivals), DrivesSoFar((spec.process_noise,), 80.0, 40.0), 0.0, LIMITS)


@pytest.fixture(scope="module")
def goal(trace):
    return TraceGoal(trace)


def evidence(goal, name, point):
    return total([(evidence_of(goal, name, point), 2)])


def test_its_weight_leads_from_d_to_t_optimality(trace, goal):
    sweep = evidence(goal, "sweep", [0.1, 0.3, 0.3, 0.5])
    only_d, only_t = (TraceGoal(trace, weight).preference(sweep) for weight in (0.0, 1.0))
    assert only_d == pytest.approx(-goal.learnt(sweep))
    assert only_t == pytest.approx(max(goal.value(sweep), goal.enough))
    assert goal.preference(sweep) == pytest.approx(0.5 * (only_d + only_t))
    assert goal.value(sweep) == pytest.approx(SeparationGoal(trace).value(sweep))


def test_what_is_learnt_is_the_growth_of_the_information_on_all_coordinates(goal):
    """Three of the likeliest model and three amplitudes; half of the drives are fitted."""
    *separation, information = evidence(goal, "sweep", [0.3, 0.3, 0.3, 0.5])
    assert information.shape == (6, 6)
    one = np.zeros((6, 6))
    one[4, 4] = 2.0 * (math.e**2 - 1.0)  # the standard error of one amplitude falls by a factor of e
    assert goal.learnt((*separation, one)) == pytest.approx(1.0 / 6.0)
    assert goal.learnt(None) == 0.0


def test_of_drives_that_settle_the_set_the_one_of_many_frequencies_is_preferred(goal):
    weave, sweep = evidence(goal, "weave", [0.8, 0.8, 0.5]), evidence(goal, "sweep", [0.8, 0.8, 0.1, 0.9])
    assert goal.value(weave) < goal.enough
    assert goal.value(sweep) < goal.enough
    assert goal.preference(sweep) < goal.preference(weave)


def test_an_amplitude_that_only_braking_shows_is_a_reason_to_brake(trace, goal):
    """Without it among what was tried, the same braking is less worth against the same weave."""
    without = TraceGoal(replace(trace, detectable={"steering_delay": LIMITS["steering_delay"]}))
    brake, weave = ("brake", [0.3, 0.8, 0.9]), ("weave", [0.3, 0.3, 0.3])
    gains = [g.learnt(evidence(g, *brake)) * 2 * len(g._known) - g.learnt(evidence(g, *weave)) * 2 * len(g._known)
             for g in (goal, without)]  # fmt: skip
    assert gains[0] > gains[1]
