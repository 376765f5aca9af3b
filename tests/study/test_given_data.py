"""Shares of factors in the variance of functions with known Shapley effects, independent and correlated."""

from __future__ import annotations

import itertools
import math

import numpy as np
import pytest
from scipy.special import ndtr, ndtri

from harness.study.design import scrambled_points
from harness.study.given_data import shares

REPEATS = 500
SINGLE = [(0,), (1,), (2,)]
DEPENDENT = np.array([[1.0, 0.5, 0.0], [0.5, 1.0, -0.3], [0.0, -0.3, 1.0]])
NODES, WEIGHTS = np.polynomial.hermite_e.hermegauss(120)
WEIGHTS = WEIGHTS / WEIGHTS.sum()


def linear(scores):
    return scores @ np.array([1.0, 2.0, 0.5])


def ishigami(scores):
    """Ishigami's function of a normal, a lognormal and a uniform factor."""
    first, second, third = np.moveaxis(scores, -1, 0)
    return np.sin(first) * _third(third) + _second(second)


def _second(score):
    return 7.0 * np.sin(np.exp(0.3 * score)) ** 2


def _third(score):
    return 1.0 + 0.1 * (np.pi * (2.0 * ndtr(score) - 1.0)) ** 4


def g_function(scores):
    """Sobol's g-function of three lognormal factors."""
    return np.prod([_g(scores[..., i], a) for i, a in enumerate((0.0, 1.0, 4.5))], axis=0)


def _g(score, a):
    return (np.sqrt(0.01 + (4.0 * np.exp(0.3 * score - 0.2) - 2.0) ** 2) + a) / (1.0 + a)  # its kink is rounded


def of_linear(correlation):
    """Variances of the conditional expectations of the linear function (Owen and Prieur 2017, theorem 2)."""
    slopes = np.array([1.0, 2.0, 0.5])

    def closed(known):
        across = correlation[:, known]
        inner = np.linalg.inv(correlation[np.ix_(known, known)])
        return float(slopes @ across @ inner @ across.T @ slopes)

    return {s: closed(list(s)) if s else 0.0 for s in subsets()}


def of_ishigami(correlation):
    """Those of Ishigami's function, its first and third factor correlated, by quadrature."""
    rho = correlation[0, 2]
    x, w = NODES, WEIGHTS

    def variance(values, weights):
        return float(weights @ values**2 - (weights @ values) ** 2)

    spread = 1.0 - rho**2
    inner = rho * x[:, None] + math.sqrt(spread) * x[None]
    by = {
        (0,): variance(np.sin(x) * (_third(inner) @ w), w),
        (1,): variance(_second(x), w),
        (2,): variance(_third(x) * np.sin(rho * x) * math.exp(-spread / 2.0), w),
        (0, 2): variance((np.sin(x)[:, None] * _third(inner)).ravel(), np.outer(w, w).ravel()),
    }
    return by | {(): 0.0, (0, 1): by[0,] + by[1,], (1, 2): by[1,] + by[2,], (0, 1, 2): by[0, 2] + by[1,]}


def of_g_function(_):
    moments = [(float(WEIGHTS @ _g(NODES, a)), float(WEIGHTS @ _g(NODES, a) ** 2)) for a in (0.0, 1.0, 4.5)]
    mean = math.prod(m for m, _ in moments)
    return {s: mean**2 * (math.prod(moments[i][1] / moments[i][0] ** 2 for i in s) - 1.0) for s in subsets()}


def subsets():
    return [s for k in range(4) for s in itertools.combinations(range(3), k)]


def known(closed):
    """First-order, total and Shapley shares by the variances of all sets of factors."""
    whole = closed[0, 1, 2]
    effects = [
        sum(
            (closed[tuple(sorted((*order[: order.index(i)], i)))] - closed[tuple(sorted(order[: order.index(i)]))])
            / 6.0
            for order in itertools.permutations(range(3))
        )
        for i in range(3)
    ]
    rest = [closed[tuple(j for j in range(3) if j != i)] for i in range(3)]
    numbers = {"first": [closed[i,] for i in range(3)], "total": [whole - r for r in rest], "shapley": effects}
    return {kind: np.array(values) / whole for kind, values in numbers.items()}


PULLED = np.array([[1.0, 0.0, 0.6], [0.0, 1.0, 0.0], [0.6, 0.0, 1.0]])
CASES = {
    "linear, correlated": (linear, of_linear, DEPENDENT, 16),
    "Ishigami": (ishigami, of_ishigami, np.eye(3), 64),
    "Ishigami, correlated": (ishigami, of_ishigami, PULLED, 64),
    "g-function, lognormal": (g_function, of_g_function, np.eye(3), 64),
}


def drawn(case, seed, scramblings=8, noise=0.0):
    function, closed, correlation, size = CASES[case]
    unit = np.stack([scrambled_points(size, 3, (seed, k)) for k in range(scramblings)])
    scores = ndtri(np.clip(unit, 2.0**-31, 1 - 2.0**-31)) @ np.linalg.cholesky(correlation).T
    outcome = function(scores)
    if noise:
        outcome = outcome + noise * outcome.std() * np.random.default_rng(seed).standard_normal(outcome.shape)
    return shares(scores, outcome, correlation, SINGLE), known(closed(correlation))


@pytest.mark.parametrize("case", CASES)
def test_shares_of_functions_with_known_ones(case):
    estimated, true = drawn(case, seed=1)
    for kind, values in true.items():
        np.testing.assert_allclose([s.value for s in getattr(estimated, kind)], values, atol=0.04)
    assert sum(s.value for s in estimated.shapley) == pytest.approx(estimated.explained.value)
    assert estimated.explained.value == pytest.approx(1.0, abs=0.02)
    assert estimated.order[0] == np.argmax(true["shapley"])


def test_noise_is_not_explained():
    estimated, true = drawn("Ishigami", seed=2, noise=0.5)
    assert estimated.explained.value == pytest.approx(0.8, abs=0.05)
    np.testing.assert_allclose([s.value for s in estimated.shapley], 0.8 * true["shapley"], atol=0.06)


def test_groups_have_the_closed_and_total_shares_of_their_factors():
    closed = of_linear(DEPENDENT)
    unit = np.stack([scrambled_points(32, 3, (3, k)) for k in range(8)])
    scores = ndtri(unit) @ np.linalg.cholesky(DEPENDENT).T
    estimated = shares(scores, linear(scores), DEPENDENT, [(0, 2), (1,)])
    whole = closed[0, 1, 2]
    first, total = closed[0, 2] / whole, 1.0 - closed[1,] / whole
    assert estimated.first[0].value == pytest.approx(first, abs=0.04)
    assert estimated.total[0].value == pytest.approx(total, abs=0.04)
    assert estimated.shapley[0].value == pytest.approx((first + total) / 2.0, abs=0.04)


def test_nothing_is_said_of_what_does_not_vary_or_of_few_points():
    scores = np.random.default_rng(0).standard_normal((8, 16, 2))
    assert shares(scores, np.ones((8, 16)), np.eye(2), [(0,), (1,)]) is None
    assert shares(scores[:, :4], scores[:, :4, 0], np.eye(2), [(0,), (1,)]) is None


@pytest.mark.proof
@pytest.mark.parametrize("case", CASES)
def test_intervals_hold_the_known_share_as_often_as_they_say(case):
    held = {kind: [] for kind in ("first", "total", "shapley")}
    for seed in range(REPEATS):
        estimated, true = drawn(case, seed)
        for kind, values in true.items():
            pairs = zip(getattr(estimated, kind), values, strict=True)
            held[kind].append([s.lower <= value <= s.upper for s, value in pairs])
    print(case, {kind: np.mean(rows, axis=0).round(3).tolist() for kind, rows in held.items()})
    for kind in ("first", "shapley"):
        assert 0.93 <= np.mean(held[kind]) <= 0.97


PAIRED = np.kron(np.eye(5), np.array([[1.0, 0.7], [0.7, 1.0]]))
SLOPES = np.array([3.0, 1.0, 2.0, 2.0, 1.0, 0.5, 0.0, 1.0, 0.5, 0.5])


def of_pairs(seed):
    """Shares of a linear function of five correlated pairs, and its effects (Owen and Prieur 2017, section 4)."""
    first, second = SLOPES[::2], SLOPES[1::2]
    both, shared = 0.7 * first * second, 0.7**2 * (second**2 - first**2) / 2.0
    true = np.stack([first**2 + both + shared, second**2 + both - shared], axis=1).ravel() / (SLOPES @ PAIRED @ SLOPES)
    unit = np.stack([scrambled_points(64, 10, (seed, k)) for k in range(8)])
    scores = ndtri(np.clip(unit, 2.0**-31, 1 - 2.0**-31)) @ np.linalg.cholesky(PAIRED).T
    estimated = shares(scores, scores @ SLOPES, PAIRED, [(i,) for i in range(10)])
    inside = [share.lower <= value <= share.upper for share, value in zip(estimated.shapley, true, strict=True)]
    return estimated, true, inside


def test_more_factors_than_there_are_orders_for():
    estimated, true, inside = of_pairs(5)
    values = np.array([share.value for share in estimated.shapley])
    np.testing.assert_allclose(values, true, atol=0.03)
    assert values.sum() == pytest.approx(estimated.explained.value)
    assert sum(inside) >= 8
    assert max(share.upper - share.lower for share in estimated.shapley) < 0.15


@pytest.mark.proof
def test_intervals_from_orders_at_random_hold_the_effects_as_often_as_they_say():
    held = np.mean([of_pairs(seed)[2] for seed in range(60)])
    print(f"ten factors: {held:.3f}")
    assert 0.92 <= held <= 0.98
