"""Covariances through a linearised step and a correction by given gains, lane by lane; pasted behind a model's kernels.

Jacobians and gains are plain numbers, the same in all lanes; covariances and their derivatives differ.
"""

from __future__ import annotations

from harness.engine.kernel_names import NY, get, put, splat


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
