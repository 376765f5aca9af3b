"""Extended Kalman filter: linearised at every sample by the exact sparse Jacobian (Ziaukas 2.12 to 2.18)."""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import (
    LANES,
    NW,
    NX,
    NY,
    get,
    next_covariance,
    output_jacobian,
    put,
    splat,
)
from harness.estimation.methods._input_errors import correct, spread_inputs

KALMAN_TYPE = True


def workspace():
    """Return the scratch arrays of a run."""
    return (
        np.empty((NW, LANES)),
        np.empty((NX, LANES)),
        np.empty((NX, NX, LANES)),
        np.empty((NY, LANES)),
        np.empty((NY, NX, LANES)),
        np.empty((2 * NX, LANES)),
    )


def step(before, u_before, u, y, belief, work, after, info):
    """Predict one sample ahead (2.12, 2.13) and correct with the measurement (2.14 to 2.16)."""
    w, x_prior, P_prior, predicted, H, scratch = work
    next_covariance(before.mean, u_before, belief.constants, before.covariance, x_prior, P_prior, w)
    for i in range(NX):
        put(get(P_prior, i, i) + get(belief.process_noise, i), P_prior, i, i)
    spread_inputs(P_prior, belief)
    output_jacobian(x_prior, u, belief.constants, predicted, H)
    correct(x_prior, P_prior, predicted, H, y, belief, after, scratch, info)
    put(splat(0.0), info.repairs, 0)
