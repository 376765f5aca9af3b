"""Kernels shared by the estimators that send sigma points through the model."""

from __future__ import annotations

import numpy as np

from harness.engine.kernel_names import (
    LANES,
    LEADING,
    NW,
    NX,
    NY,
    get,
    leading_part,
    next_state,
    next_state_behind,
    output,
    put,
)


def workspace():
    """Return the scratch arrays of a run."""
    return (
        np.empty((NW, LANES)),
        np.empty((NX, LANES)),
        np.empty((NX, NX, LANES)),
        np.zeros((max(NX, NY), max(NX, NY), LANES)),
        np.empty((NX, LANES)),
        np.empty((2 * NX + 1, max(NX, NY), LANES)),
        np.empty((NY, LANES)),
        np.empty((NY, NX, LANES)),
        np.empty((2 * NX, LANES)),
    )


def displace(mean, factor, distance, s, point):
    """Write sigma point ``s`` (Ziaukas 2.19): the mean, then one ahead and one behind along each column.

    Point ``1 + k`` lies ``distance`` standard deviations ahead along column ``k`` of the lower Cholesky factor,
    point ``1 + nx + k`` as far behind. Columns are zero above the diagonal, so a point drawn after the one before it
    differs from it only from row ``k`` on; ``point`` must hold point ``s - 1`` (or nothing, if ``s`` is 0).
    """
    if s == 0:
        for i in range(NX):
            put(get(mean, i), point, i)
    else:
        k = s - 1 if s <= NX else s - 1 - NX
        step = distance if s <= NX else -distance
        if k > 0:
            put(get(mean, k - 1), point, k - 1)
        for i in range(k, NX):
            put(get(mean, i) + step * get(factor, i, k), point, i)


def propagate(mean, factor, distance, u, constants, point, images, w):
    """Write the next state of every sigma point (2.22), ``(2 nx + 1, >= nx, LANES)``.

    Points along the columns from ``LEADING`` on have the first states of the mean, and what follows from these alone.
    """
    leading_part(mean, u, constants, w)
    for s in range(2 * NX + 1):
        displace(mean, factor, distance, s, point)
        if s > 0 and (s - 1) % NX >= LEADING:
            next_state_behind(point, u, constants, images[s], w)
        else:
            next_state(point, u, constants, images[s], w)


def observe(mean, factor, distance, u, constants, point, images):
    """Write the output of every sigma point (2.25), ``(2 nx + 1, >= ny, LANES)``."""
    for s in range(2 * NX + 1):
        displace(mean, factor, distance, s, point)
        output(point, u, constants, images[s])
