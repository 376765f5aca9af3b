"""Smoothing and differentiation of equidistant samples by local polynomials (Savitzky and Golay 1964).

The value, slope and curvature in the middle of a window are those of the cubic that fits the window best: no delay,
and no bias for signals that are cubic over the window. The noise of a slope falls with the window to the power 3/2.
"""

from __future__ import annotations

import numpy as np
import scipy

from harness.common.arrays import Floats

_DEGREE = 3


def local_polynomial(
    values: Floats, step: float, window: float, derivative: int = 0, alike: int | None = None
) -> Floats:
    """Return the signal or a derivative of it, smoothed by a local cubic.

    The polynomial's value, slope and curvature pass frequencies differently, so that the slope of an angle and the
    value of its rate are not alike. Signals and derivatives that are to be compared are smoothed ``alike``: by the
    kernel of which the highest derivative among them is that of the polynomial.

    Args:
        values: Samples of shape ``(samples,)``; NaN where missing.
        step: Time between them in s.
        window: Length of the window in s; at least five samples are taken.
        derivative: 0, 1 or 2.
        alike: Highest derivative in the comparison, at least ``derivative``; None: each as the polynomial has it.

    Returns:
        Array of the same shape in unit/s^derivative; NaN where the window holds a missing sample, and half a window
        from either end.
    """
    half = max(round(window / step / 2), 2)
    result = np.full(len(values), np.nan)
    if len(values) > 2 * half:
        order = derivative if alike is None else alike
        weights = scipy.signal.savgol_coeffs(2 * half + 1, _DEGREE, deriv=order, delta=step, use="conv")
        for _ in range(order - derivative):  # the integral of a kernel without sum, by the trapezoidal rule
            weights = step * np.convolve(np.cumsum(weights)[:-1], [0.5, 0.5])
        result[half : len(values) - half] = np.convolve(values, weights, mode="valid")
    return result
