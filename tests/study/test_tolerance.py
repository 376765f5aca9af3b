"""The largest box of perturbations, on errors whose box is known."""

from __future__ import annotations

import numpy as np
import pytest

from harness.study.design import scrambled_points
from harness.study.tolerance import reaches, tolerance

BOXES = 8


def errors_of(function, factors=2, rays=64):
    """Errors in a tolerance design about 0 with edges at -1 and 1: nominal, edges, box."""
    edges = np.zeros((2 * factors, factors))
    for i in range(factors):
        edges[2 * i, i], edges[2 * i + 1, i] = -1.0, 1.0
    whole = np.vstack([np.zeros((1, factors)), edges, 2.0 * scrambled_points(rays, factors, seed=1) - 1.0])
    return np.stack([function(whole * (k + 1) / BOXES) for k in range(BOXES)])


def test_reaches_are_linear_between_boxes():
    errors = np.array([[1.0, 1.0, 1.0, 5.0, 1.0], [2.0, 3.0, 1.0, 0.0, np.inf], [4.0, 3.0, 1.0, 0.0, np.inf]])
    np.testing.assert_allclose(reaches(errors, 2.5), [0.625, 0.375, 1.0, 0.0, 0.0])


def test_the_box_of_a_linear_error_is_the_one_it_must_be():
    """|3 x + y| <= 1 holds in the box of a quarter; the rays come near its corner, never below."""
    found = tolerance(errors_of(lambda x: np.abs(3.0 * x[:, 0] + x[:, 1])), 1.0, 2)
    assert 0.25 <= found.box <= 0.29
    assert found.box < found.typical < 1.0
    np.testing.assert_allclose(found.lower, [1 / 3, 1.0])
    np.testing.assert_allclose(found.upper, [1 / 3, 1.0])
    assert found.first == (0, False)
    assert found.holds == pytest.approx(0.05 ** (1 / 64))
    assert found.rays == 64


def test_the_first_factor_has_a_direction():
    found = tolerance(errors_of(lambda x: 1.0 + 2.0 * x[:, 1] - x[:, 0]), 2.0, 2)
    assert found.first == (1, True)
    assert found.upper[1] == pytest.approx(0.5)
    assert found.lower[1] == 1.0


def test_a_limit_that_always_holds_and_one_that_never_does():
    calm = tolerance(errors_of(lambda x: 1.0 + 0.0 * x[:, 0]), 2.0, 2)
    assert (calm.box, calm.typical, calm.first, calm.nominal) == (1.0, 1.0, None, 0.5)
    hopeless = tolerance(errors_of(lambda x: 1.0 + 0.0 * x[:, 0]), 0.5, 2)
    assert (hopeless.box, hopeless.first, hopeless.nominal) == (0.0, None, 2.0)


def test_a_factor_alone_ends_the_box_where_no_ray_does():
    """A limit that only the axis breaks, as where one drifting noise loses every run whatever else drifts with it."""
    found = tolerance(errors_of(lambda x: np.where((x[:, 0] > 0.3) & (x[:, 1] == 0.0), np.inf, 0.0)), 1.0, 2)
    assert found.typical == 1.0
    assert found.box == found.upper[0] == 0.25


def test_lost_runs_end_the_reach_at_the_last_box_that_was_whole():
    found = tolerance(errors_of(lambda x: np.where(np.abs(x).max(axis=1) > 0.5, np.inf, 0.0)), 1.0, 2)
    np.testing.assert_allclose(found.upper, [0.5, 0.5])


def test_the_stated_confidence_is_kept():
    """Over many scramblings, a box as large as the smallest reach loses no more than 4.6 % of its points, 95 in 100."""
    fraction, rays, trials = 0.954, 64, 400
    kept = 0
    for seed in range(trials):
        u = scrambled_points(rays, 1, seed)[:, 0]
        kept += u.min() < 1.0 - fraction  # the reach of ray u is u: the box of the smallest reach loses u.min() of them
    assert kept / trials >= 0.95 - 3 * np.sqrt(0.05 * 0.95 / trials)
