"""Fisher scoring within bounds, and the tests of whiteness, on problems whose answer is known."""

from types import SimpleNamespace

import numpy as np
import pytest
from scipy import signal

from harness.identification.fisher_scoring import bounded_step, maximise
from harness.identification.whiteness import whiteness

CURVATURE = np.array([[4.0, 1.0, 0.0], [1.0, 2.0, 0.5], [0.0, 0.5, 1e-6]]) + np.diag([0, 0, 0.5])
SUMMIT = np.array([1.0, -2.0, 3.0])


def parabola(lower=-np.inf, upper=np.inf):
    def values(z, keep_first=False):
        away = z - SUMMIT[:, None]
        return -0.5 * np.einsum("ik,ij,jk->k", away, CURVATURE, away)

    def slopes(z, moved):
        gradient = -CURVATURE @ (z - SUMMIT)
        return float(values(z[:, None])[0]), gradient[moved], CURVATURE[np.ix_(moved, moved)]

    return SimpleNamespace(values=values, slopes=slopes, lower=np.full(3, lower), upper=np.full(3, upper))


def test_a_parabola_is_climbed_in_one_step():
    calls, objective = [], parabola()
    inner = objective.slopes
    objective.slopes = lambda z, moved: calls.append(z) or inner(z, moved)
    found = maximise(objective, np.zeros(3), np.ones(3, dtype=bool), 10)
    assert found.converged
    assert np.allclose(found.z, SUMMIT, atol=1e-9)
    assert len(calls) == 1  # it gained what was predicted, so nothing is left


def test_bounds_hold_and_the_others_find_their_best_place_beside_them():
    found = maximise(parabola(upper=2.0), np.zeros(3), np.ones(3, dtype=bool), 20, enough=1e-12)
    assert found.converged
    assert found.z[2] == pytest.approx(2.0, abs=1e-9)
    rest = SUMMIT[:2] - np.linalg.solve(CURVATURE[:2, :2], CURVATURE[:2, 2] * (2.0 - SUMMIT[2]))
    assert np.allclose(found.z[:2], rest, atol=1e-6)


def test_what_does_not_move_stays():
    found = maximise(parabola(), np.zeros(3), np.array([True, False, True]), 10)
    assert found.z[1] == 0.0


def test_a_step_leaves_out_what_has_no_information():
    step = bounded_step(np.array([1.0, 5.0]), np.diag([2.0, 0.0]), 0.0, np.full(2, -9.0), np.full(2, 9.0))
    assert np.allclose(step, [0.5, 0.0])


def valley():
    """Return Rosenbrock's function as a sum of squares: the information is that of Gauss and Newton."""

    def rest(z):
        return np.array([10 * (z[1] - z[0] ** 2), 1 - z[0]])

    def slopes(z, moved):
        jacobian = np.array([[-20 * z[0], 10.0], [-1.0, 0.0]])
        return -0.5 * rest(z) @ rest(z), -jacobian.T @ rest(z), jacobian.T @ jacobian

    def values(z, keep_first=False):
        return -0.5 * (rest(z) ** 2).sum(axis=0)

    return SimpleNamespace(values=values, slopes=slopes, lower=np.full(2, -5.0), upper=np.full(2, 5.0))


def test_a_curved_valley_is_followed_to_its_end():
    found = maximise(valley(), np.array([-1.2, 1.0]), np.ones(2, dtype=bool), 60, enough=1e-12)
    assert np.allclose(found.z, 1.0, atol=1e-5)


def test_a_curved_valley_is_left_where_a_step_gains_little():
    """Along its bottom much less is gained than the curvature at a point predicts."""
    start, both = np.array([-1.2, 1.0]), np.ones(2, dtype=bool)
    whole = maximise(valley(), start, both, 60, enough=0.01)
    left = maximise(valley(), start, both, 60, enough=0.01, slow=0.3)
    assert whole.value > left.value > whole.value - 3.0
    assert not left.converged
    by_share = maximise(valley(), start, both, 60, enough=0.01, share=0.1)  # of what all before gained
    assert whole.value > by_share.value > whole.value - 5.0
    assert by_share.value > float(valley().values(start[:, None])[0])


def test_white_noise_passes_and_coloured_noise_fails():
    rng = np.random.default_rng(1)
    white = rng.normal(size=4000)
    found = whiteness(white)
    assert min(found.ljung_box, found.periodogram) > 0.01
    assert found.variance == pytest.approx(1.0, abs=0.1)
    coloured = whiteness(signal.lfilter([1.0], [1.0, -0.2], white))
    assert max(coloured.ljung_box, coloured.periodogram) < 1e-6


def test_whiteness_has_the_level_it_states():
    rng = np.random.default_rng(2)
    holes = rng.random(1000) < 0.2
    found = [whiteness(np.where(holes, np.nan, rng.normal(size=1000))) for _ in range(300)]
    for p in ([f.ljung_box for f in found], [f.periodogram for f in found]):
        assert 0.01 < np.mean(np.array(p) < 0.05) < 0.1


def test_too_few_samples_are_not_tested():
    found = whiteness(np.array([np.nan, 1.0, -1.0]))
    assert np.isnan(found.ljung_box)
    assert found.variance == 1.0


def test_the_full_step_comes_first_where_its_run_can_be_kept():
    """It is taken where no other step is better by what counts."""
    objective, kept = parabola(), []
    values = objective.values
    objective.values = lambda z, keep_first=False: kept.append((keep_first, z[:, 0].copy())) or values(z)
    maximise(objective, np.zeros(3), np.ones(3, dtype=bool), 10)
    assert kept[0][0]
    assert kept[0][1] == pytest.approx(SUMMIT)


def misled(objective, tried):
    """Return an objective whose slopes lead down, which notes how many candidates it was asked for."""
    inner, values = objective.slopes, objective.values

    def slopes(z, moved):
        value, gradient, information = inner(z, moved)
        return value, -gradient, information

    objective.slopes = slopes
    objective.values = lambda z, keep_first=False: tried.append(z.shape[1]) or values(z)
    return objective


def test_a_search_is_stuck_where_no_step_gains_anything():
    """Eight steps and eight ever smaller ones say so; it stays where it is."""
    tried: list[int] = []
    found = maximise(misled(parabola(), tried), np.zeros(3), np.ones(3, dtype=bool), 10)
    assert found.stuck
    assert not found.converged
    assert np.array_equal(found.z, np.zeros(3))
    assert tried == [8, 8]
    assert not maximise(parabola(), np.zeros(3), np.ones(3, dtype=bool), 10).stuck


def test_a_step_that_is_damped_enough_gains_where_the_curvature_is_understated():
    """No step of the first eight gains anything; what is gained later is a damped step and no full one."""
    objective, tried = parabola(), []
    inner, values = objective.slopes, objective.values
    objective.slopes = lambda z, moved: (*inner(z, moved)[:2], 1e-4 * inner(z, moved)[2])
    objective.values = lambda z, keep_first=False: tried.append(z.shape[1]) or values(z)
    found = maximise(objective, np.zeros(3), np.ones(3, dtype=bool), 60, enough=1e-9)
    assert tried[:2] == [8, 8]
    assert not found.stuck
    assert np.allclose(found.z, SUMMIT, atol=1e-3)


def test_a_search_is_given_up_where_twice_what_it_promises_does_not_count():
    start, every = np.zeros(3), np.ones(3, dtype=bool)
    below = float(parabola().values(start[:, None])[0])  # the summit has 0
    reached = maximise(parabola(), start, every, 10, least=-0.5 * below - 0.1)
    assert not reached.hopeless
    assert np.allclose(reached.z, SUMMIT, atol=1e-9)
    given_up = maximise(parabola(), start, every, 10, least=-below + 0.1)
    assert given_up.hopeless
    assert np.array_equal(given_up.z, start)
    assert given_up.value == below


def test_a_step_of_a_variance_stays_within_bounds():
    """Its logarithm goes further down than the step."""
    tried, objective = [], parabola(lower=-2.3)
    inner = objective.values
    objective.values = lambda z, keep_first=False: tried.append(z) or inner(z)
    found = maximise(objective, np.full(3, -1.4), np.ones(3, dtype=bool), 10, variances=np.ones(3, dtype=bool))
    assert min(z.min() for z in tried) >= -2.3
    assert found.z[1] == pytest.approx(-2.0, abs=0.1)
