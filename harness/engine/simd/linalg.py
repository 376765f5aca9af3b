"""Linear algebra of small symmetric matrices over lanes, shared by the estimators."""

from __future__ import annotations

from numba import njit

from harness.engine.simd.functions import log
from harness.engine.simd.lanes import get, put, select, splat, sqrt

_jit = njit(error_model="numpy", cache=False, no_cfunc_wrapper=True)
_inlined = njit(error_model="numpy", cache=False, no_cfunc_wrapper=True, inline="always")
"""For what one place calls: there the compiler knows the sizes of its arrays, and addresses are constants."""

RELATIVE_FLOOR = 1e-13
"""A Cholesky pivot below this share of its diagonal entry is replaced by that share, and the repair counted."""


@_jit
def cholesky(P, S, n):
    """Write the lower Cholesky factor of ``P (n, n, LANES)`` to ``S`` and return the lanes repaired (1 or 0).

    Policy when a factor fails: a pivot that rounding made non-positive (or smaller than ``RELATIVE_FLOOR`` of
    its diagonal entry) is raised to that floor, which adds the least variance that makes the matrix positive
    definite in working precision. A zero diagonal entry gives a zero column and is no repair.
    """
    repaired = splat(0.0)
    for j in range(n):
        diagonal = get(P, j, j)
        pivot = diagonal
        for k in range(j):
            v = get(S, j, k)
            pivot = pivot - v * v
        floor = RELATIVE_FLOOR * diagonal
        broken = pivot < floor
        repaired = select(broken, 1.0, repaired)
        root = sqrt(select(broken, floor, pivot))
        inverse = select(root > 0.0, 1.0 / root, 0.0)
        put(root, S, j, j)
        for i in range(j + 1, n):
            total = get(P, i, j)
            for k in range(j):
                total = total - get(S, i, k) * get(S, j, k)
            put(total * inverse, S, i, j)
    return repaired


@_jit
def mahalanobis(S, error, scratch, n):
    """Return ``error' (S S')^-1 error`` for a lower factor ``S``, by forward substitution."""
    total = splat(0.0)
    for i in range(n):
        value = get(error, i)
        for k in range(i):
            value = value - get(S, i, k) * get(scratch, k)
        value = value / get(S, i, i)
        put(value, scratch, i)
        total = total + value * value
    return total


@_inlined
def scalar_updates(x_prior, P_prior, predicted, H, seen, y, r, x, P, work, info):
    """Correct a prior with independent measurements one at a time, in Joseph form (Ziaukas 2.14 to 2.16).

    Measurements with diagonal noise may be processed one after another with the same result as all at once;
    each needs one division and no matrix inverse. A NaN measurement changes nothing.

    Args:
        x_prior: Predicted state ``(nx, LANES)``.
        P_prior: Predicted covariance ``(nx, nx, LANES)``.
        predicted: Predicted measurements ``(ny, LANES)``.
        H: Output Jacobian at the prediction ``(ny, nx, LANES)``.
        seen: Columns of it that may differ from zero, row by row, then -1 ``(ny, nx)``. Most sensors see one state, and
            products with zeros would be most of the work.
        y: Measurements ``(ny, LANES)``.
        r: Measurement variances ``(ny, LANES)``.
        x: Corrected state, written.
        P: Corrected covariance, written, symmetric.
        work: Scratch ``(2 nx, LANES)``.
        info: ``harness.engine.kernel_names.Info``, written but for ``repairs``.
    """
    n, m = x.shape[0], y.shape[0]
    gain, slope = work[:n], work[n : 2 * n]
    _innovations(P_prior, predicted, H, seen, y, r, slope, info)
    nis, log_likelihood, count = splat(0.0), splat(0.0), splat(0.0)
    for i in range(n):
        put(get(x_prior, i), x, i)
        for j in range(n if m == 0 else 0):  # else the first measurement brings it over
            put(get(P_prior, i, j), P, i, j)
    P_before = P_prior
    for a in range(m):
        measured = get(y, a) == get(y, a)
        s = get(r, a)
        rest = get(y, a) - get(predicted, a)
        _times_row(P_before, H, seen, a, slope)
        for c in range(seen.shape[1]):
            j = seen[a, c]
            if j < 0:
                break
            s = s + get(H, a, j) * get(slope, j)
            rest = rest - get(H, a, j) * (get(x, j) - get(x_prior, j))
        rest = select(measured, rest, 0.0)
        inverse = 1.0 / s
        for i in range(n):
            k = select(measured, get(slope, i) * inverse, 0.0)
            put(k, gain, i)
            put(get(x, i) + k * rest, x, i)
        _joseph(P_before, H, seen, a, get(r, a), gain, slope, P)
        P_before = P
        nis = nis + rest * rest * inverse
        log_likelihood = log_likelihood + select(
            measured, -0.5 * (rest * rest * inverse + log(s) + 1.8378770664093453), 0.0
        )
        count = count + select(measured, 1.0, 0.0)
    put(nis, info.nis, 0)
    put(log_likelihood, info.log_likelihood, 0)
    put(count, info.seen, 0)


@_inlined
def add_input_errors(P, errors):
    """Add ``G G'`` to a predicted covariance: what the errors of the inputs do to the state.

    Args:
        P: Predicted covariance ``(nx, nx, LANES)``.
        errors: Effect of independent errors of unit variance on the next state, and behind it on its outputs
            ``(nx + ny, m, LANES)``.
    """
    for i in range(P.shape[0]):
        for j in range(i + 1):
            total = get(P, i, j)
            for c in range(errors.shape[1]):
                total = total + get(errors, i, c) * get(errors, j, c)
            put(total, P, i, j)
            put(total, P, j, i)


@_inlined
def correlated_update(x_prior, P_prior, predicted, H, seen, y, r, errors, x, P, work, info):
    """Correct a prior with measurements that see the same errors of the inputs as the prior.

    With ``G`` and ``D`` the effect of the errors on state and outputs, the measurement noise is ``R + D D'`` and its
    covariance with the state ``S = G D'``, so that the gain is ``(P H' + S) (H P H' + H S + S' H' + R + D D')^-1``
    (Simon 2006, 7.1).

    Args:
        x_prior: Predicted state ``(nx, LANES)``.
        P_prior: Its covariance, with ``G G'`` in it ``(nx, nx, LANES)``.
        predicted: Predicted measurements ``(ny, LANES)``.
        H: Output Jacobian at the prediction ``(ny, nx, LANES)``.
        seen: As in ``scalar_updates``.
        y: Measurements ``(ny, LANES)``, NaN where missing.
        r: Variances of their own noise ``(ny, LANES)``.
        errors: As in ``add_input_errors``.
        x: Corrected state, written.
        P: Corrected covariance, written, symmetric.
        work: Scratch ``(ny, nx, LANES)``, ``(ny, ny, LANES)`` and ``(ny, m, LANES)``.
        info: ``harness.engine.kernel_names.Info``, written but for ``repairs``.
    """
    n, m, count = x.shape[0], y.shape[0], errors.shape[1]
    V, factor, seen_errors = work
    S = info.innovation_covariance
    for a in range(m):
        put(get(y, a) - get(predicted, a), info.innovation, a)
        measured = get(y, a) == get(y, a)
        _times_row(P_prior, H, seen, a, V[a])
        for c in range(count):
            put(get(errors, n + a, c) + _dot(H, seen, a, errors, c), seen_errors, a, c)
        for i in range(n):
            total = get(V, a, i)
            for c in range(count):
                total = total + get(errors, i, c) * get(errors, n + a, c)
            put(select(measured, total, 0.0), V, a, i)
        for b in range(a + 1):
            total = get(r, a) if a == b else splat(0.0)
            for c in range(seen.shape[1]):
                j = seen[b, c]
                if j < 0:
                    break
                total = total + get(V, a, j) * get(H, b, j)
            for c in range(count):
                total = total + get(errors, n + b, c) * get(seen_errors, a, c)
            total = select(measured & (get(y, b) == get(y, b)), total, 1.0 if a == b else 0.0)
            put(total, S, a, b)
            put(total, S, b, a)
    repaired = cholesky(S, factor, m)
    return _apply_factor(x_prior, P_prior, y, x, P, V, factor, info, repaired)


@_inlined
def _dot(H, seen, a, errors, c):
    """Return the product of one row of H with the state's part of a column of errors."""
    total = splat(0.0)
    for k in range(seen.shape[1]):
        j = seen[a, k]
        if j < 0:
            break
        total = total + get(H, a, j) * get(errors, j, c)
    return total


@_inlined
def _times_row(P, H, seen, a, product):
    """Write ``P h'`` for one measurement row h over its non-zero entries."""
    for i in range(P.shape[0]):
        total = splat(0.0)
        for c in range(seen.shape[1]):
            j = seen[a, c]
            if j < 0:
                break
            total = total + get(P, i, j) * get(H, a, j)
        put(total, product, i)


@_inlined
def _joseph(P_before, H, seen, a, r, gain, slope, P):
    """Write (I - K h) P (I - K h)' + K r K' for one measurement row h, slope = P h'; P may be the one before.

    Row by row of the lower triangle: a row of (I - K h) P and its product with h' need nothing that was overwritten.
    """
    for i in range(P.shape[0]):
        k, v = get(gain, i), splat(0.0)
        for c in range(seen.shape[1]):
            j = seen[a, c]
            if j < 0:
                break
            v = v + (get(P_before, i, j) - k * get(slope, j)) * get(H, a, j)
        for j in range(i + 1):
            value = get(P_before, i, j) - k * get(slope, j) + (k * r - v) * get(gain, j)
            put(value, P, i, j)
            put(value, P, j, i)


@_inlined
def _innovations(P, predicted, H, seen, y, r, slope, info):
    """Write the joint innovation and its covariance H P H' + R for the record."""
    for a in range(y.shape[0]):
        put(get(y, a) - get(predicted, a), info.innovation, a)
        _times_row(P, H, seen, a, slope)
        for b in range(a + 1):
            total = get(r, a) if a == b else splat(0.0)
            for c in range(seen.shape[1]):
                j = seen[b, c]
                if j < 0:
                    break
                total = total + get(slope, j) * get(H, b, j)
            put(total, info.innovation_covariance, a, b)
            put(total, info.innovation_covariance, b, a)


@_jit
def sigma_mean(images, w0m, wi, mean, n):
    """Write the weighted mean of sigma points ``(points, >= n, LANES)`` to ``mean (n, LANES)`` (Ziaukas 2.23)."""
    for i in range(n):
        total = splat(0.0)
        for s in range(1, images.shape[0]):
            total = total + get(images, s, i)
        put(w0m * get(images, 0, i) + wi * total, mean, i)


@_jit
def deviations(images, mean, n):
    """Overwrite sigma points by their differences from the mean."""
    for s in range(images.shape[0]):
        for i in range(n):
            put(get(images, s, i) - get(mean, i), images, s, i)


@_jit
def central_differences(images, first, second, n):
    """Overwrite each pair of sigma points by its weighted divided differences (Norgaard et al. 2000).

    Row ``k`` becomes ``first (X_k+ - X_k-)`` and row ``k + nx`` becomes ``second (X_k+ + X_k- - 2 X_0)``, so that
    the covariance is the plain sum of outer products of all rows but the first, ``outer_sum(images, 0, 1, ...)``.

    Args:
        images: Sigma points after a function: centre, then those ahead, then those behind ``(2 nx + 1, >= n, LANES)``.
        first: Root of the weight of squared first differences, ``1 / (2 h)``.
        second: Root of the weight of squared second differences, ``sqrt(h^2 - 1) / (2 h^2)``.
        n: Number of components.
    """
    pairs = images.shape[0] // 2
    for k in range(1, pairs + 1):
        for i in range(n):
            ahead, behind = get(images, k, i), get(images, k + pairs, i)
            put(first * (ahead - behind), images, k, i)
            put(second * (ahead + behind - 2.0 * get(images, 0, i)), images, k + pairs, i)


@_inlined
def outer_sum(rows, w0, w, noise, covariance, n):
    """Write ``w0 r_0 r_0' + w sum r_s r_s' + diag(noise)`` for rows ``(points, >= n, LANES)`` (Ziaukas 2.24).

    Two rows and two columns of the result are summed at once: four independent sums keep the multipliers busy
    and use every number loaded twice. A last odd row or column is computed as its own partner.
    """
    for i in range(0, n, 2):
        i2 = i + 1 if i + 1 < n else i
        for j in range(0, i + 1, 2):
            j2 = j + 1 if j + 1 < n else j
            a, b, c, d = splat(0.0), splat(0.0), splat(0.0), splat(0.0)
            for s in range(1, rows.shape[0]):
                p, q, f, g = get(rows, s, i), get(rows, s, i2), get(rows, s, j), get(rows, s, j2)
                a, b, c, d = a + p * f, b + p * g, c + q * f, d + q * g
            p, q, f, g = get(rows, 0, i), get(rows, 0, i2), get(rows, 0, j), get(rows, 0, j2)
            a, b, c, d = w * a + w0 * p * f, w * b + w0 * p * g, w * c + w0 * q * f, w * d + w0 * q * g
            if i == j:  # the upper triangle of this block is the mirror of its lower one
                a, b, d = a + get(noise, i), c, d + get(noise, i2)
            put(d, covariance, i2, j2)
            put(d, covariance, j2, i2)
            put(c, covariance, i2, j)
            put(c, covariance, j, i2)
            put(b, covariance, i, j2)
            put(b, covariance, j2, i)
            put(a, covariance, i, j)
            put(a, covariance, j, i)


@_inlined
def cross_covariance(factor, images, weight, V, n, m):
    """Write the covariance of outputs and state, ``weight sum_k (Y_k+ - Y_k-) L_k'`` (Ziaukas 2.28), shape ``(m, n)``.

    Args:
        factor: Lower Cholesky factor of the state's covariance, at least ``(n, n, LANES)``.
        images: Outputs at the sigma points ``(2 n + 1, >= m, LANES)``.
        weight: Weight of a point times its distance in standard deviations.
        V: Written ``(m, n, LANES)``.
        n: Number of states.
        m: Number of outputs.
    """
    for a in range(m):
        for i in range(n):
            total = splat(0.0)
            for k in range(i + 1):
                total = total + get(factor, i, k) * (get(images, 1 + k, a) - get(images, 1 + n + k, a))
            put(weight * total, V, a, i)


@_inlined
def sigma_update(x_prior, P_prior, images, w0, w, predicted, V, y, r, x, P, factor, info):
    """Correct a prior through sigma points of a non-linear output (Ziaukas 2.27 to 2.31).

    A NaN measurement is taken out by giving it no covariance with the state and a unit variance of its own.

    Args:
        x_prior: Predicted state ``(nx, LANES)``.
        P_prior: Predicted covariance ``(nx, nx, LANES)``.
        images: Deviations or central differences of the outputs ``(2 nx + 1, >= ny, LANES)``.
        w0: Weight of the first row of ``images`` in the covariance.
        w: Weight of all other rows.
        predicted: Predicted measurements ``(ny, LANES)``.
        V: Covariance of outputs and state, from ``cross_covariance``; overwritten ``(ny, nx, LANES)``.
        y: Measurements ``(ny, LANES)``.
        r: Measurement variances ``(ny, LANES)``.
        x: Corrected state, written.
        P: Corrected covariance, written, symmetric.
        factor: Scratch, at least ``(ny, ny, LANES)``.
        info: ``harness.engine.kernel_names.Info``, written but for ``repairs``.

    Returns:
        Lanes whose innovation covariance had to be repaired (1 or 0).
    """
    n, m = x.shape[0], y.shape[0]
    S = info.innovation_covariance
    outer_sum(images, w0, w, r, S, m)
    for a in range(m):
        put(get(y, a) - get(predicted, a), info.innovation, a)
        seen_a = get(y, a) == get(y, a)
        for b in range(a + 1):
            seen = seen_a & (get(y, b) == get(y, b))
            value = select(seen, get(S, a, b), 1.0 if a == b else 0.0)
            put(value, S, a, b)
            put(value, S, b, a)
        for i in range(n):
            put(select(seen_a, get(V, a, i), 0.0), V, a, i)
    repaired = cholesky(S, factor, m)
    return _apply_factor(x_prior, P_prior, y, x, P, V, factor, info, repaired)


@_inlined
def _apply_factor(x_prior, P_prior, y, x, P, V, factor, info, repaired):
    """Turn V into P_xy L^-T, then x + V (L^-1 innovation) and P - V V' for S = L L'."""
    n, m = x.shape[0], y.shape[0]
    for i in range(n):
        put(get(x_prior, i), x, i)
    nis, log_likelihood, seen = splat(0.0), splat(0.0), splat(0.0)
    for a in range(m):
        measured = get(y, a) == get(y, a)
        inverse = 1.0 / get(factor, a, a)
        for i in range(n):
            value = get(V, a, i)
            for b in range(a):
                value = value - get(factor, a, b) * get(V, b, i)
            put(value * inverse, V, a, i)
        rest = select(measured, get(info.innovation, a), 0.0)
        for b in range(a):
            # the whitened innovation of measurement b waits in the upper triangle of the factor
            rest = rest - get(factor, a, b) * get(factor, b, b + 1)
        rest = select(measured, rest * inverse, 0.0)
        if a + 1 < m:
            put(rest, factor, a, a + 1)
        for i in range(n):
            put(get(x, i) + get(V, a, i) * rest, x, i)
        nis = nis + rest * rest
        log_likelihood = log_likelihood + select(
            measured, -0.5 * (rest * rest + 1.8378770664093453) + log(inverse), 0.0
        )
        seen = seen + select(measured, 1.0, 0.0)
    for i in range(n):
        for j in range(i + 1):
            value = get(P_prior, i, j)
            for a in range(m):
                value = value - get(V, a, i) * get(V, a, j)
            put(value, P, i, j)
            put(value, P, j, i)
    put(nis, info.nis, 0)
    put(log_likelihood, info.log_likelihood, 0)
    put(seen, info.seen, 0)
    return repaired
