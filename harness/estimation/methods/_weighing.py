"""Weigh particles by a measurement and sum them up: likelihood, innovation, weights, mean."""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import (
    NX,
    NY,
    cholesky,
    exp,
    get,
    log,
    mahalanobis,
    maximum,
    put,
    select,
    splat,
)


def measure(y, r, outputs, products):
    """Write measurements and half precisions, zero where missing, and zero sums; return the likelihood's constant.

    Args:
        y: Measurements, NaN where missing ``(ny, LANES)``.
        r: Their variances ``(ny, LANES)``.
        outputs: Rows written for ``weigh``: 2 sum of predictions, 3 measurements, 4 half precisions.
        products: Sum of the products of predictions, written ``(ny, ny, LANES)``.
    """
    constant = splat(0.0)
    for a in range(NY):
        seen = get(y, a) == get(y, a)
        variance = get(r, a)
        put(0.0, outputs, 2, a)
        put(select(seen, get(y, a), 0.0), outputs, 3, a)
        put(select(seen, 0.5 / variance, 0.0), outputs, 4, a)
        constant = constant - select(seen, 0.5 * (log(variance) + 1.8378770664093453), 0.0)
        for b in range(NY):
            put(0.0, products, a, b)
    return constant


def weigh(first, log_weight, weight, outputs, products):
    """Return a particle's log-weight after the measurement (2.61); add its predicted measurement to the sums.

    Args:
        first: Whether it is the first particle, about whose prediction the sums are taken so that no digits are lost.
        log_weight: Before the measurement.
        weight: The same, not as a logarithm.
        outputs: Rows: 0 its predicted measurement, 1 that of the first particle, others as ``measure`` left them.
        products: Sum of the products ``(ny, ny, LANES)``.
    """
    for a in range(NY):
        if first:
            put(get(outputs, 0, a), outputs, 1, a)
        rest = get(outputs, 3, a) - get(outputs, 0, a)
        log_weight = log_weight - rest * rest * get(outputs, 4, a)
        away = get(outputs, 0, a) - get(outputs, 1, a)
        put(get(outputs, 2, a) + weight * away, outputs, 2, a)
        for b in range(a + 1):
            other = get(outputs, 0, b) - get(outputs, 1, b)
            put(get(products, a, b) + weight * away * other, products, a, b)
    return log_weight


def describe(y, r, total, outputs, products, factor, info):
    """Write innovation, its covariance and the NIS from the particles' predicted measurements.

    Args:
        y: Measurements.
        r: Their variances.
        total: Sum of the weights before the measurement.
        outputs: As ``weigh`` left them; rows 0 and 3 are overwritten.
        products: The same; overwritten.
        factor: Scratch ``(ny, ny, LANES)``.
        info: Written but for likelihood and repairs.

    Returns:
        Lanes whose innovation covariance had to be repaired (1 or 0).
    """
    scratch, innovation = outputs[0], outputs[3]
    inverse = 1.0 / total
    seen = splat(0.0)
    for a in range(NY):
        seen_a = get(y, a) == get(y, a)
        mean_a = get(outputs, 2, a) * inverse
        rest = get(y, a) - get(outputs, 1, a) - mean_a
        put(rest, info.innovation, a)
        put(select(seen_a, rest, 0.0), innovation, a)
        seen = seen + select(seen_a, 1.0, 0.0)
        for b in range(a + 1):
            value = get(products, a, b) * inverse - mean_a * (get(outputs, 2, b) * inverse)
            if a == b:
                value = value + get(r, a)
            put(value, info.innovation_covariance, a, b)
            put(value, info.innovation_covariance, b, a)
            # a missing measurement gets a unit variance of its own and an innovation of zero
            value = select(seen_a & (get(y, b) == get(y, b)), value, 1.0 if a == b else 0.0)
            put(value, products, a, b)
            put(value, products, b, a)
    repaired = cholesky(products, factor, NY)
    put(mahalanobis(factor, innovation, scratch, NY), info.nis, 0)
    put(seen, info.seen, 0)
    return repaired


def sum_up(cloud, log_weights, weights, best, mean):
    """Write weights and mean of the particles; return the sums of the weights and of their squares.

    Args:
        cloud: Particles ``(N, nx, LANES)``.
        log_weights: ``(N, LANES)``.
        weights: Written ``(N, LANES)``.
        best: The largest log-weight; its particle gets the weight 1.
        mean: Written ``(nx, LANES)``.
    """
    total, squares = splat(0.0), splat(0.0)
    for i in range(NX):
        put(0.0, mean, i)
    for n in range(cloud.shape[0]):
        weight = exp(get(log_weights, n) - best)
        put(weight, weights, n)
        total, squares = total + weight, squares + weight * weight
        for i in range(NX):
            put(get(mean, i) + weight * get(cloud, n, i), mean, i)
    inverse = 1.0 / total
    for i in range(NX):
        put(get(mean, i) * inverse, mean, i)
    return total, squares


def finite(values):
    """Return the mask of lanes in which every entry is a finite number."""
    total = splat(0.0)
    for i in range(values.shape[0]):
        total = total + 0.0 * get(values, i)
    return total == 0.0


def drop_broken(cloud, log_weights):
    """Take away the weight of particles that are not finite; return the largest log-weight left."""
    best = splat(-np.inf)
    for n in range(cloud.shape[0]):
        good = finite(cloud[n])
        for i in range(NX):
            put(select(good, get(cloud, n, i), 0.0), cloud, n, i)
        value = get(log_weights, n)
        value = select(good & (value == value), value, -np.inf)
        put(value, log_weights, n)
        best = maximum(best, value)
    return best
