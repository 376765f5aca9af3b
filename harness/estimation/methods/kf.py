"""Linear time-variant Kalman filter on the model linearised about straight driving (KIT 2015, lecture on the filter).

``x*(n+1) = A(n) x(n) + B(n) u(n)`` with ``A = d next / d x`` at the state zero and the inputs known at sample ``n``, so
that the filter is scheduled with the speed; ``next(0, u)`` stands for ``B(n) u(n)``. Unknown inputs are states and zero
there as well. The process noise enters every state by its own variance, so the lecture's ``L(n)`` is the identity.
On a linear model it is the textbook's filter, on any other it is what is left of the model near straight driving.
"""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import (
    LANES,
    NW,
    NX,
    NY,
    SEEN_STATES,
    get,
    next_linear,
    output_jacobian,
    put,
    splat,
)
from harness.estimation.methods._input_errors import correct, spread_inputs

KALMAN_TYPE = True
LINEAR = True
DEVICES = ("cuda",)


def workspace():
    """Return the scratch arrays of a run; the first one holds the state zero."""
    return (
        np.zeros((NX, LANES)),
        np.empty((NW, LANES)),
        np.empty((NX, LANES)),
        np.empty((NX, NX, LANES)),
        np.empty((NY, LANES)),
        np.empty((NY, NX, LANES)),
        np.empty((2 * NX, LANES)),
    )


def step(before, u_before, u, y, belief, work, after, info):
    """Predict one sample ahead and correct with the measurement (prediction and filter step of the lecture)."""
    straight, w, x_prior, P_prior, predicted, H, scratch = work
    constants = belief.constants
    next_linear(straight, u_before, constants, before.mean, before.covariance, x_prior, P_prior, w)
    for i in range(NX):
        put(get(P_prior, i, i) + get(belief.process_noise, i), P_prior, i, i)
    spread_inputs(P_prior, belief)
    output_jacobian(straight, u, constants, predicted, H)
    for a in range(NY):
        put(get(predicted, a) + along(H, x_prior, a), predicted, a)
    correct(x_prior, P_prior, predicted, H, y, belief, after, scratch, info)
    put(splat(0.0), info.repairs, 0)


def along(H, x, a):
    """Return the product of row ``a`` of the output's slopes with a state."""
    total = splat(0.0)
    for c in range(SEEN_STATES.shape[1]):
        j = SEEN_STATES[a, c]
        if j < 0:
            break
        total = total + get(H, a, j) * get(x, j)
    return total
