"""Bringing a channel onto the common time base: without aliases, without bridging gaps."""

from __future__ import annotations

import functools
from itertools import pairwise

import numpy as np
import scipy

from harness.common.arrays import Floats, Mask

_ROLL_OFF = 1.0 / 3.0
"""Share of the new Nyquist frequency over which the low pass falls, below it and above it."""
_REACH = 8
"""Steps of the grid on either side over which it weighs samples; behind that it would add less than 60 dB."""
_PARTS = 256
"""Of a step of the grid, for each of which a weight is computed."""
_AT_ONCE = 1_000_000
"""Weights."""
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

    Where the grid is coarser than the samples, a linear-phase low pass takes out what the grid cannot carry and leaves
    white noise white; else the samples are joined by Akima's spline, which does not ring around steps and spikes.

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
            at = np.clip(wanted, t[0], t[-1])
            result[first:last] = _low_pass(t, x, usual, step, at) if step > 1.2 * usual else _join(t, x, at)
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


def _low_pass(time: Floats, values: Floats, usual: float, step: float, wanted: Floats) -> Floats:
    """Return a stretch without what a grid of ``step`` cannot carry, at some instants inside of it.

    A filter takes noise that is white after it as evidence, and noise that is not as something that its model lacks.
    """
    fine = np.linspace(time[0], time[-1], 1 + int(np.maximum(np.rint(np.diff(time) / usual), 1.0).sum()))
    apart = fine[1] - fine[0]
    taps = int(2 * _REACH * step / apart) + 2
    padded = np.pad(_join(time, values, fine), taps, mode="reflect", reflect_type="odd")
    found = np.empty(len(wanted))
    many = max(1, _AT_ONCE // taps)
    for begin in range(0, len(wanted), many):
        at = (wanted[begin : begin + many] - fine[0]) / apart
        samples = np.floor(at).astype(int)[:, None] + np.arange(1 - taps // 2, taps - taps // 2 + 1)
        distance = np.abs(samples - at[:, None]) * (apart / step)
        weights = np.interp(distance * _PARTS, np.arange(_REACH * _PARTS + 1), _pulse(), right=0.0)
        found[begin : begin + many] = (weights * padded[samples + taps]).sum(axis=1) / weights.sum(axis=1)
    return found


@functools.cache
def _pulse() -> Floats:
    """Return the impulse response of the low pass over the distance in steps of the grid.

    It is the scaling function of Meyer (1985; Daubechies 1992, 5.2): its transfer function is 1 up to two thirds of the
    Nyquist frequency and 0 from four thirds on, and what its square loses below the Nyquist frequency comes back by
    folding from above. So pulses a whole number of steps apart are orthogonal, and samples of white noise independent.
    """
    frequency, width = np.linspace(0.0, 0.5 * (1.0 + _ROLL_OFF), 4001, retstep=True)
    x = np.clip((2.0 * frequency - (1.0 - _ROLL_OFF)) / (2.0 * _ROLL_OFF), 0.0, 1.0)
    gain = np.cos(0.5 * np.pi * x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3))
    distance = np.arange(_REACH * _PARTS + 1) / _PARTS
    return np.asarray(np.trapezoid(np.cos(2.0 * np.pi * np.outer(distance, frequency)) * gain, dx=float(width)))


def _join(time: Floats, values: Floats, wanted: Floats) -> Floats:
    """Interpolate inside a stretch."""
    if len(time) < 3:
        return np.interp(wanted, time, values)
    return np.asarray(scipy.interpolate.Akima1DInterpolator(time, values, method="makima")(wanted))
