"""Strong-tracking central-difference Kalman filter: fades old data when the residuals grow (Li et al. 2017).

The residuals' covariance is followed with a forgetting factor (21). If it exceeds what the filter expects, the part of
the predicted covariance that comes from the past is multiplied by a fading factor (16 to 20; Zhou et al. 1992), so
that the gain rises and the residuals become white again. Without fading it is the filter ``cdkf``, bit for bit.

With ``H`` the (statistical) slope of the outputs and ``S`` the predicted covariance without process noise, (19) and
(20) read ``N = V - beta R - H Q H'`` and ``tr M = tr(H S H')``; only traces enter, so only the diagonal of ``V`` is
carried. Each output counts in units of its own noise variance, or the factor would depend on the units of the
outputs; with one output, as in the paper, nothing changes.
"""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.engine.compile import CompiledModel
from harness.engine.kernel_names import (
    LANES,
    NW,
    NX,
    NY,
    OUTPUTS_ARE_LINEAR,
    any_of,
    central_differences,
    cholesky,
    cross_covariance,
    get,
    maximum,
    outer_sum,
    output_jacobian,
    put,
    select,
    sigma_mean,
    sigma_update,
    splat,
)
from harness.estimation.methods._input_errors import correct, output_noise, spread_inputs
from harness.estimation.methods._sigma_points import observe, propagate

DEVICES = ("cuda",)


class Settings(BaseModel):
    """Interval of the central differences (11) and how old data fade (16 to 21)."""

    model_config = ConfigDict(extra="forbid")

    interval_squared: float = Field(
        3.0, ge=1, allow_inf_nan=False, description="h^2, square of the interval in standard deviations"
    )
    fading: bool = Field(True, description="whether old data fade; without, it is the filter cdkf")
    forgetting: float = Field(0.95, gt=0, le=1, description="forgetting factor of the residuals' covariance (21)")
    softening: float = Field(
        1.0, ge=1, allow_inf_nan=False, description="weakens the fading: weight of the measurement noise in (19)"
    )


# no KALMAN_TYPE: fading departs from the Kalman filter whenever residuals are larger than expected


def tuning(settings: Settings, nx: int, ny: int) -> list[float]:
    """Return ``h``, the weights ``W0m, Wim``, the roots of ``Wic1, Wic2`` (12), and the three settings of fading."""
    square = settings.interval_squared
    h = square**0.5
    weights = [h, (square - nx) / square, 0.5 / square, 0.5 / h, (square - 1) ** 0.5 / (2 * square)]
    return [*weights, float(settings.fading), settings.forgetting, settings.softening]


def memory_size(settings: BaseModel, compiled: CompiledModel) -> int:
    """Return how many rows of memory the filter carries: the residual variance of each output, 0 at first."""
    return compiled.ny


def workspace():
    """Return the scratch arrays of a run."""
    return (
        np.empty((NW, LANES)),
        np.empty((NX, LANES)),
        np.empty((NX, NX, LANES)),
        np.empty((NX, NX, LANES)),
        np.zeros((max(NX, NY), max(NX, NY), LANES)),
        np.empty((NX, LANES)),
        np.empty((2 * NX + 1, max(NX, NY), LANES)),
        np.empty((NY, LANES)),
        np.empty((NY, NX, LANES)),
        np.empty((2 * NX, LANES)),
        np.zeros((NX, LANES)),
    )


def step(before, u_before, u, y, belief, work, after, info):
    """Predict (13 to 15), fade (16 to 22) and correct (28 to 34)."""
    w, x_prior, spread, P_prior, factor, point, images, predicted, H, scratch, no_noise = work
    constants, r, tuned = belief.constants, output_noise(belief), belief.tuning
    h, w0m, wim, first, second, fading = tuned[0], tuned[1], tuned[2], tuned[3], tuned[4], tuned[5] > 0.5
    repaired = cholesky(before.covariance, factor, NX)
    propagate(before.mean, factor, h, u_before, constants, point, images, w)
    sigma_mean(images, w0m, wim, x_prior, NX)
    central_differences(images, first, second, NX)
    outer_sum(images, 0.0, 1.0, no_noise, spread, NX)
    inflate(spread, splat(1.0), belief, P_prior)
    for i in range(NY):
        put(get(before.memory, i), after.memory, i)
    if OUTPUTS_ARE_LINEAR:
        output_jacobian(x_prior, u, constants, predicted, H)
        if fading:
            inflate(spread, fading_factor(spread, H, predicted, y, belief, after.memory), belief, P_prior)
        correct(x_prior, P_prior, predicted, H, y, belief, after, scratch, info)
    else:
        repaired = maximum(repaired, cholesky(P_prior, factor, NX))
        observe(x_prior, factor, h, u, constants, point, images)
        sigma_mean(images, w0m, wim, predicted, NY)  # as printed, the innovation is that of the points not faded
        if fading:
            statistical_slopes(factor, images, 0.5 / h, H)
            fade = fading_factor(spread, H, predicted, y, belief, after.memory)
            if any_of(fade > 1.0):
                inflate(spread, fade, belief, P_prior)
                repaired = maximum(repaired, cholesky(P_prior, factor, NX))
                observe(x_prior, factor, h, u, constants, point, images)
        cross_covariance(factor, images, wim * h, H, NX, NY)
        central_differences(images, first, second, NY)
        failed = sigma_update(
            x_prior, P_prior, images, 0.0, 1.0, predicted, H, y, r, after.mean, after.covariance, factor, info
        )
        repaired = maximum(repaired, failed)
    put(repaired, info.repairs, 0)


def inflate(spread, fade, belief, P):
    """Write ``fade S + Q`` (16)."""
    q = belief.process_noise
    for i in range(NX):
        for j in range(NX):
            value = fade * get(spread, i, j)
            put(value + get(q, i) if i == j else value, P, i, j)
    spread_inputs(P, belief)


def statistical_slopes(factor, images, weight, H):
    """Write ``H = P_xz' P^-1`` (19): with ``P = L L'`` and ``P_xz = L d``, each row solves ``L' h = d``."""
    for a in range(NY):
        for i in range(NX - 1, -1, -1):
            value = weight * (get(images, 1 + i, a) - get(images, 1 + NX + i, a))
            for k in range(i + 1, NX):
                value = value - get(factor, k, i) * get(H, a, k)
            pivot = get(factor, i, i)
            put(select(pivot > 0.0, value / pivot, 0.0), H, a, i)


def fading_factor(spread, H, predicted, y, belief, memory):
    """Return the factor (17, 18) and update the residual variances (21).

    Before the first sample they are what the filter expects, where (22) takes the first residual for its variance: at
    the start ``S`` is small, and one large residual would fade everything that is known. Outputs that were not
    measured keep their variance and do not count; without any measurement nothing fades.
    """
    q, forgetting, softening = belief.process_noise, belief.tuning[6], belief.tuning[7]
    excess, expected = splat(0.0), splat(0.0)
    for a in range(NY):
        measured = get(y, a) == get(y, a)
        residual = get(y, a) - get(predicted, a)
        r = get(belief.measurement_noise, a)
        from_noise, from_past = splat(0.0), splat(0.0)
        for i in range(NX):
            slope = splat(0.0)
            for j in range(NX):
                slope = slope + get(spread, i, j) * get(H, a, j)
            from_past = from_past + get(H, a, i) * slope
            from_noise = from_noise + get(H, a, i) * get(H, a, i) * get(q, i)
        followed = get(memory, a)
        earlier = select(followed > 0.0, followed, from_past + from_noise + r)
        newest = (forgetting * earlier + residual * residual) / (1.0 + forgetting)
        followed = select(measured, newest, followed)
        put(followed, memory, a)
        excess = excess + select(measured, (followed - softening * r - from_noise) / r, 0.0)
        expected = expected + select(measured, from_past / r, 0.0)
    factor = excess / expected
    return select((expected > 0.0) & (factor > 1.0), factor, 1.0)
