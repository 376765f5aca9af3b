"""The random numbers of a run: they depend on neither the order of the runs nor the number of workers."""

from __future__ import annotations

import zlib
from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.config import Study
from harness.engine.simd.lanes import LANES
from harness.study.design import Unit


class Case(NamedTuple):
    """One run of a unit: its Sobol point and its repeat."""

    sample: int
    repeat: int


class RunNoise:
    """The noise of a study's runs and the seeds of its estimators.

    Args:
        study: The study.
    """

    def __init__(self, study: Study) -> None:
        self._seed, self._begin = study.seed, study.count_from
        self._common = [design.common_noise for design in study.designs]

    def key(self, unit: Unit, case: Case) -> tuple[int, int, int]:
        """Return what a run's noise depends on: not the band, as levels share it, and in some designs not the point."""
        begin, sample = self._begin, 0 if self._common[unit.design] else case.sample
        return begin.drive + unit.drive, begin.sample + sample, begin.repeat + case.repeat

    def draw(self, unit: Unit, group: Sequence[Case], samples: int, width: int) -> NDArray[np.float64]:
        """Return standard normal numbers ``(samples, width, LANES)``; lanes without a run repeat the last one."""
        noise = np.empty((samples, width, LANES))
        keys = [self.key(unit, case) for case in group]
        for lane, key in enumerate(keys):
            if lane and key == keys[lane - 1]:
                noise[:, :, lane] = noise[:, :, lane - 1]
                continue
            rng = np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=key))
            noise[:, :, lane] = rng.standard_normal((samples, width))
        noise[:, :, len(group) :] = noise[:, :, len(group) - 1 : len(group)]
        return noise

    def of_input(self, unit: Unit, group: Sequence[Case], samples: int, signal: str) -> NDArray[np.float64]:
        """Return standard normal numbers ``(samples, LANES)`` for an input, which no other noise depends on."""
        tag = zlib.crc32(signal.encode())
        keys = [(*self.key(unit, case), tag, 1) for case in group]
        drawn = {
            key: np.random.default_rng(np.random.SeedSequence(self._seed, spawn_key=key)).standard_normal(samples)
            for key in dict.fromkeys(keys)
        }
        return np.stack([drawn[key] for key in (*keys, *keys[-1:] * (LANES - len(keys)))], axis=1)

    def seeds(self, unit: Unit, group: Sequence[Case], estimator: str) -> list[np.random.SeedSequence]:
        """Return the seed of an estimator in each lane; it depends on its name, not on its place in the study."""
        tag = zlib.crc32(estimator.encode())
        keys = [(*self.key(unit, c), tag) for c in group]
        keys += keys[-1:] * (LANES - len(group))
        return [np.random.SeedSequence(self._seed, spawn_key=key) for key in keys]
