"""Extended Kalman filter for measurements with the heavy tails of Student's t distribution, by variational Bayes.

Each measurement has noise ``e_a ~ N(0, R_a / lambda_a)`` with ``lambda_a ~ Gamma(nu/2, nu/2)``, so it is distributed as
Student's t with ``nu`` degrees of freedom and scale ``sqrt(R_a)``. The posterior is approximated by a product of a
normal distribution of the state and gamma distributions of the ``lambda_a``, which are found in turn (Piche, Sarkka and
Hartikainen 2012, there with one ``lambda`` for all measurements of a sample; sensors fail one by one, so each has its
own): a correction of the EKF with ``R_a / lambda_a``, then ``lambda_a = (nu + 1) / (nu + E[e_a^2] / R_a)`` with
``E[e_a^2] = e_a^2 + H_a P H_a'`` of the corrected state.
"""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.engine.kernel_names import LANES, NY, get, put, splat
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
    """How heavy the tails are, and how often state and weights are found in turn."""

    model_config = ConfigDict(extra="forbid")

    degrees: float = Field(
        4.0, gt=0, description="degrees of freedom nu of the noise; the smaller, the heavier its tails"
    )
    iterations: int = Field(5, ge=1, le=100, description="of weights and state at each sample")


# no KALMAN_TYPE: the weight of a measurement depends on its residual


def tuning(settings: Settings, nx: int, ny: int) -> list[float]:
    """Return the degrees of freedom and the number of iterations."""
    return [settings.degrees, float(settings.iterations)]


def workspace():
    """Return the scratch arrays of a run: those of a linearised filter, variances, and what later corrections say."""
    return linear_workspace(), np.empty((NY, LANES)), spare_info()


def step(before, u_before, u, y, belief, work, after, info):
    """Predict, then correct and weigh in turn; ``info`` is that of the first correction, with normal noise."""
    linear, r, later = work
    predict(before, u_before, u, belief, linear)
    _, x_prior, P_prior, predicted, H, scratch = linear
    correct(x_prior, P_prior, predicted, H, y, belief, after, scratch, info)
    put(splat(0.0), info.repairs, 0)
    weighed = with_measurement_noise(belief, r)
    nu = belief.tuning[0]
    for _ in range(int(belief.tuning[1])):
        for a in range(NY):
            variance = get(belief.measurement_noise, a)
            put((variance * nu + residual_square(after, linear, y, a)) / (nu + 1.0), r, a)
        correct(x_prior, P_prior, predicted, H, y, weighed, after, scratch, later)
