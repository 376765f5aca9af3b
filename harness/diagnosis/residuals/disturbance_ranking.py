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
from harness.diagnosis.innovations.disturbance_inputs import DisturbanceInput, disturbance_inputs_of
from harness.diagnosis.innovations.held_disturbance import HeldDisturbance, held_disturbances, samples_held
from harness.diagnosis.innovations.innovation_model import InputDirection, Linearisation, Linearised
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
class RankedInput:
    """An input with what a disturbance there explains.

    Attributes:
        disturbance_input: The input.
        gain: In log-likelihood over all drives, at the best of the grid; 0 if none gains.
        time_constant: In s, of the best.
        deviation: Standard deviation of the best, in the unit of the channel.
    """

    disturbance_input: DisturbanceInput
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


class DisturbanceRanking:
    """The ranking of inputs at one point of one model.

    Args:
        fitting: The recordings.
        point: Where the model was fitted.
        disturbance_inputs: The inputs; all of them by default.
        ranked: Whether to rank them, besides linearising the filter along the drives.
    """

    def __init__(
        self,
        fitting: Fitting,
        point: Point,
        disturbance_inputs: Sequence[DisturbanceInput] | None = None,
        ranked: bool = True,
    ) -> None:
        augmented, numbers = fitting.augmented, range(len(fitting.drives))
        self.augmented = augmented
        self.disturbance_inputs = tuple(
            disturbance_inputs_of(augmented) if disturbance_inputs is None else disturbance_inputs
        )
        self.drives = fitting.drives
        kept, compiled = fitting.runs(point), Linearisation(augmented)

        def linearised(i: int) -> Linearised:
            return Linearised(compiled, fitting.drives[i], point.values[:, i], kept[i])

        self.linear = augmented.share(linearised, numbers)
        self._input_directions = augmented.share(
            lambda i: self.linear[i].input_directions(self.disturbance_inputs), numbers
        )
        self.ranked_inputs = self._ranked() if ranked else ()

    def input_directions(self, disturbance_input: DisturbanceInput) -> list[InputDirection]:
        """Return how an input acts in each drive."""
        j = self.disturbance_inputs.index(disturbance_input)
        return [input_directions[j] for input_directions in self._input_directions]

    def history(self, ranked_input: RankedInput) -> tuple[History, ...]:
        """Return the disturbance at an input over every drive."""
        time_constant, step = ranked_input.time_constant, self.augmented.spec.step
        found = []
        for linear, input_direction in zip(
            self.linear, self.input_directions(ranked_input.disturbance_input), strict=True
        ):
            (held,) = held_disturbances(linear.innovations, [input_direction], samples_held(time_constant, step))
            found.append(History(*held.smoothed(time_constant, ranked_input.deviation)))
        return tuple(found)

    def _ranked(self) -> tuple[RankedInput, ...]:
        found = sorted(self._tried(self.disturbance_inputs, FIRST), key=_gain, reverse=True)
        promising = [s.disturbance_input for s in found[:_REFINED]]
        by_time_constant = [found[:_REFINED], *(self._tried(promising, t) for t in FURTHER)]
        first = [max(of_one, key=_gain) for of_one in zip(*by_time_constant, strict=True)]
        return tuple(sorted([*first, *found[_REFINED:]], key=_gain, reverse=True))

    def _tried(self, disturbance_inputs: Sequence[DisturbanceInput], time_constant: float) -> list[RankedInput]:
        """Return the best of the grid of deviations for disturbances of a time constant at some inputs."""
        chosen = [self.disturbance_inputs.index(c) for c in disturbance_inputs]
        samples = samples_held(time_constant, self.augmented.spec.step)

        def held(i: int) -> list[HeldDisturbance]:
            input_directions = [self._input_directions[i][j] for j in chosen]
            return held_disturbances(self.linear[i].innovations, input_directions, samples)

        by_drive = self.augmented.share(held, range(len(self.drives)))
        tasks = list(zip(disturbance_inputs, zip(*by_drive, strict=True), strict=True))
        return self.augmented.share(lambda task: _likeliest(*task, time_constant), tasks)


def _likeliest(
    disturbance_input: DisturbanceInput, by_drive: Sequence[HeldDisturbance], time_constant: float
) -> RankedInput:
    """Return the deviation of the largest gain, which is 0 if none gains."""
    power = sum(held.power() for held in by_drive)  # of the response to a constant one
    duration = sum(held.samples * held.model.step / held.held for held in by_drive)
    best = RankedInput(disturbance_input, 0.0, time_constant, 0.0)
    if power > 0:
        tried = _DEVIATIONS / np.sqrt(power / duration * time_constant)
        gains = np.sum([held.gains(time_constant, tried) for held in by_drive], axis=0)
        gains = np.where(np.isfinite(gains), gains, -np.inf)
        most = int(np.argmax(gains))
        if gains[most] > 0:
            best = RankedInput(disturbance_input, float(gains[most]), time_constant, float(tried[most]))
    return best


def _gain(ranked_input: RankedInput) -> float:
    return ranked_input.gain
