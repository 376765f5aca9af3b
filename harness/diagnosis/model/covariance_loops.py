"""Loops behind the derivatives of the likelihood to noise variances (``noise_slopes``), and what they are made of.

Covariances through a linearised step and a correction by given gains, lane by lane; pasted behind a model's kernels.

Jacobians and gains are plain numbers, the same in all lanes; covariances and their derivatives differ.
"""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import LANES, NW, NX, NY, get, next_jacobian, output_jacobian, put, splat
from harness.engine.simd.memory import borrowed, retain


def congruence(A, columns, P, T, product):
    """Write ``A P A'``; ``columns`` of each row of ``A`` may differ from zero, then -1 ``(n, n + 1)``."""
    n = A.shape[0]
    for i in range(n):
        for j in range(n):
            total = splat(0.0)
            for q in range(n):
                c = columns[i, q]
                if c < 0:
                    break
                total = total + A[i, c] * get(P, c, j)
            put(total, T, i, j)
    for i in range(n):
        for j in range(i + 1):
            total = splat(0.0)
            for q in range(n):
                c = columns[j, q]
                if c < 0:
                    break
                total = total + get(T, i, c) * A[j, c]
            put(total, product, i, j)
            put(total, product, j, i)


def correct(K, corrected, P_prior, V, S, W, P):
    """Write the covariance behind a correction by gains that need not be the best, symmetric.

    The error is that of the prediction less ``K e``, so it is ``P - K V' - V K' + K S K'`` (Simon 2006, 3.3) with the
    covariance ``V`` of state and innovation ``e`` and that of the innovations. Gains of missing measurements are zero.

    Args:
        K: Gains ``(n, ny)``, zero in the states that the filter does not correct.
        corrected: How many states it corrects.
        P_prior: ``(n, n, LANES)``.
        V: ``(n, ny, LANES)``.
        S: ``(ny, ny, LANES)``.
        W: Scratch ``(n, ny, LANES)``.
        P: Written ``(n, n, LANES)``.
    """
    n = K.shape[0]
    for i in range(n):
        for a in range(NY):
            total = splat(0.0)
            for b in range(NY if i < corrected else 0):
                total = total + 0.5 * K[i, b] * get(S, a, b)
            put(total - get(V, i, a), W, i, a)  # half of K S, so that both sides of the sum are alike
    for i in range(n):
        for j in range(i + 1):
            total = get(P_prior, i, j)
            for a in range(NY if j < corrected else 0):
                total = total + get(W, i, a) * K[j, a]
            for a in range(NY if i < corrected else 0):
                total = total + K[i, a] * get(W, j, a)
            put(total, P, i, j)
            put(total, P, j, i)


def linearise(u, between, constants, x, ahead, outputs):
    """Write the Jacobians of the next state and of the outputs along a pass. Lanes are samples.

    Args:
        u: Inputs ``(blocks, nu, LANES)``.
        between: The same during the step behind each sample.
        constants: The same in all lanes ``(nc, LANES)``.
        x: States ``(blocks, nx, LANES)``.
        ahead: Written ``(blocks, nx, nx, LANES)``.
        outputs: Written ``(blocks, ny, nx, LANES)``.
    """
    owned = (np.empty((NX, LANES)), np.empty((NY, LANES)), np.empty((NW, LANES)))
    xn, y, w = borrowed(owned)
    u, between, x, ahead, outputs = borrowed((u, between, x, ahead, outputs))
    for b in range(x.shape[0]):
        next_jacobian(x[b], between[b], constants, xn, ahead[b], w)
        output_jacobian(x[b], u[b], constants, y, outputs[b])
    retain(owned)


def vary_noise(linear, columns, gain, whitening, whitened, directions, rows):
    """Write the derivatives of a filter's innovations and of their covariance along some directions of its noise.

    All numbers are of single precision, whose seven digits are more than a step of a fit needs of its slopes.

    With ``W' W`` the inverse of the innovations' covariance ``S``, the derivatives ``de`` and ``dS`` of a sample are
    written whitened: ``W de``, then the lower triangle of ``G = W dS W'``, its diagonal over the root of 2. With
    ``r = W e`` the gradient of the log-likelihood is ``(r' G r - tr G) / 2 - r' W de``, and what the sample tells of
    two directions ``tr(G_i G_j) / 2 + (W de_i)' (W de_j)``. What is differentiated is the covariance behind a
    correction (Simon 2006, 3.3), which to first order does not change with gains that are the best.

    Args:
        linear: Jacobians of the next state ``(samples, nx, nx)`` and of the outputs ``(samples, ny, nx)``.
        columns: Those of either that may differ from zero, row by row, then -1 ``(nx, nx + 1)`` and ``(ny, nx + 1)``.
        gain: Of the pass ``(samples, nx, ny)``, zero for missing measurements.
        whitening: ``W (samples, ny, ny)``, zero in rows and columns of missing measurements.
        whitened: ``r (samples, ny)``, zero for missing measurements.
        directions: Derivatives of the variances of process noise per step ``(nx, LANES)``, of measurement noise
            ``(ny, LANES)`` and of the first state ``(nx, LANES)``.
        rows: Written ``(samples, ny + ny (ny + 1) / 2, LANES)``; the first sample is not used.
    """
    means, innovation = np.zeros((2, NX, LANES), np.float32), np.empty((NY, LANES), np.float32)
    squares, seen_by = np.zeros((3, NX, NX, LANES), np.float32), np.empty((2, NX, NY, LANES), np.float32)
    of_innovation, weighted = np.empty((2, NY, NY, LANES), np.float32), np.empty(NY, np.float32)
    owned = (
        (means[0], means[1], innovation),
        (squares[0], squares[1], squares[2]),
        (seen_by[0], seen_by[1], of_innovation[0], of_innovation[1]),
        weighted,
    )
    (x, x_prior, e), (P, P_prior, T), (V, W, S, U), pull = borrowed(owned)
    (A, H), (moving, seen), (Q, R, first), rows = borrowed((linear, columns, directions, rows))
    for i in range(NX):
        put(get(first, i), P, i, i)
    for k in range(1, gain.shape[0]):
        times(A[k - 1], moving, x, x_prior)
        congruence(A[k - 1], moving, P, T, P_prior)
        for i in range(NX):
            put(get(P_prior, i, i) + get(Q, i), P_prior, i, i)
        times(H[k], seen, x_prior, e)
        for i in range(NX):
            times(H[k], seen, P_prior[i], V[i])
        for a in range(NY):
            for b in range(a + 1):
                total = get(R, a) if a == b else splat(0.0)
                for q in range(NX):
                    j = seen[a, q]
                    if j < 0:
                        break
                    total = total + H[k, a, j] * get(V, j, b)
                put(total, S, a, b)
                put(total, S, b, a)
        keep(whitening[k], e, S, U, rows[k])
        for a in range(NY):  # the innovation over its covariance
            pull[a] = 0.0
            for b in range(a, NY):
                pull[a] += whitening[k, b, a] * whitened[k, b]
        correct(gain[k], NX, P_prior, V, S, W, P)
        for i in range(NX):
            total = get(x_prior, i)
            for a in range(NY):
                rest = splat(0.0)
                for b in range(NY):
                    rest = rest + pull[b] * get(S, a, b)
                total = total + pull[a] * get(V, i, a) - gain[k, i, a] * (get(e, a) + rest)
            put(total, x, i)
    retain(owned)


def times(A, columns, x, product):
    """Write ``A x``; ``columns`` of each row of ``A`` may differ from zero, then -1."""
    for i in range(A.shape[0]):
        total = splat(0.0)
        for q in range(A.shape[1]):
            j = columns[i, q]
            if j < 0:
                break
            total = total + A[i, j] * get(x, j)
        put(total, product, i)


def keep(whitening, e, S, U, rows):
    """Write the rows of a sample; ``-e`` is the derivative of the innovation, ``S`` that of its covariance."""
    row = NY
    for a in range(NY):
        total = splat(0.0)
        for c in range(a + 1):
            total = total - whitening[a, c] * get(e, c)
        put(total, rows, a)
        for b in range(a + 1):
            total = splat(0.0)
            for c in range(a + 1):
                total = total + whitening[a, c] * get(S, c, b)
            put(total, U, a, b)
        for b in range(a + 1):
            total = splat(0.0)
            for c in range(b + 1):
                total = total + get(U, a, c) * whitening[b, c]
            put(0.7071067811865476 * total if a == b else total, rows, row)
            row += 1
