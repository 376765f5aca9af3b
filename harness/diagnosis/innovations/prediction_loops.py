"""The loop over a recording that predicts it at several horizons at once, pasted behind the kernels of a model.

Lanes are horizons. The first one is a finished pass of a filter; from every restart another lane predicts as many
samples as its horizon, without their measurements, and then begins again where the filter is. Means run through the
model itself, covariances through the model linearised along the pass.
"""

from __future__ import annotations

import numpy as np

from harness.diagnosis.model.covariance_loops import congruence, correct
from harness.engine.kernel_names import LANES, NW, NX, NY, cholesky, get, log, next_state, output, put, select, splat
from harness.engine.simd.memory import borrowed, retain
from harness.runner.filter_loop import fill


def predict_ahead(inputs, y, constants, linear, noise, means, rows, horizons, far, densities, squares):
    """Write how dense the measurements are under each lane's prediction.

    Args:
        inputs: At the samples, and during the step behind each ``(samples, nu)``.
        y: Measurements ``(samples, ny)``, NaN where missing; the first sample is not used.
        constants: ``(nc, LANES)``.
        linear: Jacobians of the next state ``(samples, n, n)`` and of the outputs ``(samples, ny, n)`` in the states
            that count, and the gains of the pass ``(samples, n, ny)``; then the columns of both Jacobians that may
            differ from zero, row by row, then -1 ``(n, n + 1)`` and ``(ny, n + 1)``.
        noise: First variances ``(n,)``; variances of the process per step ``(n,)`` and of the measurements ``(ny,)``;
            what the errors of the inputs do to next state and outputs ``(samples, n + ny, m)``, and as variances of the
            outputs of a free run ``(samples, ny)``.
        means: Corrected mean of the pass ``(samples, NX)``, the first state first.
        rows: First and last but one of the states that are biases of sensors, which are not predicted ``(2,)``; the
            latter is how many states the filter corrects.
        horizons: Samples ``(1, LANES)``; 1 for the filter, which the first lane is.
        far: 1 in the lanes that predict so far that the errors of the inputs act as in a free run ``(1, LANES)``.
        densities: Logarithm of the density of the measurements, written ``(samples, LANES)``.
        squares: Their squared distance from the prediction, normalised, written ``(samples, LANES)``.
    """
    samples, n, nu = linear[0].shape[0], linear[0].shape[1], inputs[0].shape[1]
    owned = (
        (np.empty((NW, LANES)), np.empty((nu, LANES)), np.zeros((1, LANES)), np.empty((2, LANES))),
        (np.empty((NX, LANES)), np.empty((NX, LANES)), np.empty((NY, LANES)), np.empty((NY, LANES))),
        (np.zeros((n, n, LANES)), np.zeros((n, n, LANES)), np.zeros((n, n, LANES))),
        (np.zeros((NY, NY, LANES)), np.zeros((NY, NY, LANES)), np.empty((NY, NY, LANES))),
        (np.empty((n, NY, LANES)), np.zeros((n, NY, LANES)), np.empty((n, NY, LANES))),
    )
    (w, u, since, weighed), (x, x_prior, predicted, e), (P, P_prior, T), (S, factor, D), (V, E, W) = borrowed(owned)
    inputs, y, constants, linear, noise, means = borrowed((inputs, y, constants, linear, noise, means))
    A, H, K, moving, seen = linear
    first, Q, R, errors, spread = noise
    for i in range(NX):
        put(splat(means[0, i]), x, i)
    for i in range(n):
        put(splat(first[i]), P, i, i)
    for k in range(1, samples):
        fill(inputs[1][k - 1], u)
        next_state(x, u, constants, x_prior, w)
        fill(inputs[0][k], u)
        output(x_prior, u, constants, predicted)
        congruence(A[k - 1], moving, P, T, P_prior)
        seen_errors(errors[k], far, rows[1], Q, P_prior, E, D)
        innovate(H[k], seen, P_prior, E, D, R, spread[k], far, y[k], predicted, V, S, e)
        correct(K[k], rows[1], P_prior, V, S, W, P)
        weigh(S, factor, e, y[k], weighed)
        for lane in range(LANES):
            densities[k, lane], squares[k, lane] = weighed[0, lane], weighed[1, lane]
        count = get(since, 0) + 1.0
        again = count >= get(horizons, 0)
        put(select(again, 0.0, count), since, 0)
        begin_again(again, means[k], rows, x_prior, P_prior, x, P)
    retain(owned)


def seen_errors(errors, far, corrected, Q, P, E, D):
    """Add the noise of a step to a covariance; write what it shares with the measurements, and their part of it.

    In the lanes that predict far the errors of the inputs act otherwise: from sample to sample they hardly change, so a
    filter may take them as white, and a long prediction sums them up.

    Args:
        errors: Of the inputs ``(n + ny, m)``; none in the states that the filter does not correct.
        far: As in ``predict_ahead``.
        corrected: How many states the filter corrects.
        Q: Variances of the process noise ``(n,)``.
        P: Written ``(n, n, LANES)``.
        E: Written ``(n, ny, LANES)``, but for states that the filter does not correct.
        D: Written ``(ny, ny, LANES)``.
    """
    n, near = len(Q), 1.0 - get(far, 0)
    for i in range(corrected):
        put(get(P, i, i) + Q[i], P, i, i)
        for j in range(corrected):
            put(get(P, i, j) + near * inner(errors, i, j), P, i, j)
        for a in range(NY):
            put(near * inner(errors, i, n + a), E, i, a)
    for a in range(NY):
        for b in range(NY):
            put(near * inner(errors, n + a, n + b), D, a, b)


def inner(rows, i, j):
    """Return the product of two rows of a matrix."""
    total = 0.0
    for c in range(rows.shape[1]):
        total += rows[i, c] * rows[j, c]
    return total


def innovate(H, columns, P, E, D, R, spread, far, y, predicted, V, S, e):
    """Write the innovation and its covariance, with unit rows in place of missing measurements.

    Args:
        H: ``(ny, n)``.
        columns: Those of each row of ``H`` that may differ from zero, then -1 ``(ny, n + 1)``.
        P: Prior covariance ``(n, n, LANES)``.
        E: Covariance of the state with what the measurements see of the errors of the inputs ``(n, ny, LANES)``.
        D: Their covariance there ``(ny, ny, LANES)``.
        R: Variances ``(ny,)``.
        spread: Variances in the lanes that predict far ``(ny,)``.
        far: As in ``predict_ahead``.
        y: Measurements ``(ny,)``.
        predicted: ``(ny, LANES)``.
        V: Written, the covariance of state and innovation ``P H' + E`` ``(n, ny, LANES)``.
        S: Written ``(ny, ny, LANES)``.
        e: Written ``(ny, LANES)``.
    """
    n = H.shape[1]
    for a in range(NY):
        put(splat(0.0) if np.isnan(y[a]) else y[a] - get(predicted, a), e, a)
        for i in range(n):
            total = get(E, i, a)
            for q in range(n):
                j = columns[a, q]
                if j < 0:
                    break
                total = total + get(P, i, j) * H[a, j]
            put(total, V, i, a)
    for a in range(NY):
        for b in range(NY):
            total = get(D, a, b)
            for q in range(n):
                i = columns[a, q]
                if i < 0:
                    break
                total = total + H[a, i] * get(V, i, b)
            for q in range(n):
                i = columns[b, q]
                if i < 0:
                    break
                total = total + H[b, i] * get(E, i, a)
            if a == b:
                total = total + (R[a] + spread[a] * get(far, 0))
            if np.isnan(y[a]) or np.isnan(y[b]):
                total = splat(1.0 if a == b else 0.0)
            put(total, S, a, b)


def weigh(S, factor, e, y, weighed):
    """Write the log density of innovations and their normalised square ``(2, LANES)``."""
    cholesky(S, factor, NY)
    density, square = splat(0.0), splat(0.0)
    for a in range(NY):
        rest = get(e, a)
        for b in range(a):
            rest = rest - get(factor, a, b) * get(e, b)
        rest = rest / get(factor, a, a)
        put(rest, e, a)
        if not np.isnan(y[a]):
            square = square + rest * rest
            density = density - 0.5 * (1.8378770664093453 + rest * rest) - log(get(factor, a, a))
    put(density, weighed, 0)
    put(square, weighed, 1)


def begin_again(again, mean, rows, x_prior, P_prior, x, P):
    """Let the lanes that have reached their horizon begin where the filter is, and the others go on.

    Every lane knows of the biases of sensors what the filter does. A horizon is for how long the motion is predicted.
    A bias is no motion: without measurements its one error would count at each of thousands of samples.

    Args:
        again: Lanes that begin again.
        mean: Of the filter ``(NX,)``.
        rows: Of the biases, see ``predict_ahead``.
        x_prior: Predicted mean ``(NX, LANES)``.
        P_prior: Its covariance ``(n, n, LANES)``.
        x: Mean from which the lanes go on, written.
        P: Covariance of the filter in the first lane; from which the lanes go on, written.
    """
    n = P.shape[0]
    for i in range(NX):
        bias = (i >= rows[0]) & (i < rows[1])
        put(splat(mean[i]) if bias else select(again, splat(mean[i]), get(x_prior, i)), x, i)
    for i in range(n):
        for j in range(n):
            row_held, column_held = (i >= rows[0]) & (i < rows[1]), (j >= rows[0]) & (j < rows[1])
            going = get(P_prior, i, j)
            if row_held and column_held:
                going = splat(P[i, j, 0])
            elif row_held or column_held:
                going = splat(0.0)
            put(select(again, splat(P[i, j, 0]), going), P, i, j)
