"""Extended H-infinity filter: the smallest error against the worst disturbance (Simon 2006, 11.3).

The filter bounds the error for any disturbance of bounded energy, where the Kalman filter has the smallest one for
noise of known variances. With the weight ``W`` of the error and ``theta``, the gain is that of the Kalman filter for

    P~ = (P^-1 - theta W)^-1,

so prediction and correction are those of the EKF and the predicted covariance is enlarged between the two. It
exists while ``P~`` is positive. The weight of a state's error here is one over its predicted variance, so that
it has no unit; as the eigenvalues of a correlation matrix are at most ``n``, the filter exists for every theta below
``1 / n``. ``theta = bound / n`` is what is used: at 0 it is the EKF, bit for bit. The matrix it states bounds the error
of the game and is larger than the covariance where all is as believed.
"""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.engine.kernel_names import LANES, NX, NY, any_of, get, put, select, splat
from harness.estimation.methods._input_errors import correct
from harness.estimation.methods._linearised import linear_workspace, predict

DEVICES = ("cuda",)
REMEDY = "filter against the worst disturbance"


class Settings(BaseModel):
    """How much of what the game allows is asked for."""

    model_config = ConfigDict(extra="forbid")

    bound: float = Field(
        0.02, ge=0, lt=1, description="theta over the largest for which the filter always exists; 0: EKF"
    )


# no KALMAN_TYPE: its gain is larger than that of the Kalman filter


def tuning(settings: Settings, nx: int, ny: int) -> list[float]:
    """Return the bound."""
    return [settings.bound]


def workspace():
    """Return the scratch arrays of a run: those of a linearised filter, weights, and a column."""
    return linear_workspace(), np.empty((NX, LANES)), np.empty((NX, LANES))


def step(before, u_before, u, y, belief, work, after, info):
    """Predict, enlarge what is predicted by what the worst disturbance could do, and correct."""
    linear, weights, column = work
    predict(before, u_before, u, belief, linear)
    _, x_prior, P_prior, predicted, H, scratch = linear
    if belief.tuning[0] > 0.0:
        enlarge(P_prior, y, NX - belief.priors.shape[0], belief.tuning[0], weights, column)
    correct(x_prior, P_prior, predicted, H, y, belief, after, scratch, info)
    put(splat(0.0), info.repairs, 0)


def enlarge(P, y, states, bound, weights, column):
    """Overwrite ``P`` by ``(P^-1 - theta W)^-1``, one state after the other (Sherman and Morrison 1950).

    Nothing is enlarged at a sample without a measurement, or the bound would grow through every gap, nor for
    parameters, which nothing disturbs.
    """
    seen = splat(0.0)
    for a in range(NY):
        seen = seen + select(get(y, a) == get(y, a), 1.0, 0.0)
    if not any_of(seen > 0.0):
        return
    for i in range(states):
        put(select(seen > 0.0, bound / (states * get(P, i, i)), 0.0), weights, i)
    for i in range(states):
        theta = get(weights, i)
        for j in range(NX):
            put(get(P, i, j), column, j)
        scale = select(theta > 0.0, theta / (1.0 - theta * get(P, i, i)), 0.0)
        for j in range(NX):
            for k in range(j + 1):
                value = get(P, j, k) + scale * get(column, j) * get(column, k)
                put(value, P, j, k)
                put(value, P, k, j)
