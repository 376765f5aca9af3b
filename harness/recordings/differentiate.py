"""Smoothing and differentiation of equidistant samples by local polynomials (Savitzky and Golay 1964).

The value, slope and curvature in the middle of a window are those of the cubic that fits the window best: no delay,
and no bias for signals that are cubic over the window. The noise of a slope falls with the window to the power 3/2.
"""

from __future__ import annotations

import numpy as np
import scipy

from harness.common.arrays import Floats

_DEGREE = 3


def local_polynomial(values: Floats, step: float, window: float, derivative: int = 0) -> Floats:
    """Return the signal or a derivative of it, smoothed by a local cubic.

    Args:
        values: Samples of shape ``(samples,)``; NaN where missing.
        step: Time between them in s.
        window: Length of the window in s; at least five samples are taken.
        derivative: 0, 1 or 2.

    Returns:
        Array of the same shape in unit/s^derivative; NaN where the window holds a missing sample, and half a window
        from either end.
    """
    half = max(round(window / step / 2), 2)
    result = np.full(len(values), np.nan)
    if len(values) > 2 * half:
        weights = scipy.signal.savgol_coeffs(2 * half + 1, _DEGREE, deriv=derivative, delta=step, use="conv")
        result[half : len(values) - half] = np.convolve(values, weights, mode="valid")
    return result
