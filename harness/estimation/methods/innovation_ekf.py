"""Extended Kalman filter that adapts its noise to its innovations (Mehra 1972; Mohamed and Schwarz 1999).

A filter whose noise is right expects innovations ``v`` of the variances ``S = H P^- H' + R``. What is more or less is
put down to one of two:

* the process noise, all of which is multiplied by one factor, so that it stays what it is between the states. Its
  logarithm climbs the likelihood of the innovations (Mehra 1972), a sample at a time: by the mean of ``v^2 / S - 1``
  over the measurements, each weighed by the share ``1 - R / S`` of its variance that the states have in it. Beyond
  three standard deviations an innovation counts as three;
* the measurement noise, ``R = C_e + H P^+ H'`` with the mean square ``C_e`` of what is left behind the correction over
  an exponential window, which is never negative (Mohamed and Schwarz 1999).

Mehra (1972) shows that both at once are not determined by the innovations alone.
"""

from __future__ import annotations

from typing import Literal

import numpy as np
from pydantic import BaseModel, ConfigDict, Field

from harness.engine.compile import CompiledModel
from harness.engine.kernel_names import LANES, NX, NY, exp, get, maximum, minimum, put, select, splat
from harness.estimation.methods._input_errors import correct
from harness.estimation.methods._linearised import linear_workspace, predict, residual_square, with_measurement_noise

DEVICES = ("cuda",)
REMEDY = "adapt the process noise to the innovations"

MOST_DIFFERENT = 6.9  # logarithm of a thousand, the most that the factor is and one over the least
LARGEST_SQUARE = 9.0  # in variances, of an innovation that counts: beyond three deviations it is an outlier


class Settings(BaseModel):
    """What is adapted, and how fast."""

    model_config = ConfigDict(extra="forbid")

    adapts: Literal["process", "measurement"] = Field(
        "process", description="the noise that innovations are put down to"
    )
    window: float = Field(200.0, ge=2, le=1e6, description="samples with a measurement over which the noise is found")


# no KALMAN_TYPE: its noise is not the one it is told


def tuning(settings: Settings, nx: int, ny: int) -> list[float]:
    """Return whether process noise is adapted, and the weight of a sample."""
    return [float(settings.adapts == "process"), 1.0 / settings.window]


def memory_size(settings: BaseModel, compiled: CompiledModel) -> int:
    """Return how many rows it carries: variances of the sensors, 0 at first, and the logarithm of the factor."""
    return compiled.ny + 1


def workspace():
    """Return the scratch arrays of a run: those of a linearised filter, and variances."""
    return linear_workspace(), np.empty((NY, LANES))


def step(before, u_before, u, y, belief, work, after, info):
    """Predict and correct with the noise found so far, then follow what the sample says of it."""
    linear, r = work
    of_process, weight = belief.tuning[0] > 0.5, belief.tuning[1]
    predict(before, u_before, u, belief, linear)
    _, x_prior, P_prior, predicted, H, scratch = linear
    more = exp(get(before.memory, NY)) - 1.0
    for i in range(NX):
        put(get(P_prior, i, i) + more * get(belief.process_noise, i), P_prior, i, i)
    for a in range(NY):
        believed, estimated = get(belief.measurement_noise, a), get(before.memory, a)
        put(believed if of_process else select(estimated > 0.0, estimated, believed), r, a)
    correct(x_prior, P_prior, predicted, H, y, with_measurement_noise(belief, r), after, scratch, info)
    put(splat(0.0), info.repairs, 0)
    put(get(before.memory, NY), after.memory, NY)
    if of_process:
        for a in range(NY):
            put(get(before.memory, a), after.memory, a)
        moved = get(before.memory, NY) + weight * climb(y, r, info)
        put(minimum(maximum(moved, splat(-MOST_DIFFERENT)), splat(MOST_DIFFERENT)), after.memory, NY)
    else:
        for a in range(NY):
            value = get(r, a) + weight * (residual_square(after, linear, y, a) - get(r, a))
            put(select(get(y, a) == get(y, a), value, get(r, a)), after.memory, a)


def climb(y, r, info):
    """Return by how much innovations are larger than expected, over what is expected; 0 without a measurement."""
    excess, total = splat(0.0), splat(0.0)
    for a in range(NY):
        measured = get(y, a) == get(y, a)
        variance, innovation = get(info.innovation_covariance, a, a), get(info.innovation, a)
        share = 1.0 - get(r, a) / variance
        square = minimum(innovation * innovation / variance, splat(LARGEST_SQUARE))
        excess = excess + select(measured, share * (square - 1.0), 0.0)
        total = total + select(measured, share, 0.0)
    return select(total > 0.0, excess / total, 0.0)
