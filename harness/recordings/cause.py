"""One thing that is a little off in a recording, and the signals without it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.recordings.consistency import Smoothed

SCALE, OFFSET, DELAY, DRIFT = "scale", "offset", "delay", "drift"


@dataclass(frozen=True)
class Cause:
    """One thing that is a little off.

    Attributes:
        kind: ``SCALE``, ``OFFSET``, ``DELAY`` or ``DRIFT``.
        signals: The signals concerned: those of one channel, of several of one device, or of one clock.
        value, std: Factor minus 1, SI units, s, or s over the recording, with the standard error.
        doubt: Standard deviation of the value with what every channel may be off without a fault.
        posterior: Its probability among the causes that were looked at.
        clock: Which clock drifts or is late as a whole; -1 for a channel.
        rivals: What may be in its place, the most probable first; nothing at all is an empty one.
    """

    kind: str
    signals: tuple[str, ...]
    value: float
    std: float
    doubt: float
    posterior: float
    clock: int = -1
    rivals: tuple[tuple[Cause, ...], ...] = ()


def mended(causes: Sequence[Cause], smoothed: Smoothed) -> Smoothed:
    """Return signals without the causes."""
    found = dict(smoothed.signals)
    for cause in causes:
        for name in cause.signals:
            if cause.kind == SCALE:
                found[name] = found[name] / (1 + cause.value)
            elif cause.kind == OFFSET:
                found[name] = found[name] - cause.value
            else:
                place = np.arange(len(found[name]))
                drifted = 1.0 if cause.kind == DELAY else (place - place.mean()) / np.ptp(place)
                found[name] = np.interp(
                    place + cause.value * drifted / smoothed.step, place, found[name], left=np.nan, right=np.nan
                )
    return Smoothed(found, smoothed.step, smoothed.origins)
