"""Filters that carry a factor of the covariance: triangularisation, and a correction by one array.

A covariance is a sum of squares, ``P = A' A``: a row of ``A`` for each independent source of unit variance, a column
for each quantity that it moves. An orthogonal transformation of the rows leaves the sum as it is, and brings ``A`` to
triangular form. If the columns are first the measurements, then the states, the triangle holds all that a correction
needs (Simon 2006, 6.3)::

    A  ->  [ S_y'  K' ]      S_y S_y'  covariance of the innovation
           [ 0     S' ]      K         gain times S_y
                             S S'      covariance of the corrected state

Nothing is subtracted and no covariance is formed, so the factor keeps twice the digits of a covariance (Kailath, Sayed
and Hassibi 2000, chapter 12).
"""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel

from harness.engine.compile import CompiledModel
from harness.engine.kernel_names import (
    INPUT_ERRORS,
    LANES,
    NX,
    NY,
    SEEN_STATES,
    absolute,
    any_of,
    cholesky,
    get,
    log,
    maximum,
    put,
    select,
    splat,
    sqrt,
)


def memory_size(settings: BaseModel, compiled: CompiledModel) -> int:
    """Return how many rows of memory the filter carries: the factor, row by row, 0 at first."""
    return compiled.nx**2


def factor_before(before, belief, factor):
    """Write the factor a step begins with ``(nx, nx, LANES)``; return the lanes in which it had to be repaired.

    It is the one in the memory. In the first step, and where parameters are among the states, which are settled in the
    covariance behind every step, it is that of the covariance.
    """
    carried = before.memory.reshape((NX, NX, LANES))
    total = splat(0.0)
    for i in range(NX):
        total = total + absolute(get(carried, i, i))
    if belief.priors.shape[0] > 0 or any_of(total == 0.0):  # the runs of a batch begin together
        return cholesky(before.covariance, factor, NX)
    for i in range(NX):
        for j in range(NX):
            put(get(carried, i, j), factor, i, j)
    return splat(0.0)


def triangularise(A, rows, first, columns, L):
    """Write the lower triangle ``L`` with ``L L' = A' A`` by Householder's reflections; ``A`` is overwritten.

    Source: Golub and Van Loan 2013, algorithms 5.1.1 and 5.2.1.

    Args:
        A: ``(>= rows, >= first + columns, LANES)``.
        rows: That are taken of it.
        first: First column that is.
        columns: At most as many as rows.
        L: Written ``(>= columns, >= columns, LANES)``; its diagonal is not negative.
    """
    for k in range(columns):
        square, here = splat(0.0), first + k
        for r in range(k, rows):
            square = square + get(A, r, here) * get(A, r, here)
        norm, head = sqrt(square), get(A, k, here)
        negative = head > 0.0
        put(select(negative, head + norm, head - norm), A, k, here)
        scale = norm * (norm + absolute(head))
        inverse = select(scale > 0.0, 1.0 / scale, 0.0)
        put(norm, L, k, k)
        for j in range(k + 1, columns):
            dot, there = splat(0.0), first + j
            for r in range(k, rows):
                dot = dot + get(A, r, here) * get(A, r, there)
            dot = dot * inverse
            for r in range(k, rows):
                put(get(A, r, there) - dot * get(A, r, here), A, r, there)
            put(select(negative, -get(A, k, there), get(A, k, there)), L, j, k)
            put(splat(0.0), L, k, j)


def take_away(L, v, n):
    """Take ``v v'`` from ``L L'`` by hyperbolic rotations; ``v`` is overwritten. Return the lanes repaired.

    A pivot that would not stay positive keeps a ten-millionth of its size (Golub and Van Loan 2013, 6.5.4). A row of
    zeros stays one.
    """
    repaired = splat(0.0)
    for k in range(n):
        pivot, other = get(L, k, k), get(v, k)
        remainder = (pivot - other) * (pivot + other)
        least = 1e-14 * pivot * pivot
        broken = remainder < least
        repaired = select(broken, 1.0, repaired)
        root = sqrt(select(broken, least, remainder))
        c, s = select(pivot > 0.0, root / pivot, 1.0), select(pivot > 0.0, other / pivot, 0.0)
        put(root, L, k, k)
        for i in range(k + 1, n):
            value = (get(L, i, k) - s * get(v, i)) / c
            put(c * get(v, i) - s * value, v, i)
            put(value, L, i, k)
    return repaired


def room(sources, belief):
    """Return an array for so many sources and process noise, errors of the inputs, noise of the sensors."""
    count = sources + NX + NY
    if INPUT_ERRORS:
        count = count + belief.input_errors.shape[1]
    return np.empty((count, NY + NX, LANES))


def put_source(A, row, H):
    """Complete a row that moves the states: by the slopes ``H`` it moves the measurements."""
    for a in range(NY):
        total = splat(0.0)
        for c in range(SEEN_STATES.shape[1]):
            j = SEEN_STATES[a, c]
            if j < 0:
                break
            total = total + get(H, a, j) * get(A, row, NY + j)
        put(total, A, row, a)


def put_noise(A, row, belief, H):
    """Write the rows of process noise and, behind them, of errors of the inputs; return the row behind the last."""
    for i in range(NX):
        for j in range(NX):
            put(sqrt(get(belief.process_noise, i)) if i == j else splat(0.0), A, row + i, NY + j)
        put_source(A, row + i, H)
    row = row + NX
    if INPUT_ERRORS:
        for c in range(belief.input_errors.shape[1]):
            for j in range(NX):
                put(get(belief.input_errors, j, c), A, row + c, NY + j)
            put_source(A, row + c, H)
            for a in range(NY):
                put(get(A, row + c, a) + get(belief.input_errors, NX + a, c), A, row + c, a)
        row = row + belief.input_errors.shape[1]
    return row


def correct_by_array(A, rows, minus, r, x_prior, predicted, y, L, after, info):
    """Correct a prior by the array of all its sources; return the lanes repaired.

    Args:
        A: A row for each source, measurements before states; ``ny`` more rows are for the noise of the sensors.
        rows: Number of sources.
        minus: A source that is taken away ``(1, ny + nx, LANES)``, or none ``(0, ny + nx, LANES)``.
        r: Variances of the sensors ``(ny, LANES)``.
        x_prior: Predicted state.
        predicted: Predicted measurements.
        y: Measurements, NaN where missing.
        L: Scratch ``(ny + nx, ny + nx, LANES)``.
        after: Mean, covariance and, in its memory, factor are written.
        info: Written but for ``repairs``.
    """
    for a in range(NY):
        for j in range(NY + NX):
            put(sqrt(get(r, a)) if j == a else splat(0.0), A, rows + a, j)
    for a in range(NY):
        put(get(y, a) - get(predicted, a), info.innovation, a)
        for b in range(a + 1):
            total = splat(0.0)
            for k in range(rows + NY):
                total = total + get(A, k, a) * get(A, k, b)
            for k in range(minus.shape[0]):
                total = total - get(minus, k, a) * get(minus, k, b)
            put(total, info.innovation_covariance, a, b)
            put(total, info.innovation_covariance, b, a)
    for a in range(NY):  # a missing measurement moves nothing, and has a unit variance of its own
        measured = get(y, a) == get(y, a)
        for k in range(rows + NY):
            put(select(measured, get(A, k, a), 1.0 if k == rows + a else 0.0), A, k, a)
        for k in range(minus.shape[0]):
            put(select(measured, get(minus, k, a), 0.0), minus, k, a)
    triangularise(A, rows + NY, 0, NY + NX, L)
    repaired = splat(0.0)
    for k in range(minus.shape[0]):
        repaired = maximum(repaired, take_away(L, minus[k], NY + NX))
    conclude_array(y, x_prior, L, after, info)
    return repaired


def conclude_array(y, x_prior, L, after, info):
    """Write the corrected state, its covariance and factor, and what the innovation says, from the triangle."""
    nis, log_likelihood, seen = splat(0.0), splat(0.0), splat(0.0)
    for i in range(NX):
        put(get(x_prior, i), after.mean, i)
    for a in range(NY):
        measured = get(y, a) == get(y, a)
        rest = select(measured, get(info.innovation, a), 0.0)
        for b in range(a):  # the whitened innovation of measurement b waits in the upper triangle
            rest = rest - get(L, a, b) * get(L, b, b + 1)
        rest = rest / get(L, a, a)
        put(rest, L, a, a + 1)
        for i in range(NX):
            put(get(after.mean, i) + get(L, NY + i, a) * rest, after.mean, i)
        nis = nis + rest * rest
        part = 0.5 * (rest * rest + 1.8378770664093453) + log(get(L, a, a))
        log_likelihood = log_likelihood - select(measured, part, 0.0)
        seen = seen + select(measured, 1.0, 0.0)
    for i in range(NX):
        for j in range(NX):
            put(get(L, NY + i, NY + j) if j <= i else splat(0.0), after.memory, i * NX + j)
        for j in range(i + 1):
            total = splat(0.0)
            for k in range(j + 1):
                total = total + get(L, NY + i, NY + k) * get(L, NY + j, NY + k)
            put(total, after.covariance, i, j)
            put(total, after.covariance, j, i)
    put(nis, info.nis, 0)
    put(log_likelihood, info.log_likelihood, 0)
    put(seen, info.seen, 0)
