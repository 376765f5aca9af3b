"""Central-difference Kalman filter: sigma points and divided differences (Norgaard et al. 2000; Li et al. 2017).

The equations are (11) to (15) and (23) to (34) of Li et al. without their fading factor, in the additive form. Two
prints are put right by their moments: (12) runs two weights together, and (27) weighs the cross-covariance with
``1/(4 h^2)``, which halves it for every linear output; it is ``1/(2 h^2)``. Where the outputs are linear in the
state, the measurement update is written in closed form, which equals the one with redrawn points.
"""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict, Field

from harness.engine.kernel_names import (
    NX,
    NY,
    OUTPUTS_ARE_LINEAR,
    central_differences,
    cholesky,
    cross_covariance,
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
    """Interval of the central differences (11); its square of 3 matches the fourth moment of a normal distribution."""

    model_config = ConfigDict(extra="forbid")

    interval_squared: float = Field(
        3.0, ge=1, allow_inf_nan=False, description="h^2, square of the interval in standard deviations"
    )


KALMAN_TYPE = True
DEVICES = ("cuda",)
IN_TRACE = 3


def tuning(settings: Settings, nx: int, ny: int) -> list[float]:
    """Return ``h``, the weights ``W0m, Wim`` and the roots of ``Wic1, Wic2`` (12)."""
    square = settings.interval_squared
    h = square**0.5
    return [h, (square - nx) / square, 0.5 / square, 0.5 / h, (square - 1) ** 0.5 / (2 * square)]


def step(before, u_before, u, y, belief, work, after, info):
    """Predict with central differences (13 to 15) and correct with the measurement (23 to 34)."""
    w, x_prior, P_prior, factor, point, images, predicted, H, scratch = work
    constants, r, tuned = belief.constants, output_noise(belief), belief.tuning
    h, w0m, wim, first, second = tuned[0], tuned[1], tuned[2], tuned[3], tuned[4]
    repaired = cholesky(before.covariance, factor, NX)
    propagate(before.mean, factor, h, u_before, constants, point, images, w)
    sigma_mean(images, w0m, wim, x_prior, NX)
    central_differences(images, first, second, NX)
    outer_sum(images, 0.0, 1.0, belief.process_noise, P_prior, NX)
    spread_inputs(P_prior, belief)
    if OUTPUTS_ARE_LINEAR:
        output_jacobian(x_prior, u, constants, predicted, H)
        correct(x_prior, P_prior, predicted, H, y, belief, after, scratch, info)
    else:
        repaired = maximum(repaired, cholesky(P_prior, factor, NX))
        observe(x_prior, factor, h, u, constants, point, images)
        cross_covariance(factor, images, wim * h, H, NX, NY)
        sigma_mean(images, w0m, wim, predicted, NY)
        central_differences(images, first, second, NY)
        failed = sigma_update(
            x_prior, P_prior, images, 0.0, 1.0, predicted, H, y, r, after.mean, after.covariance, factor, info
        )
        repaired = maximum(repaired, failed)
    put(repaired, info.repairs, 0)
