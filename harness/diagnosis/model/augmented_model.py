"""A nominal model together with every effect of the library that fits it: one filter for all hypotheses.

A hypothesis (which effect is there, how large, which parameters are wrong) is a vector of parameter values of the
*augmented* model, in which all effects act and are neutral unless stated. So every hypothesis is a point of one space,
its likelihood one run of one compiled filter, and trying an effect compiles nothing.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.common.errors import ModelError, UserError
from harness.config import InputSignal, ModelSpec
from harness.diagnosis.model import time_loops
from harness.engine.compile import compile_model, load_source, paste
from harness.engine.simd.lanes import LANES
from harness.identification.data import Drive
from harness.identification.filtered_model import Candidates, FilteredModel
from harness.identification.measured_inputs import Between
from harness.models.assembly.assemble import Model, assemble
from harness.models.assembly.candidates import assembled, placements
from harness.models.assembly.placement import load_effect, split
from harness.models.roles import VEHICLES

_FAR = 1.0
"""s; horizon from which the errors of the inputs count as what they do to a free run: they last about as long."""


@dataclass(frozen=True)
class Ahead:
    """How a model predicts a recording at several horizons; one row per sample behind the first.

    Attributes:
        densities: Logarithm of the density of each sample's measurements ``(samples, horizons)``; minus infinity where
            the prediction left its range.
        squares: Their squared distance from the prediction over its covariance ``(samples, horizons)``.
        seen: How many were measured ``(samples,)``.
    """

    densities: Floats
    squares: Floats
    seen: NDArray[np.int_]


class AugmentedModel(FilteredModel):
    """The compiled filter of a nominal model and everything it may lack.

    Covariance and gains are those of the nominal model's extended Kalman filter, the mean is that of all effects too.
    What is absent costs nothing: the kernels skip the effects that are neutral.

    Args:
        spec: The nominal model.
        available: Signals that the recordings hold; effects that need others are left out.
        jobs: Threads; all cores by default.
        excluded: Effects (files) that are left out.
    """

    def __init__(
        self, spec: ModelSpec, available: Iterable[str], jobs: int | None = None, excluded: Iterable[str] = ()
    ) -> None:
        self.excluded = frozenset(excluded)
        self.placements = addable_effects(spec, set(available), self.excluded)
        files = tuple(dict.fromkeys(split(name)[0] for name in self.placements))
        super().__init__(spec, _assembled(spec, files), jobs, jacobians=False)
        self._nominal_rows = [self.row(n) for n in self.nominal.parameter_names]
        self._inputs = np.array([self.model.inputs.index(name) for name in self.nominal.inputs])
        self._limited = np.flatnonzero(np.isfinite(self._limits))
        self._nominal = compile_model(self.nominal, spec.step)
        self._loop = load_source("filter_whole", self._loop_source())

    def _loop_source(self) -> str:
        given = {
            time_loops.next_state_whole: self.compiled.kernels.next_state,
            time_loops.output_whole: self.compiled.kernels.output,
            time_loops.NX_WHOLE: self.compiled.nx,
            time_loops.NW_WHOLE: self.compiled.nw,
        }
        return paste(self._nominal, "filter_whole", [time_loops.filter_whole], given)

    def stated(self) -> Floats:
        """Return the parameters with which it is the nominal model ``(np,)``; those of absent effects as they start."""
        values = np.empty(len(self.names))
        for i, p in enumerate(self.model.parameters):
            if p.name in self.spec.values:
                values[i] = self.spec.values[p.name]
            elif p.neutral is not None:
                values[i] = p.neutral
            else:
                values[i] = p.grid[0] if p.grid else p.upper if p.per_drive else p.lower
        return values

    def drive(
        self, recording: xr.Dataset, name: str, between: Between = "joined", signal: InputSignal | None = None
    ) -> Drive:
        """Return a recording in terms of this model; its inputs run straight between samples."""
        return super().drive(recording, name, between, signal)

    def _filter(self, drive: Drive, candidates: Candidates, total: Floats, notes: tuple[Floats, ...]) -> None:
        self._filter_ahead(drive, candidates, total, notes, self._ahead((), drive, 0))

    def _ahead(self, horizons: Sequence[float], drive: Drive, samples: int) -> tuple[Floats, ...]:
        """Return what ``time_loops.keep_ahead`` needs for horizons in samples; nothing is kept of no samples."""
        lanes = np.ones((1, LANES))
        lanes[0, : len(horizons)] = horizons
        far = (lanes * self.spec.step >= _FAR).astype(float)
        return lanes, far, drive.spread, np.zeros((samples, LANES)), np.zeros((samples, LANES))

    def predict(self, drive: Drive, point: Candidates, horizons: Sequence[float]) -> Ahead:
        """Predict the measurements of a recording at several horizons, with the model's own covariance.

        From every restart a prediction runs as many samples as its horizon, without their measurements, and then
        begins again from the filter. An infinite horizon is that of the free run.

        Args:
            drive: The recording.
            point: One candidate.
            horizons: Samples, at most ``LANES`` of them; the first one is 1, that of the filter.
        """
        kept = self._ahead(horizons, drive, len(drive.inputs))
        self._filter_ahead(drive, point.in_lanes(), np.empty((2, LANES)), self._notes(0), kept)
        densities, squares = (part[1:, : len(horizons)] for part in kept[3:])
        return Ahead(
            np.where(np.isfinite(densities), densities, -np.inf),
            np.where(np.isfinite(squares), squares, np.inf),
            np.isfinite(drive.measurements[1:]).sum(axis=1),
        )

    def _filter_ahead(
        self,
        drive: Drive,
        candidates: Candidates,
        total: Floats,
        notes: tuple[Floats, ...],
        ahead: tuple[Floats, ...],
    ) -> None:
        self._loop.filter_whole(
            drive.inputs,
            drive.between,
            self._inputs,
            drive.measurements,
            drive.effects,
            self.compiled.constants(candidates.values),
            self._nominal.constants(np.ascontiguousarray(candidates.values[self._nominal_rows])),
            candidates.process,
            candidates.measurement,
            self._first(drive, candidates.values),
            np.repeat(drive.first_variance[:, None], LANES, axis=1),
            (self._limited, self._limits[self._limited]),
            total,
            (notes, ahead),
        )


def addable_effects(spec: ModelSpec, available: set[str], excluded: frozenset[str] = frozenset()) -> tuple[str, ...]:
    """Return the effects of the library that a model may lack, place by place.

    Left out are effects that are a random process (``random_process`` finds those), effects whose inputs the recordings
    do not hold, and those that the model has or the user excludes.
    """
    found, without = [], excluded | {split(e)[0] for e in spec.effects}
    for name in placements(spec.vehicle, spec.tyre, spec.sensors):
        if getattr(load_effect(name), "NOISE", None) or split(name)[0] in without:
            continue
        model = assembled(spec.vehicle, spec.tyre, (*spec.effects, name), spec.sensors)
        needed = {model.rates.get(i, i) for i in model.inputs} - {"time"}
        if needed <= available:
            found.append(name)
    return tuple(found)


def _assembled(spec: ModelSpec, files: tuple[str, ...]) -> Model:
    """Return the nominal model with all of these effects; an incompatible one is refused by name."""
    VEHICLES.load(spec.vehicle)
    try:
        return assemble(spec.vehicle, spec.tyre, (*spec.effects, *files), spec.sensors, optional=True)
    except ModelError as error:
        raise UserError(f"effects of the library are incompatible: {error}") from None
