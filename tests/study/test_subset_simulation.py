"""Subset simulation on problems with a known probability."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats

from harness.common.errors import UserError
from harness.study.subset_simulation import rare_event


def plane(points):
    return points.sum(axis=1) / np.sqrt(points.shape[1])


def sphere(points):
    return np.square(points).sum(axis=1)


PROBLEMS = {"plane of ten": (plane, 10, stats.norm.isf), "sphere of five": (sphere, 5, stats.chi2(5).isf)}


@pytest.mark.parametrize("problem", PROBLEMS)
def test_a_probability_of_a_millionth_is_met_within_a_fifth(problem):
    function, dimensions, at = PROBLEMS[problem]
    event = rare_event(function, dimensions, at(1e-6), samples=20_000, seed=1)
    assert event.probability == pytest.approx(1e-6, rel=0.2)
    assert event.evaluations < 150_000
    assert len(event.thresholds) == 6
    assert list(event.thresholds) == sorted(event.thresholds)


@pytest.mark.parametrize("problem", PROBLEMS)
def test_the_coefficient_of_variation_is_that_of_repeats(problem):
    function, dimensions, at = PROBLEMS[problem]
    events = [rare_event(function, dimensions, at(1e-6), samples=5000, seed=seed) for seed in range(40)]
    estimates = np.array([e.probability for e in events])
    assert estimates.mean() == pytest.approx(1e-6, rel=0.1)
    assert np.mean([e.variation for e in events]) == pytest.approx(estimates.std() / 1e-6, rel=0.35)


def test_where_plain_monte_carlo_reaches_both_agree():
    values = plane(np.random.default_rng(0).standard_normal((200_000, 10)))
    event = rare_event(plane, 10, 2.5, samples=10_000)
    assert event.probability == pytest.approx(np.mean(values > 2.5), abs=3 * event.variation * event.probability)


def test_a_frequent_event_takes_one_level_and_an_impossible_one_is_refused():
    event = rare_event(plane, 2, 0.0, samples=1000)
    assert event.probability == pytest.approx(0.5, abs=0.05)
    assert event.evaluations == 1000
    with pytest.raises(UserError, match="the limit 2 is not reached"):
        rare_event(lambda points: np.tanh(points[:, 0]), 2, 2.0, samples=100)
