"""Clocks and samples of single channels: stamps that jump or jitter, repeated samples, spikes.

A logger stamps a sample when it arrives, some tenths of a millisecond or milliseconds after it was taken; the sensor
samples steadily. Interpolating to a grid from such stamps moves samples that lie on it and colours their noise. So the
line of the stamps over the number of the sample gives the instants (as ``dejitter_timestamps`` of the Lab Streaming
Layer does). Whether the samples were taken at the stamps after all the signals tell: they then differ from those of a
steady clock by their slope times the jitter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy
from numpy.typing import NDArray

from harness.common.arrays import Floats, Mask
from harness.common.errors import UserError

_OUT_OF_ORDER = 0.01
"""Share of the stamps that may stand still or jump back; with more of them the clock is unusable."""
_SAME = 1e-9
"""s; stamps that are no further apart are of one instant: no recorder takes two samples within it."""
_STEPS_OFF = 2.0
"""Steps of a coarse clock that its stamps may be off the line of equidistant rows, from the earliest to the latest."""
_LOST = 0.5
"""Share of the rows that may be left out as their stamps repeat."""
_LATEST = 1e24
"""s; no clock counts so far, nor from so long ago, even if its nanoseconds are taken for seconds."""
_RESOLVED = 64.0
"""Distances of neighbouring floating-point numbers that a step must span, or rounding makes the stamps jitter."""
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

    def in_rows(self, column: Floats) -> Floats:
        """Return a column of the file ``(rows of the file,)`` in the rows kept; not to be written to."""
        return np.asarray(column if len(self.rows) == len(column) else column[self.rows], dtype=float)


def check_clock(stamps: Floats, where: str, own_rows: NDArray[np.intp] | None = None, rate: float = np.nan) -> Clock:
    """Keep the rows whose stamp is later than every one before.

    Where many stamps repeat, the clock is coarser than the rows, which are then taken as equidistant.

    Args:
        stamps: Of all rows of a file, in s.
        where: File and column, for messages.
        own_rows: Rows of the clock; all by default.
        rate: Rows in a second, Hz, for stamps that repeat; NaN if it is to be found.

    Raises:
        UserError: If fewer than two rows are left, too many stamps repeat or jump back, they contradict the rate, or
            are hours, minutes and seconds in digits.
    """
    own = np.arange(len(stamps)) if own_rows is None else own_rows
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
        if bad.size > _OUT_OF_ORDER * len(stamps) and finite.all() and (np.diff(time) >= -_SAME).all():
            return _coarse(time, own, rate, f"{where}: {bad.size} of {len(own)} stamps repeat ({evidence})")
        if bad.size > _OUT_OF_ORDER * len(stamps):
            raise UserError(
                f"{where}: {bad.size} of {len(own)} stamps are missing, repeat or jump back ({evidence}); "
                "sort the rows, or cut the file where the clock was set"
            )
        warnings.append(f"{where}: {bad.size} rows left out whose stamp is missing, repeats or jumps back ({evidence})")
    kept, of_file = (time[rows], own[rows]) if bad.size else (time, own)
    furthest = max(kept[-1], -kept[0])
    if furthest > _LATEST:
        raise UserError(f"{where}: stamps reach {furthest:.3g} s; is this the column of the time, in its unit?")
    steps = np.diff(kept)
    step = float(np.median(steps))
    if _in_digits(kept, steps, step):
        raise UserError(
            f"{where}: counts hours, minutes and seconds as digits (hhmmss.s): {kept[steps.argmax() + 1]:.2f} follows "
            f"{kept[steps.argmax()]:.2f}; write seconds or hh:mm:ss.s"
        )
    if step < _RESOLVED * np.spacing(furthest):
        raise UserError(
            f"{where}: a step of {step:.3g} s is lost in the digits of stamps of {furthest:.3g} s; is the unit right? "
            "Else export the time since the start"
        )
    return Clock(kept, of_file, step, tuple(warnings))


def _in_digits(time: Floats, steps: Floats, step: float) -> bool:
    """Return whether stamps are hours, minutes and seconds in digits: 100059.98 is followed by 100100.00."""
    minutes = np.flatnonzero(steps > 40.0)
    if not minutes.size or step > 1.0 or (time < 0).any() or ((time % 100.0) >= 60.0).any():
        return False
    before, after = time[minutes] % 100.0, time[minutes + 1] % 100.0
    return bool((before > 50.0).all() and (after < 10.0).all())


def by_line(time: Floats, rows: NDArray[np.intp]) -> Floats | None:
    """Return the instants of equidistant rows whose stamps never fall but repeat, by the line through them.

    Args:
        time: Stamps in s ``(rows,)``.
        rows: Numbers of the rows.

    Returns:
        Instants in s; ``None`` if stamps are off the line by more than the clock's steps.
    """
    steps, rows = np.diff(time), rows - rows[0]
    new = np.flatnonzero(steps > _SAME) + 1  # where a stamp is late by less than a row
    if len(time) < _FEWEST or len(new) < 2:
        return None
    slope = float(np.polyfit(rows[new], time[new] - time[0], 1)[0])
    for step in (float(f"{slope:.3g}"), slope):
        if np.ptp(time - time[0] - step * rows) <= _STEPS_OFF * np.median(steps[new - 1]):
            return np.asarray(time[0] + step * rows)
    return None


def _coarse(time: Floats, rows: NDArray[np.intp], rate: float, said: str) -> Clock:
    """Return the clock of rows whose stamps repeat: by the rate stated, by a line, or of the last of equal ones.

    Raises:
        UserError: If the stamps contradict the rate, or there is none and most of the rows would be lost.
    """
    instants, steps = by_line(time, rows), np.diff(time)
    if np.isfinite(rate):
        stated = time[0] + (rows - rows[0]) / rate
        if np.ptp(time - stated) > _STEPS_OFF * steps.max():
            raise UserError(
                f"{said}; [recording] rate = {rate:g} Hz takes the rows to {stated[-1] - time[0]:.6g} s, the stamps to "
                f"{time[-1] - time[0]:.6g} s; state the rate of the rows"
            )
        return Clock(stated, rows, 1 / rate, (f"{said}; the rows are taken at {rate:g} Hz as stated",))
    if instants is not None:
        step = float(np.diff(instants).mean() / np.diff(rows).mean())
        how = f"the rows are taken at {1 / step:.5g} Hz, by the line through the stamps; if that is wrong, state "
        return Clock(
            instants, rows, step * float(np.median(np.diff(rows))), (f'{said}; {how}[recording] rate = "..."',)
        )
    last = np.append(steps > _SAME, True)
    if last.mean() < _LOST:
        raise UserError(f'{said}; if the rows are equidistant, state [recording] rate = "100 Hz", say')
    kept = time[last]
    warning = f"{said}; the last row of each stamp is kept"
    return Clock(kept, rows[last], float(np.median(np.diff(kept))), (warning,))


def updates(values: Floats) -> tuple[Mask, int]:
    """Separate samples that a slower channel delivered from those that only repeat the latest one.

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
    is_spike = np.zeros(len(values), dtype=bool)
    finite = np.isfinite(values)
    x = values if finite.all() else values[finite]
    if len(x) < 9:
        return is_spike
    away = np.abs(x - scipy.ndimage.median_filter(x, 5, mode="nearest"))
    usual = 1.4826 * np.median(away[away > 0]) if (away > 0).any() else 0.0
    if usual == 0:
        return is_spike
    far = np.flatnonzero(away > _SPIKE * usual)
    before, after = far - 1, (far + 1) % len(x)
    steps = np.abs(x[far] - x[np.maximum(before, 0)]), np.abs(x[np.minimum(far + 1, len(x) - 1)] - x[far])
    far = far[np.minimum(*steps) > 4 * np.abs(x[before] - x[after])]
    is_spike[far if x is values else np.flatnonzero(finite)[far]] = True
    return is_spike


_SLIGHT = 0.45
"""Of a step, by which a stamp may miss its instant: the number of the sample is unmistakable."""

_WHITE = 4.0
"""Standard errors of the correlation of neighbouring deviations within which they are jitter, not a wandering clock."""

_EXACT = 1e-6
"""Of a step; stamps that deviate less are equidistant as they are."""

_TELLING = 5.0
"""Standard errors by which a signal has to follow the jitter before its stamps are believed."""

_FIRST = 16
"""Samples from which the line of all is found: over as many the median step is off by a fraction of a step."""

_FEWEST = 100
"""Samples; of fewer ones neither is known."""


def steadied(clock: Clock, columns: Sequence[Floats]) -> Clock:
    """Return a clock with equidistant instants in place of stamps that jitter about them; else the same.

    Args:
        clock: The stamps.
        columns: Channels with a value per row of the file.
    """
    instants = _instants(clock.time, clock.step)
    if instants is None or any(_taken_at(clock.time, instants, clock.in_rows(column)) for column in columns):
        return clock
    return replace(clock, time=instants)


def _instants(time: Floats, step: float) -> Floats | None:
    """Return the instants of a steady clock; ``None`` if the stamps are no such clock, or need no other instants."""
    if len(time) < _FEWEST:
        return None
    slope, first, many = step, float(np.median(time[:_FIRST] - step * np.arange(_FIRST))), _FIRST
    while True:  # a line through so many stamps foretells the numbers of as many further ones
        for _ in range(2):
            number = np.rint((time[:many] - first) / slope)
            slope, first = np.polyfit(number, time[:many], 1)
        if many >= len(time):
            break
        many *= 2
    jitter = time - (first + slope * number)
    if np.abs(jitter).max() > _SLIGHT * step or np.diff(number).min() < 1:
        return None
    deviation = float(jitter.std())
    if deviation < _EXACT * step:
        return None
    lasting = float(np.mean(jitter[1:] * jitter[:-1])) / deviation**2
    return None if abs(lasting) * np.sqrt(len(time)) > _WHITE else first + slope * number


def _taken_at(time: Floats, instants: Floats, values: Floats) -> bool:
    """Return whether the samples of a channel were taken at their stamps, and not at the steady instants.

    What a sample differs from the mean of its neighbours is then its slope times how much later it is than theirs; the
    slope is that of the next neighbours but one, whose noise is independent of it. A value that a channel repeats was
    taken at neither instant, and its noise is its neighbour's.
    """
    jitter, repeated = time - instants, np.append(False, values[1:] == values[:-1])
    values = np.where(repeated, np.nan, values)
    late = jitter[2:-2] - 0.5 * (jitter[1:-3] + jitter[3:-1])
    with np.errstate(invalid="ignore", over="ignore"):
        bent = values[2:-2] - 0.5 * (values[1:-3] + values[3:-1])
        moved = (values[4:] - values[:-4]) / (instants[4:] - instants[:-4]) * late
        usual = np.nanmedian(np.abs(bent)) if np.isfinite(bent).any() else 0.0
        used = np.isfinite(bent) & np.isfinite(moved) & (np.abs(bent) < 10.0 * usual)
    power = float(moved[used] @ moved[used])
    if used.sum() < _FEWEST or power == 0.0:
        return False
    share = float(moved[used] @ bent[used]) / power
    error = float(np.sqrt(np.mean((bent[used] - share * moved[used]) ** 2) / power))
    return share > _TELLING * error
