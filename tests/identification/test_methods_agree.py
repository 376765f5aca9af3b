"""Likelihood, swarm and EM find the same parameters where all three must: the right model, sensors with noise."""

import dataclasses

import numpy as np
import pytest
from scipy import stats

from harness.identification.contract import Problem, load_method, settings_of
from harness.identification.innovations import Innovations
from reproductions.sun_em import FREE, car, recording

STIFFNESS = FREE[:2]
TRUTH = np.array([car(start=False).values[name] for name in STIFFNESS])
RECORDINGS = range(4)
SETTINGS = {
    "likelihood": {"profiles": False},
    "swarm": {"particles": 24, "iterations": 40, "bounds": dict.fromkeys(STIFFNESS, (4.0, 16.0))},
    "em": {"iterations": 8, "window": 4},
}


@pytest.fixture(scope="module")
def estimates():
    """Stiffness estimates of each method on the same recordings ``(recording, parameter)``, and stated errors."""
    right = {name: car(start=False).values[name] for name in FREE[2:]}
    begin = car(start=True)
    innovations = Innovations(dataclasses.replace(begin, values={**begin.values, **right}), jobs=1)
    found = {}
    for name, given in SETTINGS.items():
        method = load_method(name)
        problems = [Problem(innovations, (recording(seed),), STIFFNESS, seed=seed) for seed in RECORDINGS]
        fits = [method.identify(problem, settings_of(method, given)) for problem in problems]
        found[name] = np.array([[(fit.estimate(n).value, fit.estimate(n).error) for n in STIFFNESS] for fit in fits])
    return found


def interval(values):
    """99 % interval of the mean over recordings with noise of their own, by Student's t."""
    half = stats.t.ppf(0.995, len(values) - 1) * values.std(axis=0, ddof=1) / np.sqrt(len(values))
    return values.mean(axis=0) - half, values.mean(axis=0) + half


@pytest.mark.parametrize("method", SETTINGS)
def test_the_interval_over_recordings_holds_the_truth_and_is_narrow(estimates, method):
    lower, upper = interval(estimates[method][..., 0])
    assert np.all((lower < TRUTH) & (upper > TRUTH))
    assert np.all(upper - lower < 0.012 * TRUTH)  # the search began 5 % off


@pytest.mark.parametrize("method", ["swarm", "em"])
def test_methods_agree_on_each_recording(estimates, method):
    """The difference to the likelihood on the same recording is zero within its interval."""
    lower, upper = interval(estimates[method][..., 0] - estimates["likelihood"][..., 0])
    assert np.all((lower < 0) & (upper > 0))


def test_the_likelihood_states_its_error_and_is_the_most_exact(estimates):
    values, errors = estimates["likelihood"][..., 0], estimates["likelihood"][..., 1]
    assert np.all(np.abs(values - TRUTH) < 3 * errors)
    scatter = {name: np.std(found[..., 0], axis=0) for name, found in estimates.items()}
    assert np.all(scatter["likelihood"] < np.minimum(scatter["swarm"], scatter["em"]))
    assert np.isnan(estimates["swarm"][..., 1]).all()  # neither of the others states an error
    assert np.isnan(estimates["em"][..., 1]).all()
