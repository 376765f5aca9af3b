"""Compile the estimators that a trace runs with the nominal and the amended model before the first of them runs."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Any

import xarray as xr

from harness.config import ModelSpec
from harness.engine.further_processes import compile_all
from harness.identification.filtered_model import Candidates
from harness.identification.innovations import Innovations

_LONG_ENOUGH = 100
"""Samples of a recording; what is compiled does not depend on their number."""


@dataclass(frozen=True)
class EstimatorKernels:
    """The filters of several models and estimators.

    Attributes:
        specs: Models.
        kinds: Files in ``harness/estimation/methods``.
        recording: Holds their signals; a few samples of it.
    """

    specs: tuple[ModelSpec, ...]
    kinds: tuple[str, ...]
    recording: xr.Dataset

    @cached_property
    def _filters(self) -> list[Innovations]:
        return [Innovations(spec, kind, 1) for kind in self.kinds for spec in self.specs]

    @property
    def kernels(self) -> int:
        """Number of filters."""
        return len(self._filters)

    @property
    def loops(self) -> list[Any]:
        """The compiled loops."""
        return [filters.loop for filters in self._filters]

    def warm_up(self, index: int) -> str:
        """Compile one of them and return the name of its estimator; what cannot be compiled is told where it runs."""
        filters = self._filters[index]
        with suppress(Exception):
            drive = filters.drive(self.recording, "", "joined")
            filters.run(drive, Candidates.of(filters.spec))
        return self.kinds[index // len(self.specs)]


def compile_estimators(
    specs: Sequence[ModelSpec],
    kinds: Sequence[str],
    recording: xr.Dataset,
    processes: int,
    say: Callable[[str], None],
) -> None:
    """Compile the filters of estimators for some models, in further processes where several are in no cache.

    Args:
        specs: The models.
        kinds: Files in ``harness/estimation/methods``.
        recording: Holds their signals.
        processes: That may work at a time, this one included.
        say: Told in words what is done.

    Raises:
        ModelError: If there is no such estimator.
    """
    again = partial(EstimatorKernels, tuple(specs), tuple(kinds), recording.isel(time=slice(0, _LONG_ENOUGH)).load())
    compile_all(again(), again, lambda missing: min(processes, missing) - 1, say)
