"""Points of the space that a fit searches: parameters and variances of candidates, column by column."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.config import ModelSpec
from harness.engine.simd.lanes import LANES
from harness.identification.data import DriveData


@dataclass(frozen=True)
class Candidates:
    """What candidates hold, or directions in that space; one column each.

    Attributes:
        values: Parameters in the model's order ``(np, n)``.
        process: Variances per step, by state that the filter corrects ``(nx, n)``.
        measurement: Variances per sample ``(ny, n)``.
    """

    values: Floats
    process: Floats
    measurement: Floats

    @classmethod
    def of(cls, spec: ModelSpec) -> Candidates:
        """Return what a resolved model holds, as one candidate."""
        model = spec.model()
        return cls(
            np.array([[spec.values[n]] for n in model.parameter_names]).reshape(-1, 1),
            np.array([[spec.process_noise[n]] for n in model.states]),
            np.array([[spec.measurement_noise[n]] for n in model.outputs]),
        )

    @classmethod
    def together(cls, candidates: Sequence[Candidates]) -> Candidates:
        """Return the candidates of several."""
        return cls(*(np.hstack(arrays) for arrays in zip(*(vars(c).values() for c in candidates), strict=True)))

    @property
    def count(self) -> int:
        """Number of candidates."""
        return self.measurement.shape[1]

    def take(self, columns: slice | Sequence[int]) -> Candidates:
        """Return some of the candidates."""
        return Candidates(self.values[:, columns], self.process[:, columns], self.measurement[:, columns])

    def in_lanes(self) -> Candidates:
        """Return up to ``LANES`` candidates as the kernels take them, the last one in all lanes that are left."""
        filled = self.take([min(k, self.count - 1) for k in range(LANES)])
        return Candidates(*(np.ascontiguousarray(a, dtype=float) for a in vars(filled).values()))


Each = Candidates | Sequence[Candidates]
"""Candidates, the same for all recordings or for each recording its own."""


def for_each(candidates: Each, drives: Sequence[DriveData]) -> Sequence[Candidates]:
    """Return the candidates of each recording."""
    return [candidates] * len(drives) if isinstance(candidates, Candidates) else candidates
