"""Disturbances that are held for some samples: the innovations of those samples count as one, and steps are fewer.

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
from harness.diagnosis.innovations.innovation_model import InnovationModel, InputDirection

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

    def known(values: Floats) -> Floats:
        """Return steps behind one that is not used, as kernels take them."""
        return np.concatenate([np.zeros((1, *values.shape[1:])), values])

    transition = known(now[:, :, :n])

    def found(j: int, of_state: Floats, of_disturbance: Floats, residual: Floats) -> HeldDisturbance:
        larger = InnovationModel(transition, of_state, known(residual), held * model.step)
        return HeldDisturbance(larger, InputDirection(known(now[:, :, n + j]), known(of_disturbance)), held, samples)

    if held * ny <= n + 1:
        of_state = known(rows[:, :, :n])
        return [found(j, of_state, rows[:, :, n + j], residual) for j in range(len(input_directions))]
    basis, factor = np.linalg.qr(rows[:, :, :n])
    inside, noise = _in_basis(basis, residual[:, :, None])
    owed, beyond = _in_basis(basis, rows[:, :, n:])
    length = np.linalg.norm(beyond, axis=1)
    along = np.einsum("kij,ki->kj", beyond, noise[:, :, 0]) / np.where(length > 0, length, 1.0)
    of_state = known(np.concatenate([factor, np.zeros((count, 1, n))], axis=1))
    return [
        found(
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
