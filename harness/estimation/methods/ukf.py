"""Unscented Kalman filter in the additive form (Ziaukas 2.19 to 2.31; van der Merwe 2004).

Where the outputs are linear in the state, the measurement update is written in closed form; it equals the one
with sigma points redrawn from the predicted covariance. Otherwise they are redrawn, because points that skip
the process noise (2.25 as printed) make the innovation covariance too small.
"""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from harness.engine.kernel_names import (
    NX,
    NY,
    OUTPUTS_ARE_LINEAR,
    cholesky,
    cross_covariance,
    deviations,
    maximum,
    outer_sum,
    output_jacobian,
    put,
    sigma_mean,
    sigma_update,
)
from harness.estimation.methods._input_errors import correct, output_noise, spread_inputs
from harness.estimation.methods._sigma_points import observe, propagate
from harness.estimation.methods._sigma_points import workspace as workspace


class Settings(BaseModel):
    """Spread of the sigma points (2.20, 2.21); the defaults are the thesis's (5.5)."""

    model_config = ConfigDict(extra="forbid")

    alpha: float = Field(1.0, gt=0, description="spread of the points around the mean")
    beta: float = Field(2.0, description="prior knowledge of the distribution; 2 for a normal one")
    kappa: float = Field(0.0, description="adjusts the fourth moment")


KALMAN_TYPE = True
DEVICES = ("cuda",)
IN_TRACE = 2


def tuning(settings: Settings, nx: int, ny: int) -> list[float]:
    """Return the distance of the points in standard deviations and the weights ``w0m, w0c, wi`` (2.20, 2.21)."""
    total = settings.alpha**2 * (nx + settings.kappa)  # n + lambda
    if total <= 0:
        raise ValueError(f"alpha^2 (n + kappa) = {total:g} must be positive; raise kappa above {-nx}")
    first = (total - nx) / total
    return [total**0.5, first, first + 1 - settings.alpha**2 + settings.beta, 0.5 / total]


def step(before, u_before, u, y, belief, work, after, info):
    """Predict with sigma points (2.22 to 2.24) and correct with the measurement (2.25 to 2.31)."""
    w, x_prior, P_prior, factor, point, images, predicted, H, scratch = work
    constants, r = belief.constants, output_noise(belief)
    distance, w0m, w0c, wi = belief.tuning[0], belief.tuning[1], belief.tuning[2], belief.tuning[3]
    repaired = cholesky(before.covariance, factor, NX)
    propagate(before.mean, factor, distance, u_before, constants, point, images, w)
    sigma_mean(images, w0m, wi, x_prior, NX)
    deviations(images, x_prior, NX)
    outer_sum(images, w0c, wi, belief.process_noise, P_prior, NX)
    spread_inputs(P_prior, belief)
    if OUTPUTS_ARE_LINEAR:
        output_jacobian(x_prior, u, constants, predicted, H)
        correct(x_prior, P_prior, predicted, H, y, belief, after, scratch, info)
    else:
        repaired = maximum(repaired, cholesky(P_prior, factor, NX))
        observe(x_prior, factor, distance, u, constants, point, images)
        cross_covariance(factor, images, wi * distance, H, NX, NY)
        sigma_mean(images, w0m, wi, predicted, NY)
        deviations(images, predicted, NY)
        failed = sigma_update(
            x_prior, P_prior, images, w0c, wi, predicted, H, y, r, after.mean, after.covariance, factor, info
        )
        repaired = maximum(repaired, failed)
    put(repaired, info.repairs, 0)
