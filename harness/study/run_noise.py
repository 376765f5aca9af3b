"""The random numbers of a run: they depend on neither the order of the runs nor the number of workers."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from harness.config import StudySpec
from harness.engine.simd.lanes import LANES
from harness.engine.standard_normal import seed_words, standard_normal
from harness.study.design import Unit

Scalar = TypeVar("Scalar", bound=np.generic)


class Case(NamedTuple):
    """One run of a unit: its Sobol point and its repeat."""

    sample: int
    repeat: int


Cases = Sequence[Case] | NDArray[np.int64]
"""Runs of a unit; in an array ``(runs, 2)`` many of them."""


class RunNoise:
    """The noise of a study's runs and the seeds of its estimators.

    Args:
        study: The study.
    """

    def __init__(self, study: StudySpec) -> None:
        self._seed, self._begin = study.seed, study.count_from
        self._common = [design.common_noise for design in study.designs]

    def key(self, unit: Unit, case: Case) -> tuple[int, int, int]:
        """Return what a run's noise depends on: not the band, as levels share it, and in some designs not the point."""
        begin, sample = self._begin, 0 if self._common[unit.design] else case.sample
        return begin.drive + unit.drive, begin.sample + sample, begin.repeat + case.repeat

    def words(self, unit: Unit, cases: Cases, *further: int) -> NDArray[np.uint64]:
        """Return what the noise of runs is drawn from, one row each; lanes without a run repeat the last one.

        Args:
            unit: That the runs belong to.
            cases: The runs.
            further: Behind what each depends on, for noise of another kind.
        """
        counted = in_whole_batches(np.asarray(cases, dtype=np.uint64))
        keys = np.empty((len(counted), 3 + len(further)), dtype=np.uint64)
        keys[:, :3], keys[:, 3:] = self.key(unit, Case(0, 0)), further
        keys[:, 2] += counted[:, 1]
        if not self._common[unit.design]:
            keys[:, 1] += counted[:, 0]
        return seed_words(self._seed, keys)

    def of_input(self, unit: Unit, group: Cases, samples: int, signal: str) -> NDArray[np.float64]:
        """Return standard normal numbers ``(..., samples, LANES)`` for an input, which no other noise depends on."""
        return standard_normal(self.words(unit, group, zlib.crc32(signal.encode()), 1), samples, 1)[..., 0, :]

    def seeds(self, unit: Unit, group: Cases, estimator: str) -> list[np.random.SeedSequence]:
        """Return the seed of an estimator in each lane; it depends on its name, not on its place in the study."""
        tag = zlib.crc32(estimator.encode())
        keys = [(*self.key(unit, Case(int(sample), int(repeat))), tag) for sample, repeat in group]
        keys += keys[-1:] * (-len(group) % LANES)
        return [np.random.SeedSequence(self._seed, spawn_key=key) for key in keys]


def in_whole_batches(rows: NDArray[Scalar]) -> NDArray[Scalar]:
    """Return rows of runs ``(runs, ...)`` with the last one repeated for the lanes without a run."""
    spare = -len(rows) % LANES
    return np.concatenate([rows, np.repeat(rows[-1:], spare, axis=0)]) if spare else rows
