"""Sums over sigma points as a card computes them best: point by point, with all sums in registers.

A processor has few registers and reads points again and again from its first cache; a card has many and no such cache.
Each sum has its terms in the order of ``harness.engine.simd.linalg``.
"""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import LANES, NX, NY, get, put, splat


def sigma_mean(images, w0m, wi, mean, n):
    """Write the weighted mean of sigma points; see ``harness.engine.simd.linalg.sigma_mean``."""
    total = np.empty((max(NX, NY), LANES))
    for i in range(n):
        put(splat(0.0), total, i)
    for s in range(1, images.shape[0]):
        for i in range(n):
            put(get(total, i) + get(images, s, i), total, i)
    for i in range(n):
        put(w0m * get(images, 0, i) + wi * get(total, i), mean, i)


def outer_sum(rows, w0, w, noise, covariance, n):
    """Write a weighted sum of outer products; see ``harness.engine.simd.linalg.outer_sum``."""
    total = np.empty((max(NX, NY), max(NX, NY), LANES))
    for i in range(n):
        for j in range(i + 1):
            put(splat(0.0), total, i, j)
    for s in range(1, rows.shape[0]):
        for i in range(n):
            for j in range(i + 1):
                put(get(total, i, j) + get(rows, s, i) * get(rows, s, j), total, i, j)
    for i in range(n):
        for j in range(i + 1):
            value = w * get(total, i, j) + w0 * get(rows, 0, i) * get(rows, 0, j)
            if i == j:
                value = value + get(noise, i)
            put(value, covariance, i, j)
            put(value, covariance, j, i)
