"""Checks of single channels: clocks that jump, repeated samples, spikes."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy
from numpy.typing import NDArray

from harness.common.arrays import Floats, Mask
from harness.common.errors import UserError

_OUT_OF_ORDER = 0.01
"""Share of the stamps that may stand still or jump back; with more of them the clock is unusable."""
_SAME = 1e-9
"""s; stamps that are no further apart are of one instant: no recorder takes two samples within it."""
_STOPS = 3
"""Values that a quantity between stops returns to: one at either side and one between."""
_SHORT = 4
"""Updates that a run of equal values stands for at most if its length is to tell their distance."""
_SPIKE = 12.0
"""A spike leaves the median of its neighbourhood by this many robust standard deviations of what is usual."""


@dataclass(frozen=True)
class Clock:
    """A clock that increases.

    Attributes:
        time: Stamps in s of the rows kept.
        rows: Which rows of the file they are.
        step: Median time between them in s.
        warnings: What was wrong with the stamps.
    """

    time: Floats
    rows: NDArray[np.intp]
    step: float
    warnings: tuple[str, ...]

    def of(self, column: Floats) -> Floats:
        """Return a column of the file ``(rows of the file,)`` in the rows kept; not to be written to."""
        return np.asarray(column if len(self.rows) == len(column) else column[self.rows], dtype=float)


def check_clock(stamps: Floats, where: str, of: NDArray[np.intp] | None = None) -> Clock:
    """Keep the rows whose stamp is later than every one before.

    Args:
        stamps: Of all rows of a file, in s.
        where: File and column, for messages.
        of: Rows of the clock; all by default.

    Raises:
        UserError: If fewer than two rows are left, or too many stamps repeat or jump back.
    """
    own = np.arange(len(stamps)) if of is None else of
    finite = np.isfinite(stamps[own])
    time = np.where(finite, stamps[own], np.nan)
    latest = np.maximum.accumulate(np.where(finite, time, -np.inf))
    later = finite & np.concatenate([[True], time[1:] - latest[:-1] > _SAME])
    del latest  # of a long recording such an array is much
    rows = np.flatnonzero(later)
    bad = np.flatnonzero(~later)
    if len(rows) < 2:
        raise UserError(f"{where}: no two stamps increase; is this the column of the time?")
    warnings = []
    if bad.size:
        first = int(bad[0])
        evidence = f"first at row {own[first] + 1}, where {time[first]:.6g} s follows {time[max(first - 1, 0)]:.6g} s"
        if bad.size > _OUT_OF_ORDER * len(stamps):
            raise UserError(
                f"{where}: {bad.size} of {len(own)} stamps are missing, repeat or jump back ({evidence}); "
                "sort the rows, or cut the file where the clock was set"
            )
        warnings.append(f"{where}: {bad.size} rows left out whose stamp is missing, repeats or jumps back ({evidence})")
    kept, of_file = (time[rows], own[rows]) if bad.size else (time, own)
    return Clock(kept, of_file, float(np.median(np.diff(kept))), tuple(warnings))


def updates(values: Floats) -> tuple[Mask, int]:
    """Tell samples that a slower channel delivered from those that only repeat the latest one.

    A recorder that writes rows faster than a channel delivers repeats its latest value, so that nearly no run of equal
    values is shorter than the ratio of the rates, and all are multiples of it. A channel that merely moves slowly over
    coarse steps has runs of every length, down to one; one that rests as long as it pleases, such as a steering angle
    that goes from lock to lock, has runs that are multiples of nothing, or keeps returning to the same few values.

    Args:
        values: Samples of shape ``(samples,)``; NaN where missing.

    Returns:
        Which samples are new, and how many rows one of them usually stands for (1: nothing is repeated). Inside a run
        longer than that, new samples of the same value are taken to have come at the usual distance.
    """
    change = np.flatnonzero(values[1:] != values[:-1]) + 1
    if len(change) < 5:
        return np.isfinite(values), 1
    runs = np.diff(change)
    ratio = int(np.percentile(runs, 10, method="lower"))
    if ratio < 2 or not _in_step(runs, ratio) or len(np.unique(values[change])) <= _STOPS:
        return np.isfinite(values), 1
    new = np.zeros(len(values), dtype=bool)
    starts = np.concatenate([[0], change])
    for start, stop in zip(starts, np.append(change, len(values)), strict=True):
        new[start : max(stop - ratio // 2, start + 1) : ratio] = True
    return new & np.isfinite(values), ratio


def _in_step(runs: NDArray[np.int64], ratio: int) -> bool:
    """Return whether most of the short runs of equal values are multiples of one length near ``ratio``."""
    times = np.round(runs / ratio)
    short = times <= _SHORT
    whole = short & (times > 0)
    period = float(np.median(runs[whole] / times[whole]))
    away = np.abs(runs[short] - np.round(runs[short] / period) * period)
    return float(np.mean(away <= 1 + period / 8)) > 0.75


def spikes(values: Floats) -> Mask:
    """Return the single-sample spikes.

    A sample is a spike if it leaves the median of five by twelve robust standard deviations of what the
    channel's samples usually do, and if it stands out by far more than its neighbours differ.
    """
    found = np.zeros(len(values), dtype=bool)
    finite = np.isfinite(values)
    x = values if finite.all() else values[finite]
    if len(x) < 9:
        return found
    away = np.abs(x - scipy.ndimage.median_filter(x, 5, mode="nearest"))
    usual = 1.4826 * np.median(away[away > 0]) if (away > 0).any() else 0.0
    if usual == 0:
        return found
    far = np.flatnonzero(away > _SPIKE * usual)
    before, after = far - 1, (far + 1) % len(x)
    steps = np.abs(x[far] - x[np.maximum(before, 0)]), np.abs(x[np.minimum(far + 1, len(x) - 1)] - x[far])
    far = far[np.minimum(*steps) > 4 * np.abs(x[before] - x[after])]
    found[far if x is values else np.flatnonzero(finite)[far]] = True
    return found
