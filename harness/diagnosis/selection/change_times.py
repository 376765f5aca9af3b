"""Hypotheses that begin, and may end, once in every drive: responses to a change at each time, and choices of times.

A change acts from its beginning as it would if it had been there all along, so the augmented model is linearised once
along the pass and led through with the same entry from another sample on; only how the change rises in between is its
own. That is read off one beginning: the share of the full entry that it has reached.

A second time ends what the first one began, so its response is that of the beginning, taken back. With the responses
``X_k`` to changes at the times of a grid, ``b_k = -X_k'r`` and ``G_km = X_k'X_m``, every pair of times is scored
without another run.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.diagnosis.innovations.innovation_model import Linearised, ModelTangents
from harness.identification.data import DriveData
from harness.identification.filtered_model import FilterRun

_RIDGE = 1e-6
"""Added to the unit diagonal, so that amplitudes with the same response share it."""

_BEAM = 60
"""Choices kept while drives are joined one after the other."""


@dataclass(frozen=True)
class Choices:
    """Choices of change times for some drives.

    Attributes:
        b: Sum over the drives ``(choices, amplitudes)``.
        G: Sum over the drives ``(choices, amplitudes, amplitudes)``.
        change_times: Indices into the grid of each drive, of the beginning and the end; -1 for never
            ``(choices, drives, 2)``.
    """

    b: Floats
    G: Floats
    change_times: NDArray[np.intp]

    def gains(self) -> Floats:
        """Return the gains in log-likelihood without bounds ``(choices,)``."""
        scale = np.sqrt(np.maximum(np.diagonal(self.G, axis1=1, axis2=2), 1e-300))
        unit = self.G / (scale[:, :, None] * scale[:, None, :]) + _RIDGE * np.eye(self.b.shape[1])
        b = self.b / scale
        return 0.5 * np.einsum("ni,ni->n", b, np.linalg.solve(unit, b[:, :, None])[:, :, 0])

    def best(self) -> Choices:
        """Return those of largest gain, best first, and the first of all (no change) in any case."""
        order = list(dict.fromkeys([*np.argsort(-self.gains())[:_BEAM].tolist(), 0]))
        return Choices(self.b[order], self.G[order], self.change_times[order])


def choices(b: Floats, G: Floats, ends: bool) -> Choices:
    """Return all choices in one drive; the first is that of no change.

    Args:
        b: ``(amplitudes, change_times)``.
        G: ``(amplitudes, amplitudes, change_times, change_times)``.
        ends: Whether a change may end.
    """
    d, n = b.shape
    each = np.arange(n)
    at = G[:, :, each, each]
    parts_b, parts_G = [np.zeros((1, d)), b.T], [np.zeros((1, d, d)), at.transpose(2, 0, 1)]
    change_times = [np.full((1, 2), -1), np.column_stack([each, np.full(n, -1)])]
    if ends:
        k, m = np.triu_indices(n, 1)
        parts_b.append((b[:, k] - b[:, m]).T)
        parts_G.append((at[:, :, k] + at[:, :, m] - G[:, :, k, m] - G[:, :, m, k]).transpose(2, 0, 1))
        change_times.append(np.column_stack([k, m]))
    return Choices(np.concatenate(parts_b), np.concatenate(parts_G), np.concatenate(change_times)[:, None, :])


def join(by_drive: Sequence[Choices]) -> tuple[tuple[int, int], ...]:
    """Return the change times for all drives with amplitudes in common, the best few of each drive at a time."""
    beam = by_drive[0].best()
    for choices in by_drive[1:]:
        ranked = choices.best()
        first, second = (i.ravel() for i in np.indices((len(beam.b), len(ranked.b))))
        beam = Choices(
            beam.b[first] + ranked.b[second],
            beam.G[first] + ranked.G[second],
            np.concatenate([beam.change_times[first], ranked.change_times[second]], axis=1),
        ).best()
    return tuple((int(k), int(m)) for k, m in beam.change_times[0])


Columns = NDArray[np.float32]
"""Many responses at once; they only choose where to look closer."""

_LONG_AGO = -1e5
"""s; a change that began then is done when the drive begins."""


@dataclass(frozen=True)
class ChangeResponse:
    """A change whose amplitude is to be known.

    Attributes:
        amplitude: Parameter.
        begins: Parameter.
        values: Of the augmented model, with its shapes and without an end ``(np,)``.
    """

    amplitude: str
    begins: str
    values: Floats


class Onsets:
    """Changes in one drive.

    Args:
        linearisation: Of the model.
        drive: The recording.
        values: Parameters of the pass ``(np,)``.
        kept: The pass.
        grid: Times in s.
    """

    def __init__(
        self, linearisation: ModelTangents, drive: DriveData, values: Floats, kept: FilterRun, grid: Floats
    ) -> None:
        self.grid, self._whole = grid, linearisation.augmented
        self._linear = Linearised(linearisation, drive, values, kept)
        self._middle = float(grid[len(grid) // 2])
        self._first = np.searchsorted(drive.time, self._middle - 1e-9)
        self._later = np.round((grid - self._middle) / self._whole.spec.step).astype(int)

    def responses(self, changes: Sequence[ChangeResponse]) -> list[Columns]:
        """Return how whitened innovations respond to each change at every time ``(samples * ny, change_times)``."""
        values, directions = [], []
        for c in changes:
            for begins in (_LONG_AGO, self._middle):
                at, direction = c.values.copy(), np.zeros(len(c.values))
                at[self._whole.row(c.begins)], direction[self._whole.row(c.amplitude)] = begins, 1.0
                values.append(at)
                directions.append(direction)
        ahead, outputs = self._linear.along(values, directions)
        input_directions = self._linear.entering(ahead[:, :, ::2], outputs[:, :, ::2])
        columns = []
        for j, input_direction in enumerate(input_directions):
            full, part = (np.concatenate([ahead[:, :, 2 * j + m], outputs[:, :, 2 * j + m]], axis=1) for m in (0, 1))
            moved = np.empty((*outputs.shape[:2], len(self.grid)), np.float32)
            self._linear.innovations.write_responses(input_direction, -self._shifted(full, part), moved)
            columns.append(moved.reshape(-1, len(self.grid)))
        return columns

    def _shifted(self, full: Floats, part: Floats) -> Floats:
        """Return how much of a change is done, for each time at which it may begin ``(samples, change_times)``."""
        samples = np.arange(len(full))
        power = np.einsum("ki,ki->k", full, full)
        with np.errstate(invalid="ignore", divide="ignore"):
            reached = np.einsum("ki,ki->k", part, full) / power
        reached = np.where(power > 0, reached, samples >= self._first)
        padded = np.concatenate([[0.0], reached, [1.0]])
        return padded[np.clip(samples[:, None] - self._later + 1, 0, len(padded) - 1)]
