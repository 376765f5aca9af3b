"""Extended Kalman filter that finds the variances of its measurements by variational Bayes (Sarkka and Nummenmaa 2009).

The variance of measurement ``a`` is distributed as inverse gamma with ``alpha_a`` and ``beta_a``. From sample to sample
it may change: both are multiplied by the forgetting factor ``rho``, which keeps ``beta / alpha`` and widens the
distribution. A measurement adds 1/2 to ``alpha``, and the posterior is approximated by a product of a normal
distribution of the state and those of the variances, which are found in turn: a correction of the EKF with the
variance ``beta_a / alpha_a``, then ``beta_a = rho beta_a + (e_a^2 + H_a P H_a') / 2`` with the residual ``e_a`` and
covariance ``P`` of the corrected state.

It begins as if it had seen the believed variance for ever: ``alpha`` where it would stay, ``1 / (2 (1 - rho))``.
"""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.engine.compile import CompiledModel
from harness.engine.kernel_names import LANES, NY, get, put, select, splat
from harness.estimation.methods._input_errors import correct
from harness.estimation.methods._linearised import (
    linear_workspace,
    predict,
    residual_square,
    spare_info,
    with_measurement_noise,
)

DEVICES = ("cuda",)


class Settings(BaseModel):
    """How fast what was seen of the noise is forgotten, and how often variances and state are found in turn."""

    model_config = ConfigDict(extra="forbid")

    forgetting: float = Field(0.998, gt=0, lt=1, description="rho: the variance is that of about 1 / (1 - rho) samples")
    iterations: int = Field(3, ge=1, le=100, description="of variances and state at each sample")


# no KALMAN_TYPE: its measurement noise is not the one it is told


def tuning(settings: Settings, nx: int, ny: int) -> list[float]:
    """Return the forgetting factor and the number of iterations."""
    return [settings.forgetting, float(settings.iterations)]


def memory_size(settings: BaseModel, compiled: CompiledModel) -> int:
    """Return how many rows of memory the filter carries: ``alpha`` and ``beta`` of each measurement, 0 at first."""
    return 2 * compiled.ny


def workspace():
    """Return the scratch arrays of a run: those of a linearised filter, variances, and what later corrections say."""
    return linear_workspace(), np.empty((NY, LANES)), spare_info()


def step(before, u_before, u, y, belief, work, after, info):
    """Predict state and variances, then find both in turn; ``info`` is that before the sample tells of its noise."""
    linear, r, later = work
    predict(before, u_before, u, belief, linear)
    _, x_prior, P_prior, predicted, H, scratch = linear
    rho = belief.tuning[0]
    for a in range(NY):
        alpha, beta = get(before.memory, a), get(before.memory, NY + a)
        fresh = alpha == 0.0
        alpha = select(fresh, 0.5 / (1.0 - rho), alpha)
        beta = select(fresh, alpha * get(belief.measurement_noise, a), beta)
        put(beta / alpha, r, a)
        # without a measurement nothing is forgotten either, or a long gap would end in 0/0
        measured = get(y, a) == get(y, a)
        put(select(measured, rho * alpha + 0.5, alpha), after.memory, a)
        put(select(measured, rho * beta, beta), after.memory, NY + a)
    adapted = with_measurement_noise(belief, r)
    correct(x_prior, P_prior, predicted, H, y, adapted, after, scratch, info)
    put(splat(0.0), info.repairs, 0)
    for _ in range(int(belief.tuning[1])):
        for a in range(NY):
            beta = get(after.memory, NY + a) + 0.5 * residual_square(after, linear, y, a)
            put(beta / get(after.memory, a), r, a)
        correct(x_prior, P_prior, predicted, H, y, adapted, after, scratch, later)
    for a in range(NY):
        put(get(r, a) * get(after.memory, a), after.memory, NY + a)
