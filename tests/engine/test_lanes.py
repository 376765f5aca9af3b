"""Lanes: arithmetic, masks and elementary functions against NumPy, and independence of the lanes."""

import numpy as np
import pytest
from numba import njit

from harness.engine.simd import functions
from harness.engine.simd.lanes import LANES, any_of, get, is_nan, put, select, splat, sqrt

RANGES = {
    "sin": (-50.0, 50.0, 4e-16, 0.0),
    "cos": (-50.0, 50.0, 4e-16, 0.0),
    "tan": (-1.5, 1.5, 0.0, 1e-15),
    "atan": (-30.0, 30.0, 4e-16, 4e-16),
    "exp": (-50.0, 50.0, 0.0, 6e-16),
    "log": (1e-12, 1e6, 2e-16, 5e-16),
    "tanh": (-30.0, 30.0, 0.0, 6e-16),
}


def apply(function, values):
    """Run a lane function over an array of any length."""

    @njit(error_model="numpy")
    def kernel(a, out):
        for i in range(a.shape[0]):
            put(function(get(a, i)), out, i)

    padded = np.resize(np.asarray(values, dtype=float), (-(-len(values) // LANES), LANES))
    out = np.empty_like(padded)
    kernel(padded, out)
    return out.ravel()[: len(values)]


@pytest.mark.parametrize("name", RANGES)
def test_functions_match_numpy(name):
    low, high, absolute, relative = RANGES[name]
    x = np.concatenate([np.linspace(low, high, 20001), np.random.default_rng(1).uniform(low, high, 20000)])
    reference = getattr(np, {"atan": "arctan"}.get(name, name))(x)
    got = apply(getattr(functions, name), x)
    assert np.all(np.abs(got - reference) <= absolute + relative * np.abs(reference) + 1e-300)


def test_special_values():
    assert np.array_equal(apply(functions.exp, [-800.0, 800.0, 0.0]), [0.0, np.inf, 1.0])
    assert np.isnan(apply(functions.exp, [np.nan])).all()
    log = apply(functions.log, [0.0, -1.0, 1.0])
    assert log[0] == -np.inf
    assert np.isnan(log[1])
    assert log[2] == 0.0
    assert np.array_equal(apply(functions.sign, [-2.0, 0.0, 3.0]), [-1.0, 0.0, 1.0])
    assert np.array_equal(apply(functions.atan, [0.0, np.inf, -np.inf]), [0.0, np.pi / 2, -np.pi / 2])


@njit(error_model="numpy")
def _arithmetic(a, out):
    x, y = get(a, 0), get(a, 1)
    put(x + 2 * y - 1.0, out, 0)
    put(3.0 / x - x / y, out, 1)
    put(select((x > y) & (x > 0.0) | ~(y < 2.0), -x, splat(7.0)), out, 2)
    put(sqrt(x * x), out, 3)
    put(select(is_nan(x), 1.0, 0.0), out, 4)
    return any_of(is_nan(x)), any_of(x > 1e9)


def test_arithmetic_matches_numpy():
    a = np.random.default_rng(0).normal(size=(2, LANES))
    out = np.empty((5, LANES))
    assert _arithmetic(a, out) == (False, False)
    x, y = a
    np.testing.assert_allclose(out[0], x + 2 * y - 1, rtol=1e-15, atol=1e-15)
    np.testing.assert_allclose(out[1], 3 / x - x / y, rtol=1e-14)
    np.testing.assert_array_equal(out[2], np.where((x > y) & (x > 0) | ~(y < 2), -x, 7.0))
    np.testing.assert_allclose(out[3], np.abs(x))


def test_lanes_do_not_touch_each_other():
    a = np.random.default_rng(3).normal(size=(2, LANES))
    clean, mixed = np.empty((5, LANES)), np.empty((5, LANES))
    _arithmetic(a, clean)
    a[:, 3] = np.nan
    assert _arithmetic(a, mixed)[0]
    keep = np.arange(LANES) != 3
    np.testing.assert_array_equal(clean[:, keep], mixed[:, keep])
    assert mixed[4].tolist() == [1.0 if i == 3 else 0.0 for i in range(LANES)]


def test_indexing_reads_the_named_row():
    @njit
    def kernel(a, out):
        put(get(a, 1, 2), out, 0)

    a = np.arange(3 * 4 * LANES, dtype=float).reshape(3, 4, LANES)
    out = np.empty((1, LANES))
    kernel(a, out)
    np.testing.assert_array_equal(out[0], a[1, 2])
