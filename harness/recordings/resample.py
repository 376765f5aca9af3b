"""Bringing a channel onto the common time base: without aliases, without bridging gaps."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import scipy

from harness.common.arrays import Floats, Mask

_STOP_BAND = 60.0
"""dB by which what would fold back is weakened."""
_PASS_BAND = 0.6
"""Share of the new Nyquist frequency that passes unweakened."""
_AS_OFTEN = 1.05
"""Steps of a grid up to which samples come as often as its instants."""
_BESIDE = 0.75
"""Steps beside an instant at which a sample still counts as its own, with jitter; a dropped one is a step away."""


def segments(time: Floats, largest_gap: float) -> list[slice]:
    """Return the stretches in which no two samples are further apart than the largest gap."""
    cuts = np.flatnonzero(np.diff(time) > largest_gap) + 1
    edges = [0, *cuts.tolist(), len(time)]
    return [slice(a, b) for a, b in pairwise(edges) if b > a]


def onto_grid(time: Floats, values: Floats, grid: Floats, largest_gap: float, hold: bool = False) -> Floats:
    """Return a channel at the instants of a grid.

    Where the grid is coarser than the samples, a linear-phase low pass takes out what the grid cannot carry; else
    the samples are joined by Akima's spline, which does not ring around steps and spikes.

    Args:
        time: Increasing instants of the samples in s, shape ``(samples,)``.
        values: Samples, all finite.
        grid: Equidistant instants in s.
        largest_gap: Longest time in s between samples that is bridged.
        hold: Whether each value is held until the next sample, as that of a command.

    Returns:
        Values on the grid; NaN in gaps and more than half a step of the grid beyond the ends.
    """
    result = np.full(len(grid), np.nan)
    if len(time) < 2 or len(grid) < 2:
        return result
    usual, step = float(np.median(np.diff(time))), float(grid[1] - grid[0])
    reach = step / 2 * (1 + 1e-6)
    for part in segments(time, largest_gap):
        t, x = time[part], values[part]
        first, last = np.searchsorted(grid, [t[0] - reach, t[-1] + reach + (usual if hold else 0.0)])
        wanted = grid[first:last]
        if hold:
            result[first:last] = x[np.maximum(np.searchsorted(t, wanted + 1e-9, side="right") - 1, 0)]
        elif len(t) == 1:
            result[first:last] = x[0]
        else:
            if step > 1.2 * usual:
                t, x = _low_pass(t, x, usual, step)
            result[first:last] = _join(t, x, np.clip(wanted, t[0], t[-1]))
    return result


def updated_on_grid(time: Floats, grid: Floats) -> Mask:
    """Return the instants of a grid at which the value is measured, not joined over a dropped or slower sample.

    They are the nearest to some sample. Where samples come as often as the instants, but with jitter or between them,
    one may be the nearest to two instants.
    """
    step = grid[1] - grid[0]
    nearest = np.rint((time - grid[0]) / step).astype(int)
    found = np.zeros(len(grid), dtype=bool)
    found[nearest[(nearest >= 0) & (nearest < len(grid))]] = True
    if len(time) > 1 and np.median(np.diff(time)) < _AS_OFTEN * step:
        after = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
        found |= np.minimum(np.abs(grid - time[after - 1]), np.abs(time[after] - grid)) < _BESIDE * step
    return found


def first_order_lag(values: Floats, step: float, time_constant: float) -> Floats:
    """Return the response of a first-order lag to values that are held from sample to sample (exact).

    The lag starts settled, and again settled after a gap.
    """
    if time_constant == 0:
        return values
    keep = np.exp(-step / time_constant)
    result = np.full(len(values), np.nan)
    state = np.nan
    for k, value in enumerate(values):
        state = value if np.isnan(state) else state
        result[k] = state
        state = keep * state + (1 - keep) * value
    return result


def _low_pass(time: Floats, values: Floats, usual: float, step: float) -> tuple[Floats, Floats]:
    """Return a stretch on equidistant instants of its own, without what lies beyond the Nyquist of ``step``."""
    count = max(int(np.ceil((time[-1] - time[0]) / usual)) + 1, 2)
    fine = np.linspace(time[0], time[-1], count)
    rate = 1 / (fine[1] - fine[0])
    nyquist = 0.5 / step
    taps, beta = scipy.signal.kaiserord(_STOP_BAND, (1 - _PASS_BAND) * nyquist / (0.5 * rate))
    taps |= 1
    weights = scipy.signal.firwin(taps, (1 + _PASS_BAND) / 2 * nyquist, window=("kaiser", beta), fs=rate)
    padded = np.pad(_join(time, values, fine), taps // 2, mode="reflect", reflect_type="odd")
    return fine, np.convolve(padded, weights, mode="valid")


def _join(time: Floats, values: Floats, wanted: Floats) -> Floats:
    """Interpolate inside a stretch."""
    if len(time) < 3:
        return np.interp(wanted, time, values)
    return np.asarray(scipy.interpolate.Akima1DInterpolator(time, values, method="makima")(wanted))
