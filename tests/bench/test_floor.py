"""Operations that are counted are those of the algorithm."""

import numpy as np
import pytest
from numba import njit

from bench.floor.counting import counted, counts
from harness.engine.simd import linalg
from harness.engine.simd.functions import sin
from harness.engine.simd.lanes import LANES, any_of, get, put, select, sqrt


@pytest.fixture(autouse=True)
def from_nothing():
    counts.clear()


def test_a_cholesky_factor_takes_what_the_textbook_says():
    n = 6
    a = np.random.default_rng(0).normal(size=(n, n, LANES))
    P = np.einsum("ikl,jkl->ijl", a, a)
    S = np.zeros((n, n, LANES))
    counted(linalg.cholesky)(P, S, n)
    expected = np.moveaxis(np.linalg.cholesky(np.moveaxis(P, -1, 0)), 0, -1)
    np.testing.assert_allclose(S, expected, rtol=1e-10)
    pairs = n * (n - 1) // 2
    assert counts["root"] == n
    assert counts["divide"] == n
    assert counts["multiply-add"] == pairs + sum(j * (n - 1 - j) for j in range(n))  # pivots, then the columns below
    assert counts["multiply"] == n + pairs  # the floors of the pivots, and one for each entry below them


def test_numbers_and_branches_are_those_of_the_compiled_function():
    @njit(error_model="numpy")
    def run(x, y):
        for i in range(x.shape[0]):
            value = get(x, i)
            if any_of(value < 0.0):
                value = select(value < 0.0, sqrt(-value), value)
            put(sin(value) / 3.0 + 1.0 / (2.0 - value), y, i)

    x = np.random.default_rng(1).normal(size=(5, LANES))
    x[0] = abs(x[0])
    compiled, plain = np.empty_like(x), np.empty_like(x)
    run(x, compiled)
    with np.errstate(invalid="ignore"):  # roots of lanes that are not selected
        counted(run)(x, plain)
    np.testing.assert_allclose(plain, compiled, rtol=1e-14)
    assert counts["root"] == 4  # no lane of the first is negative
    assert counts["divide"] == 5  # a division by a number is a product
    assert counts["load"] == counts["store"] == 5


def test_a_product_is_taken_up_once():
    @njit(error_model="numpy")
    def run(x):
        product = get(x, 0) * get(x, 1)
        put(product + 1.0, x, 2)
        put(product + 2.0, x, 3)

    counted(run)(np.ones((4, LANES)))
    assert counts["multiply-add"] == 1
    assert counts["multiply"] == 0
    assert counts["add"] == 1
