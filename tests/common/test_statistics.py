"""Known answers for the statistics of the report."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats

from harness.common import statistics
from harness.runner.scores import Scoring, chi_square_bounds


def test_median_interval_of_a_sample_that_cannot_vary():
    assert statistics.median_interval([4.0] * 6) == (4.0, 4.0, 4.0)
    assert np.isnan(statistics.median_interval([np.nan, np.nan])).all()


def test_fewer_than_six_values_have_no_interval_at_95_percent():
    """Five lie on one side of the median with a probability of 2 / 2**5, six with 2 / 2**6."""
    value, lower, upper = statistics.median_interval([1.0, 2.0, 3.0, 4.0, 5.0])
    assert value == 3.0
    assert np.isnan([lower, upper]).all()
    assert np.isfinite(statistics.median_interval([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])).all()
    assert np.isfinite(statistics.median_interval([1.0, 2.0, 3.0, 4.0, 5.0], level=0.9)).all()


def test_median_interval_is_reproducible_and_depends_on_the_seed():
    values = np.random.default_rng(3).normal(size=400)
    first = statistics.median_interval(values, seed=0)
    assert first == statistics.median_interval(values, seed=0)
    assert first != statistics.median_interval(values, seed=1)
    assert first.lower < first.value < first.upper
    assert first.value == np.median(values)


def test_median_interval_agrees_with_scipy():
    values = np.random.default_rng(5).exponential(size=60)
    ours = statistics.median_interval(values, resamples=9999)
    theirs = stats.bootstrap((values,), np.median, method="percentile", rng=np.random.default_rng(0))
    low, high = theirs.confidence_interval
    assert ours.lower == pytest.approx(low, abs=0.03)
    assert ours.upper == pytest.approx(high, abs=0.03)


@pytest.mark.parametrize("size", [21, 60])
def test_median_interval_covers_the_true_median_of_normal_samples(size):
    rng = np.random.default_rng(size)
    trials = 400
    hits = 0
    for _ in range(trials):
        _, lower, upper = statistics.median_interval(rng.normal(3.0, 2.0, size), resamples=500)
        hits += lower <= 3.0 <= upper
    # 0.95 nominal; three standard deviations of a share of 400 trials are 0.033
    assert 0.91 <= hits / trials <= 0.985


def test_stratified_interval_covers_where_the_drives_differ():
    """Five drives with their own level: the interval holds for the same drives with new noise."""
    rng = np.random.default_rng(11)
    centres = np.array([1.0, 2.0, 3.0, 4.0, 5.0])
    strata = np.repeat(np.arange(5), 15)
    truth = 3.0  # the mixture is symmetric about the middle drive
    hits, stratified, pooled = 0, [], []
    for _ in range(300):
        values = centres[strata] + rng.normal(0.0, 0.3, strata.size)
        _, lower, upper = statistics.median_interval(values, strata, resamples=500)
        hits += lower <= truth <= upper
        stratified.append(upper - lower)
        interval = statistics.median_interval(values, resamples=500)
        pooled.append(interval.upper - interval.lower)
    assert 0.90 <= hits / 300 <= 0.99
    assert np.mean(stratified) < 0.7 * np.mean(pooled)


def test_few_runs_per_drive_are_resampled_as_one():
    values = np.arange(16.0)
    assert statistics.median_interval(values, np.arange(16)) == statistics.median_interval(values)
    assert statistics.median_interval(values, np.repeat(range(4), 4)) == statistics.median_interval(values)
    assert statistics.median_interval(values, np.repeat(range(2), 8)) != statistics.median_interval(values)


@pytest.mark.parametrize(("drives", "repeats"), [(4, 2), (2, 4), (1, 8)])
def test_the_interval_of_few_runs_covers_the_true_median(drives, repeats):
    rng = np.random.default_rng(4)
    strata = np.repeat(np.arange(drives), repeats)
    hits = 0
    for trial in range(400):
        _, lower, upper = statistics.median_interval(rng.normal(size=strata.size), strata, resamples=400, seed=trial)
        hits += lower <= 0.0 <= upper
    assert hits / 400 >= 0.90  # resampled within drives, two runs on each of four reach 0.77


def test_strata_of_another_length_are_refused():
    with pytest.raises(ValueError, match="one per value"):
        statistics.median_interval([1.0, 2.0], [0])


def test_summary_against_closed_form():
    """The quantiles of 0..100 are the percentages themselves."""
    values = np.random.default_rng(0).permutation(101).astype(float)
    summary = statistics.summarise(np.append(values, np.nan))
    assert (summary.n, summary.median.value) == (101, 50.0)
    assert (summary.lower_quartile, summary.upper_quartile) == (25.0, 75.0)
    assert (summary.minimum, summary.maximum) == (0.0, 100.0)
    assert statistics.summarise([]).n == 0
    assert np.isnan(statistics.summarise([]).maximum)


def test_paired_ratios_by_hand():
    first = np.array([1.0, 2.0, 3.0, 4.0, np.nan])
    second = np.array([0.5, 1.0, 4.0, 2.0, 1.0])
    result = statistics.compare(first, second)
    assert (result.n, result.wins) == (4, 3)
    assert result.ratio.value == 0.5
    assert result.p_value == pytest.approx(stats.wilcoxon(np.log([0.5, 0.5, 4 / 3, 0.5])).pvalue)


def test_paired_ratios_show_a_small_but_steady_gain():
    """Drives differ ten times as much as the estimators do."""
    rng = np.random.default_rng(2)
    drives = np.repeat(np.arange(6), 20)
    first = (1.0 + drives) * np.exp(0.3 * rng.normal(size=120))
    second = 0.8 * first * np.exp(0.1 * rng.normal(size=120))
    result = statistics.compare(first, second, drives)
    assert result.ratio.lower < 0.8 < result.ratio.upper < 0.85
    assert result.p_value < 1e-6


@pytest.mark.parametrize("count", [4, 6, 8, 13])
def test_smallest_p_value_of_a_test_of_pairs(count):
    """Of the sign patterns of n differences two are the most extreme."""
    result = statistics.compare(np.ones(count), np.exp(-np.arange(1.0, count + 1)))
    assert result.p_value == pytest.approx(statistics.one_sided(count)) == pytest.approx(2 / 2**count)
    assert result.wins == count


def test_equal_estimators_show_no_difference():
    result = statistics.compare(np.ones(10), np.ones(10))
    assert (result.p_value, result.wins) == (1.0, 0)
    assert result.ratio == (1.0, 1.0, 1.0)
    assert statistics.compare([np.nan], [1.0]).n == 0


def test_holm_worked_by_hand():
    """0.01 * 4, max(0.04, 0.02 * 3), max(0.06, 0.03 * 2), max(0.06, 0.04 * 1), given in another order."""
    np.testing.assert_allclose(statistics.holm([0.04, 0.01, 0.03, 0.02]), [0.06, 0.04, 0.06, 0.06])
    np.testing.assert_allclose(statistics.holm([0.6, 0.7]), [1.0, 1.0])
    np.testing.assert_allclose(statistics.holm([0.01, np.nan, 0.5]), [0.02, np.nan, 0.5])
    assert statistics.holm([]).size == 0


def test_average_bounds_against_scipy_and_monte_carlo():
    lower, upper = statistics.average_bounds(11, 50)
    assert lower == pytest.approx(stats.chi2.ppf(0.025, 550) / 50)
    assert upper == pytest.approx(stats.chi2.ppf(0.975, 550) / 50)
    averages = np.random.default_rng(1).chisquare(11, (20000, 50)).mean(axis=1)
    assert np.mean((lower <= averages) & (averages <= upper)) == pytest.approx(0.95, abs=0.005)
    assert np.isnan(statistics.average_bounds(11, 0)).all()


def test_nees_bounds_hold_for_correlated_errors():
    """Averages over time of correlated errors stay inside the bounds at least as often as promised."""
    rng = np.random.default_rng(4)
    runs, steps, dimension, trials = 20, 40, 3, 400
    noise = rng.normal(size=(steps, trials, runs, dimension))
    error = noise[0]
    nees = np.sum(error**2, axis=-1)
    for k in range(1, steps):
        error = 0.95 * error + np.sqrt(1 - 0.95**2) * noise[k]
        nees += np.sum(error**2, axis=-1)
    averages = (nees / steps).mean(axis=1)
    lower, upper = statistics.average_bounds(dimension, runs)
    assert np.mean((lower <= averages) & (averages <= upper)) > 0.95


def test_a_ratio_of_medians_is_exact_where_every_run_shrinks_alike():
    rng = np.random.default_rng(0)
    first = rng.lognormal(size=(40, 7))
    value, lower, upper = statistics.median_ratio(first, 0.25 * first, np.repeat([0, 1], 20))
    assert (value, lower, upper) == pytest.approx((0.25, 0.25, 0.25))


def test_a_ratio_of_medians_counts_only_what_both_have():
    first = np.array([[1.0, 2.0], [3.0, np.nan], [5.0, 6.0]])
    second = np.array([[2.0, np.nan], [6.0, 1.0], [10.0, np.inf]])
    assert statistics.median_ratio(first, second).value == pytest.approx(2.0)
    assert np.isnan(statistics.median_ratio(first, np.full((3, 2), np.nan)).value)


def test_levels_that_share_their_noise_do_not_narrow_the_interval_of_a_ratio():
    rng = np.random.default_rng(1)
    first, second = rng.lognormal(size=(2, 30, 1))
    alone = statistics.median_ratio(first, second, seed=3)
    repeated = statistics.median_ratio(np.repeat(first, 9, axis=1), np.repeat(second, 9, axis=1), seed=3)
    assert repeated == pytest.approx(alone)


def test_the_interval_of_a_ratio_covers_the_true_one():
    rng, hits = np.random.default_rng(2), 0
    for k in range(200):
        common = rng.lognormal(sigma=0.5, size=(60, 1))
        first, second = common * rng.lognormal(sigma=0.2, size=(2, 60, 1))
        found = statistics.median_ratio(first, 0.5 * second, resamples=400, seed=k)
        hits += found.lower <= 0.5 <= found.upper
    assert 184 <= hits <= 199  # 95 % of 200; a percentile interval of a median is a little wide


@pytest.mark.parametrize(("worse", "better", "grown"), [(12, 0, True), (11, 1, True), (7, 5, False), (0, 12, False)])
def test_an_error_grows_where_nearly_all_blocks_say_so(worse, better, grown):
    """7 of 12 that grow by as much as 5 shrink: the mean of a resample is above zero in about 61 of 100 (binomial)."""
    growth = np.array([0.4] * worse + [-0.4] * better + [np.nan])
    assert statistics.grows(growth) == grown


@pytest.mark.parametrize(("growth", "grown"), [(0.049, False), (0.051, True)])
def test_an_error_that_grows_by_less_than_a_twentieth_does_not_count(growth, grown):
    assert statistics.grows(np.full(10, growth)) == grown
    assert not statistics.grows(np.array([np.nan]))


def test_interval_of_a_large_sample_is_the_one_that_would_be_drawn(monkeypatch):
    rng = np.random.default_rng(3)
    sizes = (3_000, 5_000, 4_100)
    values = np.concatenate([rng.lognormal(m, s, n) for m, s, n in zip((0, 0.5, 3), (1, 0.3, 2), sizes, strict=True)])
    strata = np.repeat(np.arange(3), sizes)
    order = rng.permutation(values.size)
    values, strata = values[order], strata[order]
    monkeypatch.setattr(statistics, "LARGE", values.size - 1)
    computed = statistics.median_interval(values, strata)
    monkeypatch.setattr(statistics, "LARGE", values.size)
    drawn = statistics.median_interval(values, strata, seed=1)
    assert computed.value == drawn.value
    width = drawn.upper - drawn.lower
    assert computed.lower == pytest.approx(drawn.lower, abs=0.1 * width)
    assert computed.upper == pytest.approx(drawn.upper, abs=0.1 * width)
    pooled = statistics.median_interval(values)  # without strata more varies
    assert pooled.upper - pooled.lower > 1.02 * (computed.upper - computed.lower)


def test_interval_of_a_large_sample_of_few_values_stays_within_it():
    assert statistics.median_interval(np.full(200_001, 2.0)) == (2.0, 2.0, 2.0)
    values = np.repeat([1.0, 2.0], [100_001, 100_000])
    found = statistics.median_interval(values)
    assert (found.lower, found.value, found.upper) == (1.0, 1.0, 2.0)


@pytest.mark.parametrize("coverage", [0.95, 0.5])
def test_bounds_of_a_squared_error_are_those_of_scipy(tmp_path, monkeypatch, coverage):
    monkeypatch.setenv("HARNESS_CACHE", str(tmp_path))  # what was kept before is not what is tested
    bounds = chi_square_bounds(12, coverage)
    expected = [stats.chi2.interval(coverage, degrees) for degrees in range(1, 12)]
    np.testing.assert_allclose(bounds, [(0.0, 0.0), *expected], rtol=1e-12)


def test_a_squared_error_by_a_covariance_that_has_no_inverse_is_none():
    """Of five runs: the unit covariance, one that is stretched, none, one that is not finite, and one below zero."""
    covariance = np.stack([np.eye(2), np.diag([4.0, 0.25]), np.zeros((2, 2)), np.diag([np.nan, 1.0]), -np.eye(2)])
    mean = np.tile(np.array([1.0, 2.0, 5.0])[:, None], (1, 5))[None]
    history = SimpleNamespace(mean=mean[:, :2], state_covariance=np.moveaxis(covariance, 0, -1)[None])
    truth = np.tile(np.array([1.5, 9.0, 1.0])[:, None], (1, 5))[None]
    nees = Scoring._nees(SimpleNamespace(truth=truth), history, np.array([0, 2]), np.zeros(2), slice(None))
    np.testing.assert_allclose(nees[0], [0.25 + 1.0, 0.25 / 4 + 1.0 / 0.25, np.nan, np.nan, np.nan])
