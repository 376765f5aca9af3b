"""Probabilities, quantiles and tail means of known distributions, and how often their intervals hold them."""

from __future__ import annotations

import numpy as np
import pytest
from scipy import stats
from scipy.stats import qmc

from harness.study.exceedance import exceedance, quantile, tail_interval

REPEATS = 500
LAW = stats.norm(3.0, np.sqrt(1.25))


@pytest.fixture(scope="module")
def populations():
    """Errors ``(repeat, 8, 128)``: a smooth function of two scrambled factors, and noise of each run."""
    rng = np.random.default_rng(1)
    unit = np.array([[qmc.Sobol(2, seed=rng).random(128) for _ in range(8)] for _ in range(REPEATS)])
    scores = stats.norm.ppf(np.clip(unit, 1e-9, 1 - 1e-9))
    return 3.0 + scores @ np.array([0.8, 0.6]) + 0.5 * rng.standard_normal(unit.shape[:3])


def coverage(intervals, true):
    return np.mean([i.lower <= true <= i.upper for i in intervals])


def test_the_interval_of_a_probability_holds_it_as_often_as_it_says(populations):
    limit = 4.0
    intervals = [exceedance(errors, limit).probability for errors in populations]
    assert np.mean([i.value for i in intervals]) == pytest.approx(LAW.sf(limit), rel=0.01)
    assert 0.93 <= coverage(intervals, LAW.sf(limit)) <= 0.97


@pytest.mark.parametrize("share", [0.5, 0.95, 0.99])
def test_the_interval_of_a_quantile_holds_it_as_often_as_it_says(populations, share):
    intervals = [quantile(errors, share) for errors in populations]
    assert np.mean([i.value for i in intervals]) == pytest.approx(LAW.ppf(share), rel=0.01)
    assert 0.93 <= coverage(intervals, LAW.ppf(share)) <= 0.98


def test_the_interval_of_the_tail_mean_holds_it_as_often_as_it_says(populations):
    true = 3.0 + np.sqrt(1.25) * stats.norm.pdf(stats.norm.ppf(0.95)) / 0.05
    intervals = [tail_interval(errors) for errors in populations]
    assert np.mean([i.value for i in intervals]) == pytest.approx(true, rel=0.01)
    assert 0.92 <= coverage(intervals, true) <= 0.97


def test_few_events_have_the_interval_of_clopper_and_pearson():
    errors = np.zeros((8, 16))
    errors[0, :2] = 2.0
    few = exceedance(errors, 1.0)
    assert few.exact
    expected = stats.binomtest(2, 128).proportion_ci(method="exact")
    assert few.probability[1:] == pytest.approx((expected.low, expected.high))
    assert exceedance(errors, 3.0).probability[:2] == (0.0, 0.0)
    assert exceedance(errors, 3.0).probability.upper == pytest.approx(1 - 0.025 ** (1 / 128))
    assert exceedance(errors, -1.0).probability[::2] == (1.0, 1.0)


def test_points_needed_for_a_width_grow_with_its_inverse_square(populations):
    broken = exceedance(populations[0], 4.0)
    half = (broken.probability.upper - broken.probability.lower) / 2.0
    assert broken.needed(half) == broken.points
    assert broken.needed(half / 2.0) == pytest.approx(4 * broken.points, abs=1)


def test_lost_runs_exceed_every_limit_and_leave_no_tail_mean():
    errors = np.linspace(0.0, 1.0, 128).reshape(8, 16)
    errors[0, 0] = np.inf
    assert exceedance(errors, 10.0).events == 1
    assert np.isinf(quantile(errors, 0.99).upper)
    assert np.isfinite(quantile(errors, 0.5)).all()
    assert np.isinf(tail_interval(errors).value)


def test_of_few_points_an_extreme_quantile_has_no_upper_end_and_no_tail_is_beyond_the_largest():
    """Of 16 alike points nothing is known beyond the largest; the order statistics are those of the binomial law."""
    errors = np.tile([0.1, 0.2], (8, 1)) + 1e-3 * np.arange(8)[:, None]
    for share in (0.95, 0.99):
        found = quantile(errors, share)
        assert found.value == errors.max()
        assert found.upper == np.inf
        assert found.lower < found.value
    assert tail_interval(errors).value == pytest.approx(errors.max())
