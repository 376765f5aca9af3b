"""Extended Kalman filter in square-root form: a factor of the covariance is carried (Kailath et al. 2000, chapter 12).

Prediction and correction are those of the EKF (Ziaukas 2.12 to 2.16), as one triangularisation: with ``P = S S'``, the
sources of the predicted state are the columns of ``F S`` and of the process noise, those of the measurements the slopes
``H`` times these, and their own noise. The covariance that is stated is ``S S'``.
"""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import LANES, NW, NX, NY, get, next_jacobian, output_jacobian, put, splat
from harness.estimation.methods._square_root import correct_by_array, factor_before, put_noise, put_source, room
from harness.estimation.methods._square_root import memory_size as memory_size

KALMAN_TYPE = True


def workspace():
    """Return the scratch arrays of a run."""
    return (
        np.empty((NW, LANES)),
        np.empty((NX, LANES)),
        np.empty((NX, NX, LANES)),
        np.empty((NX, NX, LANES)),
        np.empty((NY, LANES)),
        np.empty((NY, NX, LANES)),
        np.empty((NY + NX, NY + NX, LANES)),
    )


def step(before, u_before, u, y, belief, work, after, info):
    """Predict one sample ahead and correct with the measurement, by the array of all sources."""
    w, x_prior, F, factor, predicted, H, L = work
    A, nothing = room(NX, belief), np.empty((0, NY + NX, LANES))
    repaired = factor_before(before, belief, factor)
    next_jacobian(before.mean, u_before, belief.constants, x_prior, F, w)
    output_jacobian(x_prior, u, belief.constants, predicted, H)
    for k in range(NX):
        for i in range(NX):
            total = splat(0.0)
            for j in range(k, NX):  # the factor is lower triangular
                total = total + get(F, i, j) * get(factor, j, k)
            put(total, A, k, NY + i)
        put_source(A, k, H)
    rows = put_noise(A, NX, belief, H)
    correct_by_array(A, rows, nothing, belief.measurement_noise, x_prior, predicted, y, L, after, info)
    put(repaired, info.repairs, 0)
