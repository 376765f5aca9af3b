"""The free run of a model over the inputs of a recording, and where it begins."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

from harness.common.arrays import Floats
from harness.identification.data import DriveData
from harness.models.assembly.assemble import StateSpaceModel

BLOCK = 5.0
"""s; what a vehicle does hardly depends on what it did that long ago."""

FEWEST = 12
"""Blocks of a drive, shorter ones where it lasts less than that many."""


class Start(NamedTuple):
    """Where a free run begins: the sample, and the state there ``(nx,)``."""

    sample: int
    state: Floats


@dataclass(frozen=True)
class FreeRun:
    """The free run of the model over a recording.

    Attributes:
        states: From where it begins, as long as they stay in the range in which the equations hold ``(n, nx)``.
        outputs: ``(samples, ny)``, NaN before it begins and from where it left that range.
    """

    states: Floats
    outputs: Floats


def blocks(drive: DriveData) -> int:
    """Return the number of blocks of a drive that are judged as if they did not depend on each other."""
    return max(FEWEST, int(drive.time[-1] / BLOCK))


def found_start(model: StateSpaceModel, drive: DriveData, states: Floats) -> Start:
    """Return where a free run is judged from: behind the first block, in the state that the filter has found there.

    Most recordings are cut from a drive, and nobody knows their first state: what follows from a wrong one is no error
    of the model. Random processes, of which a free run knows nothing, are zero.

    Args:
        model: Its equations.
        drive: The recording.
        states: Corrected means of the filter over it, with the parameters of the free run ``(samples, nx)``.
    """
    begin = len(drive.time) // blocks(drive)
    state = states[begin].copy()
    state[[name in model.noise for name in model.states]] = 0.0
    return Start(begin, state)
