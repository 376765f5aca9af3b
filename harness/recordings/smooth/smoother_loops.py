"""Loops over the samples of one signal: Kalman filter, smoother, and filters of several intensities side by side.

The state is the signal and its first ``n - 1`` rates; the highest one is a random walk (an integrated Wiener process).
"""

from __future__ import annotations

import numpy as np


def predict(x, P, step, intensity, ahead, P_ahead):
    """Write mean and covariance one sample ahead.

    Args:
        x: ``(n,)`` with n of 2 or 3.
        P: ``(n, n)``.
        step: s.
        intensity: Spectral density of the white noise that drives the highest rate.
        ahead: Written.
        P_ahead: Written.
    """
    n = x.shape[0]
    h, q = step, intensity
    if n == 2:
        ahead[0], ahead[1] = x[0] + h * x[1], x[1]
        a, b, c = P[0, 0], P[0, 1], P[1, 1]
        P_ahead[0, 0] = a + h * (2.0 * b + h * c) + q * h * h * h / 3.0
        P_ahead[0, 1] = P_ahead[1, 0] = b + h * c + q * h * h / 2.0
        P_ahead[1, 1] = c + q * h
        return
    g = 0.5 * h * h
    ahead[0], ahead[1], ahead[2] = x[0] + h * x[1] + g * x[2], x[1] + h * x[2], x[2]
    for j in range(3):  # F P, row by row, then times F'
        P_ahead[0, j] = P[0, j] + h * P[1, j] + g * P[2, j]
        P_ahead[1, j] = P[1, j] + h * P[2, j]
        P_ahead[2, j] = P[2, j]
    for i in range(3):
        P_ahead[i, 0] += h * P_ahead[i, 1] + g * P_ahead[i, 2]
        P_ahead[i, 1] += h * P_ahead[i, 2]
    P_ahead[0, 0] += q * h**5 / 20.0
    P_ahead[0, 1] += q * h**4 / 8.0
    P_ahead[0, 2] += q * h**3 / 6.0
    P_ahead[1, 1] += q * h**3 / 3.0
    P_ahead[1, 2] += q * h**2 / 2.0
    P_ahead[2, 2] += q * h
    for i in range(3):
        for j in range(i):
            P_ahead[i, j] = P_ahead[j, i]


def correct(x, P, y, noise):
    """Correct mean and covariance in place by one sample; return its innovation and the variance of that."""
    n = x.shape[0]
    s, e = P[0, 0] + noise, y - x[0]
    for i in range(1, n):
        gain = P[i, 0] / s
        x[i] += gain * e
        for j in range(1, i + 1):
            P[i, j] -= gain * P[0, j]
            P[j, i] = P[i, j]
    keep = noise / s
    x[0] += (1.0 - keep) * e
    for i in range(n):
        P[0, i] *= keep
        P[i, 0] = P[0, i]
    return e, s


def run_filter(y, noise, intensities, step, first, means, covariances):
    """Run the filter and return what a search for the likeliest noise needs.

    Args:
        y: Samples, NaN where missing ``(samples,)``.
        noise: Variance of each ``(samples,)``.
        intensities: Of the step before each sample ``(samples,)``.
        step: s.
        first: Variances of the first state, whose mean is the first sample at rest ``(n,)``.
        means: Corrected means, written ``(samples, n)``; of no samples if they are not kept.
        covariances: Their covariances, written ``(samples, n, n)``.

    Returns:
        Sum of the squared innovations over their variances, sum of the logarithms of these, and their number; the
        first ``n`` measured samples, which find the state, do not count.
    """
    n, samples = first.shape[0], y.shape[0]
    x, P, ahead, P_ahead = np.zeros(n), np.zeros((n, n)), np.zeros(n), np.zeros((n, n))
    begin = 0
    while np.isnan(y[begin]):
        begin += 1
    x[0] = y[begin]
    for i in range(n):
        P[i, i] = first[i]
    keep = means.shape[0] > 0
    squares, logarithms, count, seen = 0.0, 0.0, 0, 0
    for k in range(samples):
        if k > 0:
            predict(x, P, step, intensities[k], ahead, P_ahead)
            x, ahead = ahead, x
            P, P_ahead = P_ahead, P
        if not np.isnan(y[k]):
            e, s = correct(x, P, y[k], noise[k])
            seen += 1
            if seen > 3:
                squares += e * e / s
                logarithms += np.log(s)
                count += 1
        if keep:
            means[k], covariances[k] = x, P
    return squares, logarithms, count


def run_smoother(intensities, step, means, covariances, lagged):
    """Overwrite the corrected means and covariances by those given all samples (Rauch, Tung and Striebel 1965).

    Written to ``lagged (samples, n, n)`` is the covariance of the errors at a sample with those at the one before.
    """
    samples, n = means.shape
    ahead, P_ahead, G, F = np.zeros(n), np.zeros((n, n)), np.zeros((n, n)), np.eye(n)
    cross, rest, moved = np.zeros((n, n)), np.zeros((n, n)), np.zeros((n, n))
    lagged[0] = 0.0
    for i in range(n - 1):
        F[i, i + 1] = step
    if n == 3:
        F[0, 2] = 0.5 * step * step
    for k in range(samples - 2, -1, -1):
        x, P = means[k], covariances[k]
        predict(x, P, step, intensities[k + 1], ahead, P_ahead)
        for i in range(n):
            for j in range(n):
                cross[i, j] = 0.0
                for m in range(j, n):
                    cross[i, j] += P[i, m] * F[j, m]
        solve(P_ahead, cross, G)
        for i in range(n):
            for j in range(n):
                rest[i, j] = covariances[k + 1, i, j] - P_ahead[i, j]
                lagged[k + 1, i, j] = 0.0
                for m in range(n):
                    lagged[k + 1, i, j] += covariances[k + 1, i, m] * G[j, m]
        for i in range(n):
            for j in range(n):
                moved[i, j] = 0.0
                for m in range(n):
                    moved[i, j] += G[i, m] * rest[m, j]
        for i in range(n):
            for j in range(n):
                x[i] += G[i, j] * (means[k + 1, j] - ahead[j])
            for j in range(i + 1):
                for m in range(n):
                    P[i, j] += moved[i, m] * G[j, m]
                P[j, i] = P[i, j]


def solve(A, B, X):
    """Write ``X = B A^-1`` for a symmetric positive definite A, scaled to a unit diagonal first."""
    n = A.shape[0]
    scale, L = np.empty(n), np.zeros((n, n))
    for i in range(n):
        scale[i] = 1.0 / np.sqrt(A[i, i]) if A[i, i] > 0.0 else 0.0
    for j in range(n):
        for i in range(j, n):
            total = A[i, j] * scale[i] * scale[j]
            for m in range(j):
                total -= L[i, m] * L[j, m]
            if i == j:
                L[j, j] = np.sqrt(max(total, 1e-14))
            else:
                L[i, j] = total / L[j, j]
    z = np.empty(n)
    for r in range(B.shape[0]):
        for i in range(n):
            total = B[r, i] * scale[i]
            for m in range(i):
                total -= L[i, m] * z[m]
            z[i] = total / L[i, i]
        for i in range(n - 1, -1, -1):
            total = z[i]
            for m in range(i + 1, n):
                total -= L[m, i] * X[r, m]
            X[r, i] = total / L[i, i]
        for i in range(n):
            X[r, i] *= scale[i]


def run_modes(y, noise, modes, leave, step, first, chances, means, covariances):
    """Run a filter for each of several intensities, which the signal changes between; return the log-likelihood.

    The interacting multiple model filter (Blom and Bar-Shalom 1988): before every step the filters begin from
    mixtures of each other. Nothing that it writes for a sample depends on a later one.

    Args:
        y: Samples, NaN where missing ``(samples,)``.
        noise: Variance of each ``(samples,)``.
        modes: Intensities ``(m,)``.
        leave: Probability of a change in a step, to any of the others.
        step: s.
        first: Variances of the first state ``(n,)``.
        chances: Probability of each intensity, written ``(samples, m)``.
        means: Mean of the mixture, written ``(samples, n)``; of no samples if it is not kept.
        covariances: Its covariance, written ``(samples, n, n)``.
    """
    n, m, samples = first.shape[0], modes.shape[0], y.shape[0]
    x, P = np.zeros((m, n)), np.zeros((m, n, n))
    mixed, P_mixed = np.zeros((m, n)), np.zeros((m, n, n))
    weight, ahead, total = np.empty(m), np.empty(m), 0.0
    stay, other = 1.0 - leave, leave / (m - 1)
    begin = 0
    while np.isnan(y[begin]):
        begin += 1
    for i in range(m):
        x[i, 0] = y[begin]
        for a in range(n):
            P[i, a, a] = first[a]
    weight[:] = 1.0 / m
    seen = 0
    for k in range(samples):
        if k > 0:
            interact(weight, x, P, stay, other, ahead, mixed, P_mixed)
            for j in range(m):
                predict(mixed[j], P_mixed[j], step, modes[j], x[j], P[j])
                weight[j] = ahead[j]
        if not np.isnan(y[k]):
            seen += 1
            largest = -np.inf
            for j in range(m):
                e, s = correct(x[j], P[j], y[k], noise[k])
                ahead[j] = -0.5 * (e * e / s + np.log(s) + 1.8378770664093453)
                largest = max(largest, ahead[j])
            likely = 0.0
            for j in range(m):
                weight[j] *= np.exp(ahead[j] - largest)
                likely += weight[j]
            for j in range(m):
                weight[j] /= likely
            if seen > 3:
                total += largest + np.log(likely)
        chances[k] = weight
        if means.shape[0] > 0:
            mix(weight, x, P, means[k], covariances[k])
    return total


def interact(weight, x, P, stay, other, ahead, mixed, P_mixed):
    """Write the mixtures that the filters of m modes begin a step from (Blom and Bar-Shalom 1988).

    Args:
        weight: Probability of each mode ``(m,)``.
        x: Means ``(m, n)``.
        P: Covariances ``(m, n, n)``.
        stay: Probability that a mode lasts.
        other: Probability of a change to one of the others.
        ahead: Predicted probabilities, written ``(m,)``.
        mixed: Means of the mixtures, written.
        P_mixed: Their covariances, written.
    """
    m, n = x.shape
    for j in range(m):
        ahead[j] = other + (stay - other) * weight[j]
    for j in range(m):
        for a in range(n):
            mixed[j, a] = 0.0
            for i in range(m):
                mixed[j, a] += (stay if i == j else other) * weight[i] / ahead[j] * x[i, a]
        P_mixed[j] = 0.0
        for i in range(m):
            share = (stay if i == j else other) * weight[i] / ahead[j]
            for a in range(n):
                d = x[i, a] - mixed[j, a]
                for b in range(a + 1):
                    P_mixed[j, a, b] += share * (P[i, a, b] + d * (x[i, b] - mixed[j, b]))
        for a in range(n):
            for b in range(a):
                P_mixed[j, b, a] = P_mixed[j, a, b]


def mix(weight, x, P, mean, covariance):
    """Write mean ``(n,)`` and covariance ``(n, n)`` of a mixture of m normal distributions."""
    mean[:] = 0.0
    covariance[:] = 0.0
    for j in range(weight.shape[0]):
        for a in range(mean.shape[0]):
            mean[a] += weight[j] * x[j, a]
    for j in range(weight.shape[0]):
        for a in range(mean.shape[0]):
            d = x[j, a] - mean[a]
            for b in range(mean.shape[0]):
                covariance[a, b] += weight[j] * (P[j, a, b] + d * (x[j, b] - mean[b]))


def smooth_modes(chances, leave):
    """Overwrite the probabilities of intensities ``(samples, m)`` by those given all samples (Kim 1994)."""
    samples, m = chances.shape
    ahead, stay, other = np.empty(m), 1.0 - leave, leave / (m - 1)
    for k in range(samples - 2, -1, -1):
        back = 0.0
        for j in range(m):
            ahead[j] = chances[k + 1, j] / (other + (stay - other) * chances[k, j])
            back += ahead[j]
        whole = 0.0
        for j in range(m):
            chances[k, j] *= other * back + (stay - other) * ahead[j]
            whole += chances[k, j]
        for j in range(m):
            chances[k, j] /= whole


LOOPS = (predict, correct, run_filter, run_smoother, solve, run_modes, interact, mix, smooth_modes)
