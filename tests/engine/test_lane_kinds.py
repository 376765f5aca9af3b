"""Kernels over lanes of another kind than the plain ones."""

import numpy as np

from harness.engine.compile import SINGLES, load_source, over_singles
from harness.engine.kernel_source import kernel_source
from harness.engine.simd.lanes import LANES, get, put, select, sqrt


def blend(weights, a, found):
    """Write a weighted sum of two rows and the root of the larger of both."""
    scratch = np.zeros((1, LANES), np.float32)
    put(weights[0] * get(a, 0) + weights[1] * get(a, 1), scratch, 0)
    put(get(scratch, 0), found, 0)
    put(sqrt(select(get(a, 0) > get(a, 1), get(a, 0), get(a, 1))), found, 1)


def test_singles_are_twice_as_many_of_seven_digits():
    run = load_source("blend", over_singles(kernel_source("blend", [blend]))).blend
    a = np.random.default_rng(3).uniform(0.5, 2.0, (2, SINGLES)).astype(np.float32)
    weights = np.array([0.3, -1.7], np.float32)
    found = np.empty((2, SINGLES), np.float32)
    run(weights, a, found)
    assert SINGLES == 2 * LANES
    exact = np.stack([weights.astype(float) @ a.astype(float), np.sqrt(a.max(axis=0).astype(float))])
    assert np.abs(found - exact).max() < 5e-7
    assert np.abs(found - exact).max() > 0.0  # no double
