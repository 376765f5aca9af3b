"""Extended Kalman filter that bounds the influence of a measurement by Huber's loss (Huber 1964).

The correction of the EKF is the least-squares solution of prior and measurements. Here a measurement whose residual
``e`` is larger than ``k`` standard deviations counts with ``k |e|`` in place of its square (Huber 1964), so the minimum
of ``(x - x^-)' P^-1 (x - x^-) / 2 + sum rho(e_a / sqrt(R_a))`` is sought. It is found by least squares with weights
``w_a = min(1, k sqrt(R_a) / |e_a|)`` from the last iterate, which is a correction with the variance ``R_a / w_a``
(Karlgaard and Schaub 2007, who weigh the prior too). Here the prior keeps its quadratic loss: it is the sensors that
are distrusted. Sensors fail one by one, so each measurement has a weight of its own. Where every residual is small it
is the EKF, bit for bit.
"""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.engine.kernel_names import LANES, NY, absolute, any_of, get, maximum, put, splat, sqrt
from harness.estimation.methods._input_errors import correct
from harness.estimation.methods._linearised import (
    linear_workspace,
    predict,
    residual,
    spare_info,
    with_measurement_noise,
)

DEVICES = ("cuda",)


class Settings(BaseModel):
    """From where on residuals count less, and how often weights are found anew."""

    model_config = ConfigDict(extra="forbid")

    threshold: float = Field(
        1.345, gt=0, description="k in standard deviations; 1.345 loses 5 % to least squares where noise is normal"
    )
    iterations: int = Field(5, ge=1, le=100, description="of the weights, at samples with a large residual")


# no KALMAN_TYPE: it departs from the Kalman filter whenever a residual is large


def tuning(settings: Settings, nx: int, ny: int) -> list[float]:
    """Return the threshold and the number of iterations."""
    return [settings.threshold, float(settings.iterations)]


def workspace():
    """Return the scratch arrays of a run: those of a linearised filter, variances, and what later corrections say."""
    return linear_workspace(), np.empty((NY, LANES)), spare_info()


def step(before, u_before, u, y, belief, work, after, info):
    """Predict, correct, and correct again with less of what is far off; ``info`` is that of the first correction."""
    linear, r, later = work
    predict(before, u_before, u, belief, linear)
    _, x_prior, P_prior, predicted, H, scratch = linear
    correct(x_prior, P_prior, predicted, H, y, belief, after, scratch, info)
    put(splat(0.0), info.repairs, 0)
    if weaken(after, linear, y, belief, r):
        weakened = with_measurement_noise(belief, r)
        for _ in range(int(belief.tuning[1])):
            correct(x_prior, P_prior, predicted, H, y, weakened, after, scratch, later)
            weaken(after, linear, y, belief, r)


def weaken(after, work, y, belief, r):
    """Write ``R / w`` for the residuals behind a correction ``(ny, LANES)``; return whether any differs from ``R``."""
    some = False
    for a in range(NY):
        variance = get(belief.measurement_noise, a)
        over = absolute(residual(after, work, y, a)) / (belief.tuning[0] * sqrt(variance))
        put(variance * maximum(over, splat(1.0)), r, a)
        some = some or any_of(over > 1.0)
    return some
