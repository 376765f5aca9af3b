"""Unscented Kalman filter in square-root form: a factor of the covariance is carried (van der Merwe and Wan 2001).

Points, weights and settings are those of the UKF. The factor of the predicted covariance is the triangle of the
weighted distances of the points and the process noise (their QR update), from which a centre of negative weight is
taken away (their Cholesky downdate). Van der Merwe and Wan then take the gain's share away from that factor in as many
downdates as there are measurements, each of which may fail. Here points of outputs and states stand side by side in one
array, whose triangle holds the corrected factor; the numbers are the same.
"""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import (
    LANES,
    NW,
    NX,
    NY,
    OUTPUTS_ARE_LINEAR,
    deviations,
    get,
    maximum,
    output_jacobian,
    put,
    sigma_mean,
    splat,
)
from harness.estimation.methods._input_errors import output_noise
from harness.estimation.methods._sigma_points import observe, propagate
from harness.estimation.methods._square_root import (
    correct_by_array,
    factor_before,
    put_noise,
    put_source,
    room,
    take_away,
    triangularise,
)
from harness.estimation.methods._square_root import memory_size as memory_size
from harness.estimation.methods.ukf import Settings as Settings
from harness.estimation.methods.ukf import tuning as tuning

KALMAN_TYPE = True


def workspace():
    """Return the scratch arrays of a run."""
    return (
        np.empty((NW, LANES)),
        np.empty((NX, LANES)),
        np.empty((NX, NX, LANES)),
        np.empty((NX, LANES)),
        np.empty((2 * NX + 1, max(NX, NY), LANES)),
        np.empty((NY, LANES)),
        np.zeros((NY, NX, LANES)),
        np.empty((NY + NX, NY + NX, LANES)),
        np.empty((1, NY + NX, LANES)),
    )


def step(before, u_before, u, y, belief, work, after, info):
    """Predict with sigma points, then correct by the array of points and noise."""
    w, x_prior, factor, point, images, predicted, H, L, centre = work
    constants, r = belief.constants, belief.measurement_noise
    distance, w0m, w0c, wi = belief.tuning[0], belief.tuning[1], belief.tuning[2], belief.tuning[3]
    A, minus = room(2 * NX + 1, belief), centre[: 1 if w0c < 0.0 else 0]
    repaired = factor_before(before, belief, factor)
    propagate(before.mean, factor, distance, u_before, constants, point, images, w)
    sigma_mean(images, w0m, wi, x_prior, NX)
    deviations(images, x_prior, NX)
    if OUTPUTS_ARE_LINEAR:  # else the slopes are zero: the points are drawn anew for the outputs
        output_jacobian(x_prior, u, constants, predicted, H)
    for s in range(2 * NX + 1):
        root = (wi if s > 0 else abs(w0c)) ** 0.5
        for i in range(NX):
            put(root * get(images, s, i), A, s, NY + i)
        put_source(A, s, H)
    set_centre(A, w0c, centre)
    rows = put_noise(A, 2 * NX + 1, belief, H)
    if not OUTPUTS_ARE_LINEAR:
        triangularise(A, rows, NY, NX, factor)
        if w0c < 0.0:
            repaired = maximum(repaired, take_away(factor, centre[0, NY:], NX))
        observe(x_prior, factor, distance, u, constants, point, images)
        sigma_mean(images, w0m, wi, predicted, NY)
        deviations(images, predicted, NY)
        put_outputs(A, images, factor, distance, wi, w0c)
        set_centre(A, w0c, centre)
        rows, r = 2 * NX + 1, output_noise(belief)
    failed = correct_by_array(A, rows, minus, r, x_prior, predicted, y, L, after, info)
    put(maximum(repaired, failed), info.repairs, 0)


def set_centre(A, w0c, centre):
    """Move the row of the centre out of the array where its weight is negative, to be taken away."""
    if w0c < 0.0:
        for j in range(NY + NX):
            put(get(A, 0, j), centre, 0, j)
            put(splat(0.0), A, 0, j)


def put_outputs(A, images, factor, distance, wi, w0c):
    """Write rows of the distances of outputs, and of the points they belong to."""
    for s in range(2 * NX + 1):
        root = (wi if s > 0 else abs(w0c)) ** 0.5
        for a in range(NY):
            put(root * get(images, s, a), A, s, a)
        for i in range(NX):
            k = (s - 1) % NX
            away = root * (distance if s <= NX else -distance)
            put(away * get(factor, i, k) if s > 0 else splat(0.0), A, s, NY + i)
