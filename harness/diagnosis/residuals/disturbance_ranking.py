"""Where is something missing? What an unknown, slowly varying disturbance would explain, entry by entry.

A Gauss-Markov disturbance is put into each equation, each published force or angle and each sensor in turn; its
variance and, for the entries that come first, its time constant are the likeliest of a grid. What it gains in
likelihood ranks the entries, and smoothed over the drive it shows what is missing (Kristensen, Madsen and Joergensen
2004). It is a hint and not a verdict: an entry that is not in the list, or that acts like another one, puts the blame
on its neighbour.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.fitting.fit import Fitting, Point
from harness.diagnosis.innovations.disturbance_inputs import Channel, channels_of
from harness.diagnosis.innovations.innovation_model import Inlet, Linearisation, Linearised
from harness.engine.simd.lanes import LANES

FIRST = 3.0
"""Time constant in s with which every entry is tried."""

FURTHER = (0.3, 30.0)
"""s; from a quick manoeuvre to a stretch of road: tried for the entries that come first."""

_REFINED = 10
"""So many of them; what comes behind is where nothing is missing."""

_DEVIATIONS = np.geomspace(0.3, 1e3, LANES)
"""Standard deviations that are tried, over the one that the drives would just show within a time constant."""


@dataclass(frozen=True)
class Suspect:
    """An entry with what a disturbance there explains.

    Attributes:
        channel: The entry.
        gain: In log-likelihood over all drives, at the best of the grid; 0 if none gains.
        time_constant: In s, of the best.
        deviation: Standard deviation of the best, in the unit of the channel.
    """

    channel: Channel
    gain: float
    time_constant: float
    deviation: float


@dataclass(frozen=True)
class History:
    """A disturbance given all samples of a drive.

    Attributes:
        mean: ``(samples,)``.
        error: Its standard deviation ``(samples,)``.
    """

    mean: Floats
    error: Floats


class Pinpoint:
    """The ranking of entries at one point of one model.

    Args:
        fitting: The recordings.
        point: Where the model was fitted.
        channels: The entries; every one there is by default.
        ranked: Whether to rank them; without, they are only led through the filter.
    """

    def __init__(
        self, fitting: Fitting, point: Point, channels: Sequence[Channel] | None = None, ranked: bool = True
    ) -> None:
        whole, numbers = fitting.whole, range(len(fitting.drives))
        self.whole = whole
        self.channels = tuple(channels_of(whole) if channels is None else channels)
        self.drives = fitting.drives
        kept, compiled = fitting.passes(point), Linearisation(whole)

        def linearised(i: int) -> Linearised:
            return Linearised(compiled, fitting.drives[i], point.values[:, i], kept[i])

        self.linear = whole.share(linearised, numbers)
        self._inlets = whole.share(lambda i: self.linear[i].inlets(self.channels), numbers)
        self.suspects = self._ranked() if ranked else ()

    def inlets(self, channel: Channel) -> list[Inlet]:
        """Return how an entry acts in each drive."""
        j = self.channels.index(channel)
        return [inlets[j] for inlets in self._inlets]

    def history(self, suspect: Suspect) -> tuple[History, ...]:
        """Return the disturbance at an entry over every drive."""
        return tuple(
            History(*linear.innovations.smoothed(inlet, suspect.time_constant, suspect.deviation))
            for linear, inlet in zip(self.linear, self.inlets(suspect.channel), strict=True)
        )

    def _ranked(self) -> tuple[Suspect, ...]:
        found = self.whole.share(lambda c: self._suspect(c, (FIRST,)), self.channels)
        found.sort(key=_gain, reverse=True)
        first = self.whole.share(lambda s: max(s, self._suspect(s.channel, FURTHER), key=_gain), found[:_REFINED])
        return tuple(sorted([*first, *found[_REFINED:]], key=_gain, reverse=True))

    def _suspect(self, channel: Channel, time_constants: Sequence[float]) -> Suspect:
        inlets = self.inlets(channel)
        power, duration = 0.0, 0.0  # of the response to a constant one
        for linear, inlet in zip(self.linear, inlets, strict=True):
            ones = np.ones((len(linear.innovations.residual), 1))
            power += float(np.sum(linear.innovations.responses(inlet, ones) ** 2))
            duration += len(ones) * linear.innovations.step
        best = Suspect(channel, 0.0, time_constants[0], 0.0)
        for time_constant in time_constants if power > 0 else ():
            tried = _DEVIATIONS / np.sqrt(power / duration * time_constant)
            gains = np.sum(
                [
                    linear.innovations.gains(inlet, time_constant, tried)
                    for linear, inlet in zip(self.linear, inlets, strict=True)
                ],
                axis=0,
            )
            gains = np.where(np.isfinite(gains), gains, -np.inf)
            most = int(np.argmax(gains))
            if gains[most] > best.gain:
                best = Suspect(channel, float(gains[most]), time_constant, float(tried[most]))
        return best


def _gain(suspect: Suspect) -> float:
    return suspect.gain
