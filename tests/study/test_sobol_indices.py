"""Sobol indices of functions whose indices are known, and the rule for lost runs."""

from __future__ import annotations

import numpy as np
import pytest
from SALib.analyze import sobol

from harness.study import sobol_indices
from harness.study.design import saltelli_points


def ishigami(x):
    x = np.pi * (2.0 * x - 1.0)
    return np.sin(x[:, 0]) + 7.0 * np.sin(x[:, 1]) ** 2 + 0.1 * x[:, 2] ** 4 * np.sin(x[:, 0])


def ishigami_indices():
    """Analytic indices with a = 7, b = 0.1 (Ishigami and Homma 1990)."""
    a, b = 7.0, 0.1
    first = [0.5 * (1 + b * np.pi**4 / 5) ** 2, a**2 / 8, 0.0]
    together = b**2 * np.pi**8 * (1 / 18 - 1 / 50)
    variance = sum(first) + together
    return np.array(first) / variance, np.array([first[0] + together, first[1], together]) / variance


G = np.array([0.0, 1.0, 4.5, 9.0, 99.0])


def g_function(x):
    return np.prod((np.abs(4.0 * x - 2.0) + G) / (1.0 + G), axis=1)


def g_indices():
    """Analytic indices (Saltelli and Sobol 1995)."""
    alone = 1.0 / (3.0 * (1.0 + G) ** 2)
    variance = np.prod(1.0 + alone) - 1.0
    total = [alone[i] * np.prod(np.delete(1.0 + alone, i)) for i in range(len(G))]
    return alone / variance, np.array(total) / variance


@pytest.mark.parametrize(("function", "known"), [(ishigami, ishigami_indices()), (g_function, g_indices())])
def test_known_indices_lie_in_their_intervals(function, known):
    factors = len(known[0])
    found = sobol_indices.sobol_indices(function(saltelli_points(1024, factors, seed=3)), factors)
    assert found.samples == 1024
    for kind, truth in zip((found.first, found.total), known, strict=True):
        for interval, value in zip(kind, truth, strict=True):
            assert interval.lower - 1e-3 <= value <= interval.upper + 1e-3
            assert interval.lower <= interval.value <= interval.upper
            assert interval.value == pytest.approx(value, abs=0.05)
    assert found.order == list(np.argsort(-known[1], kind="stable"))
    largest = np.sort(known[1])[::-1]
    assert found.lead.lower <= largest[0] - largest[1] <= found.lead.upper


@pytest.mark.parametrize(("function", "known"), [(ishigami, ishigami_indices()), (g_function, g_indices())])
def test_intervals_of_total_indices_cover_over_many_scramblings(function, known):
    factors, hits, trials = len(known[0]), np.zeros(len(known[0])), 60
    for seed in range(trials):
        found = sobol_indices.sobol_indices(
            function(saltelli_points(256, factors, seed)), factors, resamples=200, seed=seed
        )
        hits += [t.lower - 1e-3 <= truth <= t.upper + 1e-3 for t, truth in zip(found.total, known[1], strict=True)]
    # 0.95 nominal; a total index of 0.02 of the g-function has the least, 0.86 over 100 scramblings
    assert (hits / trials >= 0.78).all(), hits / trials
    assert np.mean(hits / trials) >= 0.93


@pytest.mark.parametrize(("level", "below"), [(0.95, 5), (0.9, 10), (0.5, 50), (1.0, 0)])
def test_an_interval_leaves_out_as_many_resamples_below_as_above(level, below):
    outcome = g_function(saltelli_points(64, 5, seed=0))
    found = sobol_indices.sobol_indices(outcome, 5, seed=2, resamples=201, level=level)
    problem = {"num_vars": 5, "names": list("abcde"), "bounds": [[0.0, 1.0]] * 5}
    drawn = sobol.analyze(problem, outcome, calc_second_order=False, num_resamples=201, keep_resamples=True, seed=3)
    for kind, resamples in ((found.first, drawn["S1_conf_all"]), (found.total, drawn["ST_conf_all"])):
        ends = np.sort(resamples, axis=0)[[below, 200 - below]].T
        np.testing.assert_allclose([(i.lower, i.upper) for i in kind], ends, rtol=1e-12)
    largest, second = found.order[:2]
    lead = np.sort(drawn["ST_conf_all"][:, largest] - drawn["ST_conf_all"][:, second])[[below, 200 - below]]
    assert (found.lead.lower, found.lead.upper) == pytest.approx(tuple(lead), rel=1e-12)


def test_indices_converge_to_the_known_ones():
    outcome = ishigami(saltelli_points(1024, 3, seed=0))
    found = sobol_indices.converging(outcome, 3, resamples=200)
    assert [f.samples for f in found] == [16, 32, 64, 128, 256, 512, 1024]
    assert found[-1] == sobol_indices.sobol_indices(outcome, 3, resamples=200)
    widths = [sum(t.upper - t.lower for t in f.total) for f in found]
    assert (
        widths[-1] < 0.6 * widths[2]
    )  # sixteen times the points; a quarter of the width on the average of scramblings
    errors = [max(abs(t.value - known) for t, known in zip(f.total, ishigami_indices()[1], strict=True)) for f in found]
    assert errors[-1] < 0.02 < errors[0]


def test_the_same_seed_gives_the_same_interval_and_zero_is_a_seed():
    outcome = g_function(saltelli_points(64, 5, seed=0))
    assert sobol_indices.sobol_indices(outcome, 5, seed=0) == sobol_indices.sobol_indices(outcome, 5, seed=0)
    assert sobol_indices.sobol_indices(outcome, 5, seed=0) != sobol_indices.sobol_indices(outcome, 5, seed=1)


def test_the_design_is_balanced_and_paired():
    points = saltelli_points(64, 3, seed=5).reshape(64, 5, 3)
    for i in range(3):
        assert (np.sum(points[:, i + 1] == points[:, 0], axis=1) == 2).all()  # A with one column of B
        np.testing.assert_array_equal(points[:, i + 1, i], points[:, 4, i])
        for rows in (points[:, 0, i], points[:, 4, i]):
            assert (np.histogram(rows, bins=64, range=(0, 1))[0] == 1).all()


def test_an_outcome_that_does_not_vary_has_no_indices():
    assert sobol_indices.sobol_indices(np.full(5 * 16, 7.0), 3) is None
    assert sobol_indices.converging(np.zeros(5 * 16), 3) == []


def test_a_design_with_gaps_is_refused():
    with pytest.raises(ValueError, match="fit no design of 3 factors"):
        sobol_indices.sobol_indices(np.arange(16.0), 3)
    with pytest.raises(ValueError, match="not finite"):
        sobol_indices.sobol_indices(np.array([1.0, np.nan] * 5), 3)


def test_diverged_runs_score_the_largest_error_of_their_drive():
    rmse = np.ones((2, 2, 3, 1))  # estimator, drive, sample, repeat
    rmse[0, 0, 1], rmse[1, 0, 2], rmse[1, 1] = 4.0, np.inf, 9.0
    scores = sobol_indices.scored(rmse)
    assert scores[1, 0, 2, 0] == 4.0  # of the other estimator, on the same drive
    kept = np.isfinite(rmse)
    np.testing.assert_array_equal(scores[kept], rmse[kept])
    rmse[0, 0, 0] = np.nan
    assert np.isnan(sobol_indices.scored(rmse)[0, 0, 0])
    rmse[:, 0] = np.inf
    assert np.isnan(sobol_indices.scored(rmse)[:, 0]).all()


def test_errors_of_drives_are_put_together_as_root_mean_square():
    scores = np.array([[3.0, 1.0], [4.0, 1.0]])[:, :, None]  # drive, sample, repeat
    np.testing.assert_allclose(sobol_indices.over_drives(scores), [np.sqrt(12.5), 1.0])
    scores[0] = np.nan
    np.testing.assert_allclose(sobol_indices.over_drives(scores), [4.0, 1.0])
    assert np.isnan(sobol_indices.over_drives(np.full((2, 1, 1), np.nan))).all()


def test_a_lost_run_hides_no_factor():
    """Runs are lost where the first factor is large: with the rule its index stays what it is without loss."""
    x = saltelli_points(256, 2, seed=1)
    error = 1.0 + x[:, 0] + 0.2 * x[:, 1]
    lost = x[:, 0] > 0.9
    scores = sobol_indices.scored(np.where(lost, np.inf, error)[None, None, :, None])
    whole, capped = (sobol_indices.sobol_indices(y, 2) for y in (error, sobol_indices.over_drives(scores)[0]))
    assert capped.total[0].value == pytest.approx(whole.total[0].value, abs=0.05)
    assert sobol_indices.sobol_indices(lost.astype(float), 2).total[0].value > 0.9
    assert sobol_indices.sobol_indices(sobol_indices.ranks(sobol_indices.over_drives(scores)[0]), 2).order == [0, 1]


def test_two_equal_factors_have_no_lead_and_a_larger_one_has():
    """The difference comes from pairs of resamples: it decides although the intervals of the two overlap."""
    points = saltelli_points(128, 2, seed=4)
    alike = sobol_indices.sobol_indices(points.sum(axis=1), 2)
    assert alike.lead.lower <= 0.0 <= alike.lead.upper
    led = sobol_indices.sobol_indices(points @ [1.0, 1.3], 2)
    assert led.order[0] == 1
    assert led.lead.lower > 0.0
    assert np.isnan(sobol_indices.sobol_indices(saltelli_points(64, 1, seed=4)[:, 0], 1).lead.value)
