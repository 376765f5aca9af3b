"""Where is something missing? The gain of an unknown, slowly varying disturbance at each input in turn.

A Gauss-Markov disturbance is put into each equation, each published force or angle and each sensor in turn; its
variance and, for the inputs of the largest gain, its time constant are the likeliest of a grid. The inputs are ranked
by the gain in likelihood, and the smoothed disturbance shows what is missing (Kristensen, Madsen and Joergensen 2004).
The ranking is a hint and not a verdict: what enters elsewhere is attributed to the input of the most similar effect.
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
"""Time constant in s with which every input is tried."""

FURTHER = (0.3, 30.0)
"""s; from a quick manoeuvre to a stretch of road: tried for the inputs of the largest gain."""

_REFINED = 10
"""Number of these inputs."""

_DEVIATIONS = np.geomspace(0.3, 1e3, LANES)
"""Standard deviations that are tried, over the detection limit of the drives within a time constant."""


@dataclass(frozen=True)
class Suspect:
    """An input with what a disturbance there explains.

    Attributes:
        channel: The input.
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
    """The ranking of inputs at one point of one model.

    Args:
        fitting: The recordings.
        point: Where the model was fitted.
        channels: The inputs; all of them by default.
        ranked: Whether to rank them, besides linearising the filter along the drives.
    """

    def __init__(
        self, fitting: Fitting, point: Point, channels: Sequence[Channel] | None = None, ranked: bool = True
    ) -> None:
        whole, numbers = fitting.whole, range(len(fitting.drives))
        self.whole = whole
        self.channels = tuple(channels_of(whole) if channels is None else channels)
        self.drives = fitting.drives
        kept, compiled = fitting.runs(point), Linearisation(whole)

        def linearised(i: int) -> Linearised:
            return Linearised(compiled, fitting.drives[i], point.values[:, i], kept[i])

        self.linear = whole.share(linearised, numbers)
        self._inlets = whole.share(lambda i: self.linear[i].inlets(self.channels), numbers)
        self.suspects = self._ranked() if ranked else ()

    def inlets(self, channel: Channel) -> list[Inlet]:
        """Return how an input acts in each drive."""
        j = self.channels.index(channel)
        return [inlets[j] for inlets in self._inlets]

    def history(self, suspect: Suspect) -> tuple[History, ...]:
        """Return the disturbance at an input over every drive."""
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
