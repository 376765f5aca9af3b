"""How the innovations respond to a change, for each time of a grid at which it may begin.

A change acts from its beginning as it would if it had been there all along, so the augmented model is linearised once
along the pass and led through with the same entry from another sample on; only how the change rises in between is its
own. That is read off one beginning: the share of the full entry that it has reached.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.diagnosis.innovations.innovation_model import Linearisation, Linearised
from harness.identification.data import Drive
from harness.identification.filtered_model import FilterRun

Columns = NDArray[np.float32]
"""Many responses at once; they only choose where to look closer."""

_LONG_AGO = -1e5
"""s; a change that began then is done when the drive begins."""


@dataclass(frozen=True)
class Change:
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
        self, linearisation: Linearisation, drive: Drive, values: Floats, kept: FilterRun, grid: Floats
    ) -> None:
        self.grid, self._whole = grid, linearisation.augmented
        self._linear = Linearised(linearisation, drive, values, kept)
        self._middle = float(grid[len(grid) // 2])
        self._first = np.searchsorted(drive.time, self._middle - 1e-9)
        self._later = np.round((grid - self._middle) / self._whole.spec.step).astype(int)

    def responses(self, changes: Sequence[Change]) -> list[Columns]:
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
        found = []
        for j, input_direction in enumerate(input_directions):
            full, part = (np.concatenate([ahead[:, :, 2 * j + m], outputs[:, :, 2 * j + m]], axis=1) for m in (0, 1))
            moved = np.empty((*outputs.shape[:2], len(self.grid)), np.float32)
            self._linear.innovations.write_responses(input_direction, -self._shifted(full, part), moved)
            found.append(moved.reshape(-1, len(self.grid)))
        return found

    def _shifted(self, full: Floats, part: Floats) -> Floats:
        """Return how much of a change is done, for each time at which it may begin ``(samples, change_times)``."""
        samples = np.arange(len(full))
        power = np.einsum("ki,ki->k", full, full)
        with np.errstate(invalid="ignore", divide="ignore"):
            reached = np.einsum("ki,ki->k", part, full) / power
        reached = np.where(power > 0, reached, samples >= self._first)
        padded = np.concatenate([[0.0], reached, [1.0]])
        return padded[np.clip(samples[:, None] - self._later + 1, 0, len(padded) - 1)]
