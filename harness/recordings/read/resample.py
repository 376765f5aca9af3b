"""Bringing a channel onto the common time base: without aliases, without bridging gaps."""

from __future__ import annotations

import functools
from itertools import pairwise

import numpy as np
import scipy

from harness.common.arrays import Floats, Mask

_WIDEST = 1.0 / 3.0
"""Share of the Nyquist frequency over which a low pass falls, below it and above it, where samples allow that."""
_NARROWEST = 0.025
"""The same where they come hardly faster than the instants; of white noise so much is left out or counted twice."""
_REACH = 10.0
"""Steps on either side over which the widest one weighs samples."""
_JOINED = 100
"""Samples on either side over which they are joined."""
_KAISER = 9.0
"""Parameter of the window over these: its side lobes lie 90 dB lower."""
_PARTS = 256
"""Of a step, for each of which a weight is computed."""
_TURNS = 8
"""Times its reach after which a pulse of the low pass repeats itself."""
_AT_ONCE = 1_000_000
"""Weights."""
_AROUND = 4
"""Samples next to a stretch that is joined, on which the ends of its curve depend."""
_ON_TIME = 1e-6
"""Samples by which an instant may be off one to be its own."""
_AS_OFTEN = 1.05
"""Steps of a grid up to which samples come as often as its instants."""
_BESIDE = 0.75
"""Steps off an instant at which a sample still counts as its own, with jitter; a dropped one is a step away."""


def segments(time: Floats, largest_gap: float) -> list[slice]:
    """Return the stretches in which no two samples are further apart than the largest gap."""
    cuts = np.flatnonzero(np.diff(time) > largest_gap) + 1
    edges = [0, *cuts.tolist(), len(time)]
    return [slice(a, b) for a, b in pairwise(edges) if b > a]


def onto_grid(time: Floats, values: Floats, grid: Floats, largest_gap: float, hold: bool = False) -> Floats:
    """Return a channel at the instants of a grid.

    The samples are joined by a band-limited function; where the grid is coarser, without what it cannot carry. White
    noise stays white: a filter takes noise that is white as evidence, and other noise as something that its model
    lacks. Samples that come at the instants are left as they are.

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
            result[first:last] = _band_limited(t, x, usual, step, np.clip(wanted, t[0], t[-1]))
    return result


def updated_on_grid(time: Floats, grid: Floats) -> Mask:
    """Return the instants of a grid at which the value is measured, not joined over a dropped or slower sample.

    They are the nearest to some sample. Where samples come as often as the instants, but with jitter or between them,
    one may be the nearest to two instants.
    """
    step = grid[1] - grid[0]
    nearest = np.rint((time - grid[0]) / step).astype(int)
    is_new = np.zeros(len(grid), dtype=bool)
    is_new[nearest[(nearest >= 0) & (nearest < len(grid))]] = True
    if is_new.all():
        return is_new
    if len(time) > 1 and np.median(np.diff(time)) < _AS_OFTEN * step:
        after = np.clip(np.searchsorted(time, grid), 1, len(time) - 1)
        is_new |= np.minimum(np.abs(grid - time[after - 1]), np.abs(time[after] - grid)) < _BESIDE * step
    return is_new


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


def _band_limited(time: Floats, values: Floats, usual: float, step: float, wanted: Floats) -> Floats:
    """Return a stretch at some instants inside of it, without what a grid of ``step`` cannot carry."""
    fine = np.linspace(time[0], time[-1], 1 + int(np.maximum(np.rint(np.diff(time) / usual), 1.0).sum()))
    apart, joined = float(fine[1] - fine[0]), _join(time, values, fine)
    places = (wanted - fine[0]) / apart
    del fine, wanted  # of a long recording each such array is much
    if step > (1.0 + _NARROWEST) * apart:
        unit, (distances, pulse) = step, _low_pass(min(step / apart - 1.0, _WIDEST))
    else:
        own = np.rint(places)
        if np.all(np.abs(places - own) < _ON_TIME):
            return joined[own.astype(int)]
        unit, (distances, pulse) = apart, _interpolation()
    taps = int(2 * distances[-1] * unit / apart) + 2
    padded = np.pad(joined, taps, mode="reflect", reflect_type="odd")
    result, many = np.empty(len(places)), max(1, _AT_ONCE // taps)
    for begin in range(0, len(places), many):
        at = places[begin : begin + many, None]
        samples = np.floor(at).astype(int) + np.arange(1 - taps // 2, taps - taps // 2 + 1)
        weights = np.interp(np.abs(samples - at) * (apart / unit), distances, pulse, right=0.0)
        result[begin : begin + many] = (weights * padded[samples + taps]).sum(axis=1) / weights.sum(axis=1)
    return result


@functools.cache
def _interpolation() -> tuple[Floats, Floats]:
    """Return distances in samples, and the weight of a sample there: a sinc within a window of Kaiser (1974).

    Up to close below the Nyquist frequency it shifts samples in time and changes nothing else of them.
    """
    distances = np.arange(_JOINED * _PARTS + 1) / _PARTS
    return distances, np.sinc(distances) * np.kaiser(2 * len(distances) - 1, _KAISER)[len(distances) - 1 :]


@functools.lru_cache(maxsize=16)
def _low_pass(roll_off: float) -> tuple[Floats, Floats]:
    """Return distances in steps of the grid, and the weight of a sample there.

    The pulse is Meyer's scaling function (1985; Daubechies 1992, 5.2): its transfer function is 1 up to ``1 -
    roll_off`` of the Nyquist frequency and 0 from ``1 + roll_off`` on, and what its square loses below the Nyquist
    frequency folds back from above. So pulses a whole number of steps apart are orthogonal, and samples of white noise
    stay independent.
    """
    reach = _REACH * _WIDEST / roll_off
    long = int(_TURNS * reach)
    frequency = np.arange(long * _PARTS // 2 + 1) / long
    x = np.clip((2.0 * frequency - (1.0 - roll_off)) / (2.0 * roll_off), 0.0, 1.0)
    gain = np.cos(0.5 * np.pi * x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3))
    distances = np.arange(int(reach * _PARTS) + 1) / _PARTS
    return distances, np.fft.irfft(gain)[: len(distances)]


def _join(time: Floats, values: Floats, wanted: Floats) -> Floats:
    """Interpolate inside a stretch, piece by piece: the coefficients are many times the samples.

    An interpolant between two samples depends on two more on either side.
    """
    if len(time) < 3:
        return np.interp(wanted, time, values)
    result = np.empty(len(wanted))
    for begin in range(0, len(time) - 1, _AT_ONCE):
        stop = min(begin + _AT_ONCE, len(time) - 1)
        here = slice(max(begin - _AROUND, 0), stop + _AROUND + 1)
        first, last = (0 if k == 0 else len(wanted) if k == len(time) - 1 else np.searchsorted(wanted, time[k])
                       for k in (begin, stop))  # fmt: skip
        curve = scipy.interpolate.Akima1DInterpolator(time[here], values[here], method="makima")
        result[first:last] = curve(wanted[first:last])
    return result
