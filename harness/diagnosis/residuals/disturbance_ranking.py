"""Gain of an unknown, slowly varying disturbance at each input in turn: where something is missing.

A Gauss-Markov disturbance is put into each equation, each published force or angle and each sensor in turn; its
variance and, for the inputs of the largest gain, its time constant are the likeliest of a grid. The inputs are ranked
by the gain in likelihood, and the smoothed disturbance shows what is missing (Kristensen, Madsen and Joergensen 2004).
The ranking is a hint and not a verdict: what enters elsewhere is attributed to the input of the most similar effect.

A slow disturbance changes little within a tenth of its time constant. Held for so long, it moves the innovations of
these samples in proportion to itself and to the state before them, so a step of the recursions takes all of them at
once. Of their rows no more than the state's size and one tell anything of either: an orthogonal transformation, which
leaves white innovations white, turns the others into noise (Bierman 1977, square-root information arrays).
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.diagnosis.fitting import Fitting, ParameterPoint
from harness.diagnosis.innovations.disturbance_inputs import DisturbanceInput, disturbance_inputs_of
from harness.diagnosis.innovations.innovation_model import InnovationModel, InputDirection, Linearised, ModelTangents
from harness.engine.simd.lanes import LANES

_HELD = 0.1
"""Of its time constant, for which a disturbance is held."""


@dataclass(frozen=True)
class HeldDisturbance:
    """A disturbance with the innovations by steps in which it is held.

    Attributes:
        model: Of the innovations; rows of a step without information are left out.
        input_direction: How the disturbance enters it.
        held: For how many samples.
        samples: Of the recording.
    """

    model: InnovationModel
    input_direction: InputDirection
    held: int
    samples: int

    def gains(self, time_constant: float, deviations: Floats) -> Floats:
        """Return what a Gauss-Markov disturbance gains in log-likelihood for standard deviations ``(LANES,)``."""
        return self.model.gains(self.input_direction, time_constant, deviations)

    def smoothed(self, time_constant: float, deviation: float) -> tuple[Floats, Floats]:
        """Return such a disturbance given all samples, and its standard error, each ``(samples,)``."""
        steps = np.concatenate([[0], 1 + np.arange(self.samples - 1) // self.held])
        mean, error = self.model.smoothed(self.input_direction, time_constant, deviation)
        return mean[steps], error[steps]

    @np.errstate(over="ignore", invalid="ignore")
    def power(self) -> float:
        """Return the sum of squares of the response to a disturbance of one; not finite if the filter is unstable."""
        ones = np.ones((len(self.model.residual), 1))
        return float(np.sum(self.model.responses(self.input_direction, ones) ** 2))


def samples_held(time_constant: float, step: float) -> int:
    """Return for how many samples a disturbance of a time constant is held."""
    return max(1, round(_HELD * time_constant / step))


@np.errstate(over="ignore", invalid="ignore")
def held_disturbances(
    model: InnovationModel, input_directions: Sequence[InputDirection], held: int
) -> list[HeldDisturbance]:
    """Return disturbances that are held for some samples each, from the second sample of a recording on.

    Where effects feed back, gains of the nominal model may leave the innovations unstable; then nothing is finite.

    Args:
        model: Of the innovations, sample by sample.
        input_directions: How each disturbance enters it.
        held: Number of samples; the last step has as many as are left.
    """
    samples, ny, n = model.output.shape
    entry, direct = (np.stack([getattr(d, part) for d in input_directions], axis=-1) for part in ("entry", "direct"))
    count = -(-(samples - 1) // held)

    def by_step(values: Floats, neutral: Floats | float) -> Floats:
        """Return samples by steps ``(steps, held, ...)``; neutral ones fill the last step."""
        filled = np.empty((count * held, *values.shape[1:]))
        filled[: samples - 1], filled[samples - 1 :] = values[1:], neutral
        return filled.reshape(count, held, *values.shape[1:])

    # The state and all disturbances side by side: columns are what a step's rows owe to each of them.
    now = np.concatenate([np.broadcast_to(np.eye(n), (count, n, n)), np.zeros((count, n, entry.shape[2]))], axis=2)
    transition, enters = by_step(model.transition, np.eye(n)), by_step(entry, 0.0)
    output, enters_output = by_step(model.output, 0.0), by_step(direct, 0.0)
    rows = np.empty((count, held, ny, now.shape[2]))
    for i in range(held):
        rows[:, i] = output[:, i] @ now
        rows[:, i, :, n:] += enters_output[:, i]
        now = transition[:, i] @ now
        now[:, :, n:] += enters[:, i]
    rows = rows.reshape(count, held * ny, -1)
    residual = by_step(model.residual, 0.0).reshape(count, held * ny)

    def shifted(values: Floats) -> Floats:
        """Return steps behind one that is not used, as kernels take them."""
        return np.concatenate([np.zeros((1, *values.shape[1:])), values])

    transition = shifted(now[:, :, :n])

    def held_at(j: int, of_state: Floats, of_disturbance: Floats, residual: Floats) -> HeldDisturbance:
        larger = InnovationModel(transition, of_state, shifted(residual), held * model.step)
        return HeldDisturbance(
            larger, InputDirection(shifted(now[:, :, n + j]), shifted(of_disturbance)), held, samples
        )

    if held * ny <= n + 1:
        of_state = shifted(rows[:, :, :n])
        return [held_at(j, of_state, rows[:, :, n + j], residual) for j in range(len(input_directions))]
    basis, factor = np.linalg.qr(rows[:, :, :n])
    inside, noise = _in_basis(basis, residual[:, :, None])
    owed, beyond = _in_basis(basis, rows[:, :, n:])
    length = np.linalg.norm(beyond, axis=1)
    along = np.einsum("kij,ki->kj", beyond, noise[:, :, 0]) / np.where(length > 0, length, 1.0)
    of_state = shifted(np.concatenate([factor, np.zeros((count, 1, n))], axis=1))
    return [
        held_at(
            j,
            of_state,
            np.concatenate([owed[:, :, j], length[:, [j]]], axis=1),
            np.concatenate([inside[:, :, 0], along[:, [j]]], axis=1),
        )
        for j in range(len(input_directions))
    ]


def _in_basis(basis: Floats, columns: Floats) -> tuple[Floats, Floats]:
    """Return columns in a basis, and what is left of them beyond it."""
    inside = np.swapaxes(basis, 1, 2) @ columns
    return inside, columns - basis @ inside


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
class DisturbanceHistory:
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
        point: ParameterPoint,
        disturbance_inputs: Sequence[DisturbanceInput] | None = None,
        ranked: bool = True,
    ) -> None:
        augmented, numbers = fitting.augmented, range(len(fitting.drives))
        self.augmented = augmented
        self.disturbance_inputs = tuple(
            disturbance_inputs_of(augmented) if disturbance_inputs is None else disturbance_inputs
        )
        self.drives = fitting.drives
        kept, compiled = fitting.runs(point), ModelTangents(augmented)

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

    def history(self, ranked_input: RankedInput) -> tuple[DisturbanceHistory, ...]:
        """Return the disturbance at an input over every drive."""
        time_constant, step = ranked_input.time_constant, self.augmented.spec.step
        histories = []
        for linear, input_direction in zip(
            self.linear, self.input_directions(ranked_input.disturbance_input), strict=True
        ):
            (held,) = held_disturbances(linear.innovations, [input_direction], samples_held(time_constant, step))
            histories.append(DisturbanceHistory(*held.smoothed(time_constant, ranked_input.deviation)))
        return tuple(histories)

    def _ranked(self) -> tuple[RankedInput, ...]:
        ranked = sorted(self._tried(self.disturbance_inputs, FIRST), key=_gain, reverse=True)
        promising = [s.disturbance_input for s in ranked[:_REFINED]]
        by_time_constant = [ranked[:_REFINED], *(self._tried(promising, t) for t in FURTHER)]
        first = [max(of_one, key=_gain) for of_one in zip(*by_time_constant, strict=True)]
        return tuple(sorted([*first, *ranked[_REFINED:]], key=_gain, reverse=True))

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
