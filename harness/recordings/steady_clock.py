"""Samples that a steady clock took, with stamps that jitter about its instants.

A logger stamps a sample when it arrives, some tenths of a millisecond or milliseconds after it was taken; the sensor
samples steadily. Interpolating to a grid from such stamps moves samples that lie on it and colours their noise. So the
line of the stamps over the number of the sample gives the instants (as ``dejitter_timestamps`` of the Lab Streaming
Layer does). Whether the samples were taken at the stamps after all the signals tell: they then differ from those of a
steady clock by their slope times the jitter.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from harness.common.arrays import Floats
from harness.recordings.clock import Clock

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
    if instants is None or any(_taken_at(clock.time, instants, clock.of(column)) for column in columns):
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
    """Whether the samples of a channel were taken when the stamps say so, and not at the steady instants.

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
