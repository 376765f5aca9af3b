"""Loops over a recording of a filter's whitened innovations as a linear model of an unknown disturbance.

With the gains ``K``, the whitening ``W`` and the Jacobians ``A, H`` of a finished pass, a disturbance ``d`` that enters
the state by ``B`` and the outputs by ``D`` moves the innovations by the response of

    z(k+1) = A (I - K H) z(k) + (B - A K D) d(k),        r(k) = W H z(k) + W D d(k) + n(k)

with white ``n`` of unit variance. ``F, C`` are the first two matrices, ``g, c`` the columns of ``d``. Rows of missing
measurements are zero in ``C``, ``c`` and ``r``. The first sample is not used. Lanes are eight disturbances, or eight
variances of one.
"""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import LANES, NW, NX, NY, get, log, next_state, output, put, splat
from harness.engine.simd import lanes as plain
from harness.engine.simd.dual import tangent_of, with_tangent
from harness.engine.simd.memory import borrowed, retain
from harness.runner.filter_loop import fill


def tangents(u, between, constants, states, directions, rows, ahead, outputs):
    """Write the derivatives of the next state and of the outputs along eight directions; over dual numbers only.

    Args:
        u: Inputs ``(samples, nu)``.
        between: Inputs during the step behind each sample ``(samples, nu)``.
        constants: Values and derivatives ``(nc, LANES)``.
        states: ``(samples, nx)``.
        directions: Of the state ``(nx, lanes)``.
        rows: States whose derivatives are wanted.
        ahead: Their derivatives at the next sample, written ``(samples, rows, lanes)``.
        outputs: Of the outputs, written ``(samples, ny, lanes)``.
    """
    samples, nu = u.shape
    owned = (
        (np.empty((NX, LANES)), np.empty((NX, LANES)), np.empty((NY, LANES))),
        (np.empty((NW, LANES)), np.empty((nu, LANES))),
    )
    (x, xn, y), (w, u_now) = borrowed(owned)
    u, between, constants, states, rows = borrowed((u, between, constants, states, rows))
    ahead, outputs = borrowed((ahead, outputs))
    for k in range(samples):
        for i in range(NX):
            put(with_tangent(plain.splat(states[k, i]), plain.get(directions, i)), x, i)
        fill(u[k], u_now)
        output(x, u_now, constants, y)
        for a in range(NY):
            plain.put(tangent_of(get(y, a)), outputs, k, a)
        fill(between[k], u_now)
        next_state(x, u_now, constants, xn, w)
        for i in range(len(rows)):
            plain.put(tangent_of(get(xn, rows[i])), ahead, k, i)
    retain(owned)


def respond(F, C, g, c, disturbance, begin, response):
    """Write how eight disturbances ``(samples, LANES)``, zero before a sample, move whitened innovations from there on.

    These are ``(samples, ny, LANES)``.
    """
    samples, n = g.shape
    z, ahead = np.zeros((n, LANES)), np.zeros((n, LANES))
    for k in range(begin, samples):
        d = get(disturbance, k)
        for a in range(c.shape[1]):
            total = c[k, a] * d
            for i in range(n):
                total = total + C[k, a, i] * get(z, i)
            put(total, response, k, a)
        for i in range(n):
            total = g[k, i] * d
            for j in range(n):
                total = total + F[k, i, j] * get(z, j)
            put(total, ahead, i)
        z, ahead = ahead, z


def pull_back(F, C, r, adjoint):
    """Write how much each state before a sample ``(samples, n)`` would explain of all later innovations."""
    samples, n = adjoint.shape
    for k in range(samples - 1, 0, -1):
        for i in range(n):
            total = 0.0
            for a in range(r.shape[1]):
                total += C[k, a, i] * r[k, a]
            if k + 1 < samples:
                for j in range(n):
                    total += F[k, j, i] * adjoint[k + 1, j]
            adjoint[k, i] = total


def track(F, C, g, c, r, decay, variance, gain, notes):
    """Estimate a Gauss-Markov disturbance of eight variances; write what each gains in log-likelihood over none.

    Args:
        F: ``(samples, n, n)``.
        C: ``(samples, ny, n)``.
        g: ``(samples, n)``.
        c: ``(samples, ny)``.
        r: Whitened innovations ``(samples, ny)``.
        decay: Share of the disturbance that is left after a step.
        variance: In the long run ``(1, LANES)``.
        gain: Written ``(1, LANES)``.
        notes: Of the first lane, for ``smooth``: mean of the disturbance before each update ``(samples,)``, its
            covariance with everything ``(samples, n + 1)``, and of every scalar update ``P h`` ``(samples, ny, n + 1)``
            with variance and innovation ``(samples, ny)``; of no samples if nothing is kept.
    """
    samples, n = g.shape
    owned = (
        (np.zeros((n + 1, LANES)), np.zeros((n + 1, LANES)), np.empty((n + 1, LANES))),
        (np.zeros((n + 1, n + 1, LANES)), np.zeros((n, n + 1, LANES)), np.empty((2, LANES))),
    )
    (x, ahead, Ph), (P, T, row) = borrowed(owned)
    F, C, g, c, r, notes = borrowed((F, C, g, c, r, notes))
    mean, covariance, product, spread, surprise = notes
    put(get(variance, 0), P, n, n)
    put(splat(0.0), gain, 0)
    keep = mean.shape[0] > 0
    for k in range(1, samples):
        if keep:
            mean[k] = x[n, 0]
            for i in range(n + 1):
                covariance[k, i] = P[i, n, 0]
        scale, misfit = splat(1.0), splat(0.0)
        for a in range(c.shape[1]):
            S, e = update(C[k, a], c[k, a], r[k, a], x, P, Ph)
            scale = scale * S
            misfit = misfit + (e * e / S - r[k, a] * r[k, a])
            if keep:
                put(S, row, 0)
                put(e, row, 1)
                spread[k, a], surprise[k, a] = row[0, 0], row[1, 0]
                for i in range(n + 1):
                    product[k, a, i] = Ph[i, 0]
        put(get(gain, 0) - 0.5 * (log(scale) + misfit), gain, 0)
        predict(F[k], g[k], decay, (1.0 - decay * decay) * get(variance, 0), x, ahead, P, T)
    retain(owned)


def update(H, h, r, x, P, Ph):
    """Correct by one measurement ``r = H z + h d + n``; return its variance and its innovation."""
    n = H.shape[0]
    for i in range(n + 1):
        total = h * get(P, i, n)
        for j in range(n):
            total = total + H[j] * get(P, i, j)
        put(total, Ph, i)
    S, e = 1.0 + h * get(Ph, n), r - h * get(x, n)
    for j in range(n):
        S = S + H[j] * get(Ph, j)
        e = e - H[j] * get(x, j)
    inverse = 1.0 / S
    for i in range(n + 1):
        share = get(Ph, i) * inverse
        put(get(x, i) + share * e, x, i)
        for j in range(i + 1):
            value = get(P, i, j) - share * get(Ph, j)
            put(value, P, i, j)
            put(value, P, j, i)
    return S, e


def predict(F, g, decay, noise, x, ahead, P, T):
    """Take mean and covariance of ``(z, d)`` one sample ahead."""
    n = g.shape[0]
    for i in range(n):
        total = g[i] * get(x, n)
        for j in range(n):
            total = total + F[i, j] * get(x, j)
        put(total, ahead, i)
        for j in range(n + 1):
            total = g[i] * get(P, n, j)
            for m in range(n):
                total = total + F[i, m] * get(P, m, j)
            put(total, T, i, j)
    put(decay * get(x, n), ahead, n)
    for i in range(n + 1):
        put(get(ahead, i), x, i)
    for i in range(n):
        for j in range(i + 1):
            total = get(T, i, n) * g[j]
            for m in range(n):
                total = total + get(T, i, m) * F[j, m]
            put(total, P, i, j)
            put(total, P, j, i)
        put(decay * get(T, i, n), P, i, n)
        put(decay * get(T, i, n), P, n, i)
    put(decay * decay * get(P, n, n) + noise, P, n, n)


def smooth(F, C, g, c, decay, notes, smoothed, deviation):
    """Write the disturbance given all samples, and its standard deviation, from the notes of ``track``.

    The recursions are those of Bryson and Frazier (1963) in their modified form (Bierman 1973): no inverse is needed.
    """
    samples, n = g.shape
    mean, covariance, product, spread, surprise = notes
    adjoint, information = np.zeros(n + 1), np.zeros((n + 1, n + 1))
    M, h = np.zeros((n + 1, n + 1)), np.empty(n + 1)
    M[n, n] = decay
    for k in range(samples - 1, 0, -1):
        if k + 1 < samples:
            M[:n, :n], M[:n, n] = F[k], g[k]
            adjoint = M.T @ adjoint
            information = M.T @ information @ M
        for a in range(c.shape[1] - 1, -1, -1):
            h[:n], h[n] = C[k, a], c[k, a]
            share = product[k, a] / spread[k, a]
            v = information @ share
            adjoint = adjoint - h * (share @ adjoint + surprise[k, a] / spread[k, a])
            back = share @ v + 1.0 / spread[k, a]
            for i in range(n + 1):
                for j in range(n + 1):
                    information[i, j] += back * h[i] * h[j] - h[i] * v[j] - v[i] * h[j]
        smoothed[k] = mean[k] - covariance[k] @ adjoint
        variance = covariance[k, n] - covariance[k] @ information @ covariance[k]
        deviation[k] = np.sqrt(max(variance, 0.0))
    smoothed[0], deviation[0] = smoothed[1], deviation[1]


def lasso(gram, pull, floor, wanted, sweeps, weights):
    """Follow the lasso downwards from no term at all until ``wanted`` terms are in; write their weights ``(n,)``.

    Minimises ``w'G w / 2 - b'w + penalty |w|_1`` by coordinate descent over the active set for ever smaller penalties,
    each from the solution before (Friedman, Hastie and Tibshirani 2010).

    Args:
        gram: ``G`` with a unit diagonal ``(n, n)``.
        pull: ``b`` ``(n,)``.
        floor: Smallest penalty.
        wanted: Number of terms at which to stop.
        sweeps: Largest number of sweeps per penalty.
        weights: Written.
    """
    n = len(pull)
    slope = pull.copy()
    penalty = np.abs(pull).max()
    while penalty > floor and np.count_nonzero(weights) < wanted:
        penalty = max(0.85 * penalty, floor)
        for sweep in range(sweeps):
            moved = 0.0
            for j in range(n):
                if sweep > 0 and weights[j] == 0.0 and abs(slope[j]) <= penalty:
                    continue
                target = slope[j] + weights[j]
                new = np.sign(target) * max(abs(target) - penalty, 0.0)
                step = new - weights[j]
                if step != 0.0:
                    weights[j] = new
                    slope -= step * gram[j]
                    moved = max(moved, abs(step))
            if moved < 1e-3 * penalty:
                break


PLAIN = (respond, pull_back, update, predict, track, smooth, lasso)
