"""Gain of the amendment for estimators, run on the held-out drives with the nominal and the amended model.

Each output in turn is estimated without its own measurement: its variance is stated so large that the measurement has
no weight, and the prediction of the filter is compared with what was measured. The filters are compiled before the
first of them runs.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import Any

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.config import ModelSpec
from harness.diagnosis.fitting import ParameterPoint
from harness.diagnosis.selection.forward_selection import Trace
from harness.engine.further_processes import compile_all
from harness.identification.candidates import Candidates
from harness.identification.data import DriveData
from harness.identification.innovations import Innovations


def fitted_model(trace: Trace, spec: ModelSpec, point: ParameterPoint) -> ModelSpec:
    """Return a model with values and variances of a point.

    An effect's own states have no noise unless it is a random process, and a change begins when it does in the first
    drive.
    """
    augmented, noise = trace.fitting.augmented, trace.fitting.noise([point])
    process = dict(zip(augmented.nominal.states, map(float, noise.process[:, 0]), strict=True))
    model = spec.model()
    point_values = dict(zip(augmented.names, map(float, point.values[:, 0]), strict=True))
    noise_of = {s: q * spec.step for s, q in model.noise.items()} | spec.process_noise | process
    return replace(
        spec,
        values={n: point_values[n] if n in point_values else spec.values[n] for n in model.parameter_names},
        process_noise={s: noise_of.get(s, 0.0) for s in model.states},
        measurement_noise=dict(zip(model.outputs, map(float, noise.measurement[:, 0]), strict=True)),
    )


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
        say: Receives what is being done, in words.

    Raises:
        ModelError: If there is no such estimator.
    """
    again = partial(EstimatorKernels, tuple(specs), tuple(kinds), recording.isel(time=slice(0, _LONG_ENOUGH)).load())
    compile_all(again(), again, lambda missing: min(processes, missing) - 1, say)


_UNSEEN = 1e12
"""Factor on the variance of a measurement that an estimator must not use."""


@dataclass(frozen=True)
class EstimatorErrors:
    """One estimator on the held-out drives.

    Attributes:
        kind: File in ``harness/estimation/methods``.
        before: Root mean square error of each output, estimated without its own measurement, with the nominal model
            ``(ny,)``; infinite if the filter diverged.
        after: The same with the amended model.
    """

    kind: str
    before: Floats
    after: Floats


def estimators_on(
    trace: Trace,
    amended: ModelSpec,
    recordings: Sequence[xr.Dataset],
    kinds: Sequence[str],
    say: Callable[[str], None] = lambda _: None,
) -> tuple[EstimatorErrors, ...]:
    """Run estimators on the held-out drives with both models.

    Args:
        trace: What was found.
        amended: The final model.
        recordings: The held-out drives, in the order of ``trace.held_out``.
        kinds: Files in ``harness/estimation/methods``.
        say: Receives what is being run, in words.

    Raises:
        ModelError: If there is no such estimator.
    """
    nominal = trace.fitting.augmented.spec
    gains = []
    for kind in kinds:
        errors = []
        for spec, point, words in ((nominal, trace.before.point, "nominal"), (amended, trace.after.point, "amended")):
            say(f"{kind} with the {words} model")
            errors.append(_errors(trace, spec, point, recordings, kind))
        gains.append(EstimatorErrors(kind, *errors))
    return tuple(gains)


def _errors(
    trace: Trace, spec: ModelSpec, point: ParameterPoint, recordings: Sequence[xr.Dataset], kind: str
) -> Floats:
    """Return the root mean square errors of all outputs ``(ny,)``."""
    augmented = trace.fitting.augmented
    filters = Innovations(fitted_model(trace, spec, point), kind, augmented.jobs)
    squares = []
    for i, (drive, recording) in enumerate(zip(trace.held_out.drives, recordings, strict=True)):
        point_values = dict(zip(augmented.names, point.values[:, i], strict=True))
        values = np.array(
            [[point_values[n] if n in point_values else spec.values[n]] for n in filters.model.parameter_names]
        )
        held = replace(Candidates.of(filters.spec), values=values)
        own = filters.drive(recording, drive.name, "joined")
        squares.append(augmented.share(partial(_unseen, filters, own, held), range(len(held.measurement))))
    return np.array([np.sqrt(np.nanmean(np.concatenate(parts))) for parts in zip(*squares, strict=True)])


def _unseen(filters: Innovations, drive: DriveData, held: Candidates, output: int) -> Floats:
    """Return the squared errors of an output that the filter does not use ``(samples,)``."""
    variance = held.measurement.copy()
    variance[output] *= _UNSEEN
    run = filters.run(drive, replace(held, measurement=variance))
    return run.innovation[:, output] ** 2 if np.isfinite(run.log_likelihood) else np.array([np.inf])
