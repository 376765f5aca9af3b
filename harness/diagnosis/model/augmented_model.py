"""A nominal model together with every effect of the library that fits it: one filter for all hypotheses.

A hypothesis (which effect is there, how large, which parameters are wrong) is a vector of parameter values of the
*whole* model, in which all effects act and are neutral unless stated. So every hypothesis is a point of one space, its
likelihood one run of one compiled filter, and trying an effect compiles nothing.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import xarray as xr

from harness.common import registry
from harness.common.arrays import Floats
from harness.common.errors import ModelError, UserError
from harness.config import ModelSpec
from harness.diagnosis.model import time_loops
from harness.engine.compile import compile_model, load_source, paste
from harness.engine.simd.lanes import LANES
from harness.identification import time_loops as identify_kernels
from harness.identification.data import Drive, drive_from, joined, step_of
from harness.models.assembly.assemble import Model, assemble
from harness.models.assembly.candidates import assembled, placements
from harness.models.assembly.placement import load_effect, split

_Task = TypeVar("_Task")
_Answer = TypeVar("_Answer")
_STEP_TOLERANCE = 1e-3


@dataclass(frozen=True)
class Noise:
    """Variances that a filter believes, one column per candidate.

    Attributes:
        process: Per step, by state of the nominal model ``(nx, n)``.
        measurement: Per sample, by output ``(ny, n)``.
    """

    process: Floats
    measurement: Floats


@dataclass(frozen=True)
class Pass:
    """What one run of the filter over a recording leaves.

    Attributes:
        log_likelihood: Of the recording; minus infinity if the filter diverged.
        whitened: Whitened innovations ``(samples, ny)``, NaN where missing and at the first sample.
        whitening: Inverse Cholesky factor of the innovation covariance ``(samples, ny, ny)``.
        gain: ``(samples, nx of the whole model, ny)``; zero for the effects' own states.
        state: Corrected mean of the whole model ``(samples, nx)``, zero at the first sample.
    """

    log_likelihood: float
    whitened: Floats
    whitening: Floats
    gain: Floats
    state: Floats


@dataclass(frozen=True)
class FreeRun:
    """The model alone over a recording.

    Attributes:
        states: Of the whole model, as long as they stay in the range in which the equations hold ``(until, nx)``.
        outputs: ``(samples, ny)``, NaN from where it left that range.
    """

    states: Floats
    outputs: Floats


class Whole:
    """The compiled filter of a nominal model and everything it may lack.

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
        self.spec, self.nominal, self.excluded = spec, spec.model(), frozenset(excluded)
        self.jobs = jobs or os.cpu_count() or 1
        self.placements = candidates_of(spec, set(available), self.excluded)
        files = tuple(dict.fromkeys(split(name)[0] for name in self.placements))
        self.model = _assembled(spec, files)
        self.names = self.model.parameter_names
        self._rows = {name: i for i, name in enumerate(self.names)}
        self._nominal_rows = [self._rows[n] for n in self.nominal.parameter_names]
        options = (spec.step, spec.integrator, spec.substeps)
        self._filter = compile_model(self.nominal, spec.step)
        self._plain, self.duals = (compile_model(self.model, *options, duals=d, jacobians=False) for d in (False, True))
        self._loop = load_source("filter_whole", self._loop_source())
        self._free = load_source("run_whole", paste(self._plain, "run_whole", [identify_kernels.run_free]))
        self._follow = load_source("follow_whole", paste(self.duals, "follow_whole", [identify_kernels.follow]))
        self._limits = np.array([self.model.valid.get(name, np.inf) for name in self.model.states])
        self._limited = np.flatnonzero(np.isfinite(self._limits))
        self._inputs = np.array([self.model.inputs.index(name) for name in self.nominal.inputs])
        self._started = [(i, self.model.start[s]) for i, s in enumerate(self.model.states) if s in self.model.start]

    def _loop_source(self) -> str:
        given = {
            time_loops.next_state_whole: self._plain.kernels.next_state,
            time_loops.output_whole: self._plain.kernels.output,
            time_loops.NX_WHOLE: self._plain.nx,
            time_loops.NW_WHOLE: self._plain.nw,
        }
        return paste(self._filter, "filter_whole", [time_loops.filter_whole], given)

    @property
    def nx(self) -> int:
        """Number of states of the nominal model."""
        return len(self.nominal.states)

    def row(self, name: str) -> int:
        """Return the row of a parameter."""
        return self._rows[name]

    def neutral(self) -> Floats:
        """Return the parameters with which the whole model is the nominal one ``(np,)``; others as they start."""
        values = np.empty(len(self.names))
        for i, p in enumerate(self.model.parameters):
            if p.name in self.spec.values:
                values[i] = self.spec.values[p.name]
            elif p.neutral is not None:
                values[i] = p.neutral
            else:
                values[i] = p.grid[0] if p.grid else p.upper if p.per_drive else p.lower
        return values

    def drive(self, recording: xr.Dataset, name: str) -> Drive:
        """Return a recording in terms of the whole model; inputs run straight between samples.

        Raises:
            UserError: If a signal is missing or the step is not the model's.
        """
        if abs(step_of(recording) - self.spec.step) > _STEP_TOLERANCE * self.spec.step:
            raise UserError(
                f"{name}: its samples are {step_of(recording):g} s apart, those of the model {self.spec.step:g} s; "
                "all recordings of a trace need the same step"
            )
        drive = joined(drive_from(recording, self.model, name), self.model)
        states = self.free_run(drive, self.neutral()).states[:, : self.nx]
        variance = np.mean((states - states[0]) ** 2, axis=0)
        process = np.array([self.spec.process_noise[s] for s in self.nominal.states])
        return replace(drive, first_variance=variance + process)

    def likelihoods(self, drive: Drive, values: Floats, noise: Noise) -> Floats:
        """Return the log-likelihood of a recording for candidates ``(np, n)`` with their noise; one thread."""
        n = values.shape[1]
        found = [self._run(drive, values, noise, range(s, min(s + LANES, n))) for s in range(0, n, LANES)]
        return np.concatenate(found)

    def run(self, drive: Drive, values: Floats, noise: Noise) -> Pass:
        """Run the filter over a recording for one candidate ``(np,)`` and keep innovations, whitening and gains."""
        (samples, ny), nx = drive.measurements.shape, self.nx
        whitened, state = np.full((samples, ny), np.nan), np.zeros((samples, len(self.model.states)))
        whitening, gain = np.zeros((samples, ny, ny)), np.zeros((samples, nx, ny))
        notes = (whitened, whitening, gain, state)
        likelihood = self._run(drive, values[:, None], noise, range(1), notes)
        whole = np.zeros((samples, len(self.model.states), ny))
        whole[:, :nx] = gain
        return Pass(float(likelihood[0]), whitened, whitening, whole, state)

    def _run(
        self, drive: Drive, values: Floats, noise: Noise, columns: range, notes: tuple[Floats, ...] | None = None
    ) -> Floats:
        chosen = [columns[min(k, len(columns) - 1)] for k in range(LANES)]
        held, ny = np.ascontiguousarray(values[:, chosen]), self._filter.ny
        total = np.empty((2, LANES))
        nothing = (np.empty((0, ny)), np.empty((0, ny, ny)), np.empty((0, self.nx, ny)), np.empty((0, 1)))
        self._loop.filter_whole(
            drive.inputs,
            drive.between,
            self._inputs,
            drive.measurements,
            self._plain.constants(held),
            self._filter.constants(np.ascontiguousarray(held[self._nominal_rows])),
            np.ascontiguousarray(noise.process[:, chosen]),
            np.ascontiguousarray(noise.measurement[:, chosen]),
            self._first(drive, held),
            np.repeat(drive.first_variance[:, None], LANES, axis=1),
            self._limited,
            self._limits[self._limited],
            total,
            nothing if notes is None else notes,
        )
        valid = (total[1] >= len(drive.inputs)) & np.isfinite(total[0])
        return np.where(valid, total[0], -np.inf)[: len(columns)]

    def sensitivities(self, drive: Drive, values: Floats, directions: Floats, kept: Pass) -> Floats:
        """Return derivatives of the whitened innovations, gains and whitening held fixed ``(samples, ny, n)``.

        Args:
            drive: The recording.
            values: A candidate for each direction ``(np, n)``; they may differ in what has no effect at ``kept``.
            directions: ``(np, n)``.
            kept: From ``run``.
        """
        n, slopes = directions.shape[1], [np.zeros((*drive.measurements.shape, 0))]
        for s in range(0, n, LANES):
            columns = [min(k, n - 1) for k in range(s, s + LANES)]
            both = np.concatenate([values[:, columns], directions[:, columns]], axis=1)
            found = np.zeros((*drive.measurements.shape, LANES))
            self._follow.follow(
                drive.inputs,
                drive.between,
                drive.measurements,
                self.duals.constants(both),
                self._first(drive, both),
                kept.gain[:, : self.nx],
                kept.whitening,
                found,
            )
            slopes.append(found)
        return np.concatenate(slopes, axis=2)[:, :, :n]

    def free_run(self, drive: Drive, values: Floats) -> FreeRun:
        """Run the model alone over the inputs of a recording for one candidate ``(np,)``."""
        samples = len(drive.inputs)
        held = np.repeat(values[:, None], LANES, axis=1)
        states, outputs = np.empty((samples, self._plain.nx, LANES)), np.empty((samples, self._plain.ny, LANES))
        left = np.empty((1, LANES))
        constants, first = self._plain.constants(held), self._first(drive, held)
        self._free.run_free(drive.inputs, drive.between, constants, first, self._limits, states, outputs, left)
        found, until = outputs[:, :, 0].copy(), int(left[0, 0])
        found[until:] = np.nan
        return FreeRun(states[: max(1, until), :, 0].copy(), found)

    def share(self, work: Callable[[_Task], _Answer], tasks: Sequence[_Task]) -> list[_Answer]:
        """Do independent work in threads; the kernels release the GIL, and answers come in the order of the tasks."""
        if self.jobs == 1 or len(tasks) < 2:
            return [work(task) for task in tasks]
        with ThreadPoolExecutor(self.jobs) as pool:
            return list(pool.map(work, tasks))

    def _first(self, drive: Drive, held: Floats) -> Floats:
        """Return the first mean in lanes or duals: of the recording, but for states that a parameter starts."""
        first = np.zeros((len(self.model.states), held.shape[1]))
        first[:, :LANES] = drive.first_mean[:, None]
        for i, source in self._started:
            if source in self._rows:
                first[i] = held[self._rows[str(source)]]
        return first


def candidates_of(spec: ModelSpec, available: set[str], excluded: frozenset[str] = frozenset()) -> tuple[str, ...]:
    """Return the effects of the library that a model may lack, place by place.

    Left out are effects that are a random process (``wandering`` finds those), effects whose inputs the recordings do
    not hold, and those that the model has or the user excludes.
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
    """Return the nominal model with all of these effects; one that does not go with the others is refused by name."""
    registry.load("harness.models.vehicles", spec.vehicle)
    try:
        return assemble(spec.vehicle, spec.tyre, (*spec.effects, *files), spec.sensors, optional=True)
    except ModelError as error:
        raise UserError(f"the effects of the library do not go together: {error}") from None
