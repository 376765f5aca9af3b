"""Errors over time: the RMSE of a target in each window of one drive of one design."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from harness.config import Study
from harness.estimation.contract import Scores
from harness.simulation.simulate import Batch
from harness.study.compiled_study import CompiledStudy


class ErrorWindows:
    """The windows in which a study wants errors kept over time.

    Args:
        study: The study.
        compiled: Its models and drives.
    """

    def __init__(self, study: Study, compiled: CompiledStudy) -> None:
        self._study, self._wanted = study, study.over_time
        self._samples = [len(drive.profile.time) for drive in compiled.drives]
        self._rows = [compiled.truth_names.index(name) for name in study.targets] if self._wanted else []

    def count(self, design: int, drive: int) -> int | None:
        """Return the number of windows of a drive in a design; ``None`` where nobody asked for them."""
        wanted, study = self._wanted, self._study
        if wanted is None or (study.designs[design].name, study.drives[drive].name) != (wanted.design, wanted.drive):
            return None
        return max(1, self._samples[drive] // self._length)

    @property
    def _length(self) -> int:
        """Samples of a window."""
        assert self._wanted is not None
        return max(1, round(self._wanted.window / self._study.plant.step))

    def rmse(self, batch: Batch, scores: Scores, windows: int) -> NDArray[np.float32]:
        """Return the RMSE of each target by window ``(LANES, targets, windows)``; NaN from a divergence on."""
        assert scores.kept is not None
        error = scores.kept[:, 0, : len(self._rows)] - batch.truth[:, self._rows]
        ended = np.arange(len(error))[:, None] >= np.minimum(scores.diverged_at, batch.left_at)
        error = np.where(ended[:, None], np.nan, error)[: windows * self._length]
        squares = np.square(error).reshape(windows, -1, *error.shape[1:])
        return np.sqrt(squares.mean(axis=1)).transpose(2, 1, 0).astype(np.float32)
