"""A model judged on recordings: simulation error, one-step prediction error, whiteness of the innovations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.identification.data import Drive
from harness.identification.filtered_model import Each, FilteredModel, FilterRun, for_each
from harness.identification.free_run import found_start
from harness.identification.whiteness import Whiteness, whiteness


@dataclass(frozen=True)
class DriveJudgement:
    """One model on one recording.

    Attributes:
        drive: The recording.
        simulated: Outputs of the free run over the inputs ``(samples, ny)``; NaN in the first block, behind which it
            begins in the state of the filter, and from where it left the range in which the equations hold.
        simulation_error: Root mean square of measurement minus that ``(ny,)``.
        one_step_error: Root mean square of the innovations ``(ny,)``.
        log_likelihood: Of the recording.
        whiteness: Of each output's whitened innovations.
    """

    drive: Drive
    simulated: Floats
    simulation_error: Floats
    one_step_error: Floats
    log_likelihood: float
    whiteness: tuple[Whiteness, ...]

    @property
    def stays(self) -> bool:
        """Whether the free run stays in the range in which the equations hold."""
        return stays(self.simulated)


def stays(simulated: Floats) -> bool:
    """Whether a free run ``(samples, ny)`` stays in the range in which the equations hold."""
    return bool(np.isfinite(simulated[-1]).all())


def judged_on(model: FilteredModel, drives: Sequence[Drive], points: Each) -> tuple[DriveJudgement, ...]:
    """Judge a model on every recording.

    Args:
        model: The filter.
        drives: The recordings.
        points: One candidate, or one for each recording.
    """
    each = for_each(points, drives)
    runs = model.runs(drives, each)

    def of_drive(i: int) -> DriveJudgement:
        start = found_start(model.model, drives[i], runs[i].state)
        return _judged(drives[i], model.free_run(drives[i], each[i].values[:, 0], start).outputs, runs[i])

    return tuple(model.share(of_drive, range(len(drives))))


def _judged(drive: Drive, simulated: Floats, run: FilterRun) -> DriveJudgement:
    return DriveJudgement(
        drive,
        simulated,
        rms(drive.measurements - simulated),
        rms(run.innovation),
        run.log_likelihood,
        tuple(whiteness(column) for column in run.whitened[1:].T),
    )


def rms(errors: Floats) -> Floats:
    """Return the root mean square of each column; NaN only where nothing is left."""
    count = np.isfinite(errors).sum(axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        return np.asarray(np.sqrt(np.nansum(errors**2, axis=0) / count))
