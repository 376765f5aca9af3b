"""Unscented Kalman filter in the additive form (Ziaukas 2.19 to 2.31; van der Merwe 2004).

Where the outputs are linear in the state, the measurement update is written in closed form; it equals the one
with sigma points redrawn from the predicted covariance. Otherwise they are redrawn, because points that skip
the process noise (2.25 as printed) make the innovation covariance too small.
"""

from __future__ import annotations

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.kernel import (
    LANES,
    NW,
    NX,
    NY,
    OUTPUTS_ARE_LINEAR,
    cholesky,
    get,
    next_state,
    output,
    output_jacobian,
    put,
    scalar_updates,
    sigma_update,
    splat,
)


class Settings(BaseModel):
    """Spread of the sigma points (2.20, 2.21); the defaults are the thesis's (5.5)."""

    model_config = ConfigDict(extra="forbid")

    alpha: float = Field(1.0, gt=0, description="spread of the points around the mean")
    beta: float = Field(2.0, description="prior knowledge of the distribution; 2 for a normal one")
    kappa: float = Field(0.0, description="adjusts the fourth moment")


HAS_COVARIANCE = True
KALMAN_TYPE = True


def tuning(settings: Settings, nx: int, ny: int) -> list[float]:
    """Return the distance of the points in standard deviations and the weights ``w0m, w0c, wi`` (2.20, 2.21)."""
    total = settings.alpha**2 * (nx + settings.kappa)  # n + lambda
    if total <= 0:
        raise ValueError(f"alpha^2 (n + kappa) = {total:g} must be positive; raise kappa above {-nx}")
    first = (total - nx) / total
    return [total**0.5, first, first + 1 - settings.alpha**2 + settings.beta, 0.5 / total]


def memory_size(nx: int, ny: int) -> int:
    """Return how many rows of memory the filter carries beside mean and covariance."""
    return 0


def workspace():
    """Return the scratch arrays of a run."""
    return (
        np.empty((NW, LANES)),
        np.empty((NX, LANES)),
        np.empty((NX, NX, LANES)),
        np.zeros((NX, NX, LANES)),
        np.empty((2 * NX + 1, NX, LANES)),
        np.empty((2 * NX + 1, max(NX, NY), LANES)),
        np.empty((NY, LANES)),
        np.empty((NY, NX, LANES)),
        np.empty((2 * NX + 2 * NY, LANES)),
    )


def draw(mean, factor, distance, points):
    """Write the 2n + 1 sigma points (2.19); ``factor`` is the lower Cholesky factor of the covariance."""
    for i in range(NX):
        m = get(mean, i)
        put(m, points, 0, i)
        for k in range(NX):
            # column k of a lower factor is zero above its diagonal
            d = distance * get(factor, i, k) if k <= i else splat(0.0)
            put(m + d, points, 1 + k, i)
            put(m - d, points, 1 + NX + k, i)


def moments(points, w0m, w0c, wi, noise, mean, covariance):
    """Write weighted mean (2.23) and covariance (2.24); ``points`` become differences from the mean."""
    for i in range(NX):
        total = splat(0.0)
        for s in range(1, 2 * NX + 1):
            total = total + get(points, s, i)
        m = w0m * get(points, 0, i) + wi * total
        put(m, mean, i)
        for s in range(2 * NX + 1):
            put(get(points, s, i) - m, points, s, i)
    for i in range(NX):
        for j in range(i + 1):
            total = splat(0.0)
            for s in range(1, 2 * NX + 1):
                total = total + get(points, s, i) * get(points, s, j)
            value = wi * total + w0c * get(points, 0, i) * get(points, 0, j)
            if i == j:
                value = value + get(noise, i)
            put(value, covariance, i, j)
            put(value, covariance, j, i)


def step(before, u_before, u, y, belief, work, after, info):
    """Predict with sigma points (2.22 to 2.24) and correct with the measurement (2.25 to 2.31)."""
    w, x_prior, P_prior, factor, points, images, predicted, H, scratch = work
    distance, w0m, w0c, wi = belief.tuning[0], belief.tuning[1], belief.tuning[2], belief.tuning[3]
    repaired = cholesky(before.covariance, factor, NX)
    draw(before.mean, factor, distance, images)
    for s in range(2 * NX + 1):
        next_state(images[s], u_before, belief.constants, points[s], w)
    moments(points, w0m, w0c, wi, belief.process_noise, x_prior, P_prior)
    if OUTPUTS_ARE_LINEAR:
        output_jacobian(x_prior, u, belief.constants, predicted, H)
        scalar_updates(
            x_prior,
            P_prior,
            predicted,
            H,
            y,
            belief.measurement_noise,
            after.mean,
            after.covariance,
            scratch,
            info,
        )
    else:
        repaired = repaired + cholesky(P_prior, factor, NX)
        draw(x_prior, factor, distance, points)
        for s in range(2 * NX + 1):
            output(points[s], u, belief.constants, images[s])
        repaired = repaired + sigma_update(
            x_prior, P_prior, points, images, w0m, w0c, wi, y, belief.measurement_noise,
            after.mean, after.covariance, predicted, H, factor, info,
        )  # fmt: skip
    put(repaired, info.repairs, 0)
