"""How far a study is, from its store alone: what is done, lost and to come, and how fast it grows."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from harness.common import stores
from harness.common.errors import UserError
from harness.common.lock import holder
from harness.common.places import reached
from harness.study import checksums, run_file, sealed_root
from harness.study.checksums import Fault
from harness.study.score_names import ESTIMATOR_DIVERGED, PENDING, PLANT_DIVERGED, STATUS
from harness.study.verify import store_of

_RECENT = 64
"""Units, the last that were finished, whose times tell the rate."""


@dataclass
class Count:
    """Runs of one design and estimator.

    Attributes:
        design: Name of the design.
        estimator: Name of the estimator.
        planned: All runs.
        done: Those that have a score or a reason for having none.
        diverged: Done, but the estimator diverged.
        plant_left: Done, but the vehicle went out of control.
    """

    design: str
    estimator: str
    planned: int
    done: int = 0
    diverged: int = 0
    plant_left: int = 0


@dataclass(frozen=True)
class Progress:
    """How far a study is.

    Attributes:
        name: Name of the study.
        counts: By design and estimator.
        planned: All runs, each with every estimator.
        done: Finished ones.
        lost: Files that are missing or damaged; their runs count as missing.
        writer: Who is writing the folder, ``None`` for nobody.
        beside: What is wrong with the files beside the store, in words with the remedy.
        rate: Runs per s of late; ``None`` where nobody is at work or too little is known.
    """

    name: str
    counts: list[Count]
    planned: int
    done: int
    lost: list[Fault]
    writer: str | None
    beside: list[str]
    rate: float | None

    @property
    def left(self) -> float | None:
        """Time until all is done in s, if it is known."""
        return None if self.rate is None else (self.planned - self.done) / self.rate


def progress(folder: Path) -> Progress:
    """Return how far the study in a folder is, whether or not it is being run.

    Raises:
        UserError: If there is no store, or its root is damaged.
    """
    with reached(folder):
        return _progress(folder)


def _progress(folder: Path) -> Progress:
    path = store_of(folder)
    with sealed_root.told_as_no_store(path):
        lost = sealed_root.faults(path)
        name = sealed_root.study_name(path)
        if any(fault.file == "zarr.json" for fault in lost):
            raise UserError(f"{path}: {lost[0]}; 'harness run' with the study '{name}' and '--out {folder}' mends it")
        root: Any = stores.group(path)
        designs = checksums.names(root.attrs["designs"])
    bad = {fault.unit for fault in lost if fault.unit is not None}
    writer = holder(folder)
    counts: list[Count] = []
    planned = done = 0
    finished: list[tuple[float, int]] = []
    for design in designs:
        names = f"{design}/{STATUS}", f"{design}/estimator", f"{checksums.GROUP}/{design}"
        status, estimators, sums = (checksums.opened(path, name) for name in names)
        try:
            own = [Count(design, str(e), int(np.prod(status.shape[:-1]))) for e in estimators[...]]
            about = dict(sums.attrs)
        except (TypeError, AttributeError, KeyError, ValueError, OSError, RuntimeError):
            continue  # damaged, as ``lost`` says
        planned += own[0].planned
        times = checksums.finished(path, design)
        for place, values in _units(times, status, about):
            if place in bad:
                continue
            runs = values[..., 0].size
            done += runs
            finished.append((times[place], runs))
            for e, count in enumerate(own):
                count.done += runs
                count.diverged += int(np.sum(values[..., e] == ESTIMATOR_DIVERGED))
                count.plant_left += int(np.sum(values[..., e] == PLANT_DIVERGED))
        counts += own
    rate = _rate(finished) if writer else None
    return Progress(name, counts, planned, done, lost, writer, run_file.faults(folder), rate)


def _units(
    finished: Iterable[checksums.Place], status: Any, about: Mapping[str, Any]
) -> Iterator[tuple[checksums.Place, Any]]:
    """Go through the finished units of a design with the status of their runs; ``about`` as of ``chunk_files``."""
    for place in finished:
        _, band, chunk, drive = place
        sample, repeat = divmod(chunk, int(about.get("repeat_chunks", 1)))
        try:
            values = np.asarray(status.blocks[band, sample, drive, repeat, 0])
        except (ValueError, OSError, RuntimeError):  # a damaged chunk
            continue
        if not np.any(values == PENDING):
            yield place, values


def _rate(finished: list[tuple[float, int]]) -> float | None:
    """Return runs per s over the last units that were finished, by the times of their files."""
    late = sorted(finished)[-_RECENT:]
    took = late[-1][0] - late[0][0] if late else 0.0
    return sum(runs for _, runs in late[1:]) / took if took > 0 else None
