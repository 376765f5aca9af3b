"""A model under a Kalman filter, over recordings: likelihood, innovations, their derivatives, and the free run.

Every filter that fits or judges a model is a variant of ``FilteredModel``: ``Innovations`` runs any estimator of Kalman
type on the model at hand, ``harness.diagnosis.model.augmented_model.AugmentedModel`` the extended Kalman filter of a
nominal model around the mean of one that holds all that may be missing. A variant states how its filter runs over a
recording; what is asked of it, how it is shared among threads, and the derivatives with the gains held fixed are the
same.
"""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from typing import TypeVar

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.common.cache import LastUsed
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.config import InputSignal, ModelSpec
from harness.engine.compile import compile_model, load_source, paste
from harness.engine.simd.lanes import LANES
from harness.identification import time_loops
from harness.identification.candidates import Candidates, Each, for_each
from harness.identification.data import STEP_TOLERANCE, DriveData, drive_from, started_by, steered, step_of
from harness.identification.free_run import FreeRun, Start
from harness.identification.input_effects import InputEffects
from harness.identification.measured_inputs import Between
from harness.models.assembly.assemble import StateSpaceModel
from harness.runner.contract import Held

_Task = TypeVar("_Task")
_Answer = TypeVar("_Answer")

REMEMBERED = 24
"""Runs that are kept: of some points over some fitted drives and the drives that judge them."""


@dataclass(frozen=True)
class Slopes:
    """The likelihood of recordings at a point with its derivatives.

    Attributes:
        log_likelihood: Sum over the recordings; minus infinity if the filter diverged.
        gradient: Its derivative along each direction ``(n,)``.
        information: Fisher information on each pair of directions ``(n, n)``.
    """

    log_likelihood: float
    gradient: Floats
    information: Floats


@dataclass(frozen=True)
class FilterRun:
    """What one run of the filter over a recording leaves.

    Attributes:
        log_likelihood: Of the recording; minus infinity if the filter diverged.
        innovation: Measurement minus its prediction ``(samples, ny)``, NaN where missing and at the first sample.
        deviation: Standard deviation that the filter states of it ``(samples, ny)``, NaN at the first sample.
        whitened: Innovations over the Cholesky factor of their covariance ``(samples, ny)``, white and of variance 1
            if the model is right; NaN where missing and at the first sample.
        whitening: Inverse of that factor ``(samples, ny, ny)``.
        gain: Gains ``(samples, nx, ny)`` of the states that the filter corrects, which come first.
        state: Corrected mean of all states, zero at the first sample.
    """

    log_likelihood: float
    innovation: Floats
    deviation: Floats
    whitened: Floats
    whitening: Floats
    gain: Floats
    state: Floats


def _runs(log_likelihoods: Floats, notes: tuple[Floats, ...]) -> list[FilterRun]:
    """Return what was kept, lane by lane."""
    return [FilterRun(float(total), *parts) for total, *parts in zip(log_likelihoods, *notes, strict=True)]


class FilteredModel(ABC):
    """A compiled model with a filter.

    Args:
        spec: The model that the filter knows; its values and variances are where a search begins.
        model: The equations of the mean, whose first states are those of the model of ``spec``.
        jobs: Threads; all cores by default.
        jacobians: Whether the kernels of ``model`` need derivatives.

    Attributes:
        compiled: Its kernels over lanes.
        duals: The same over dual numbers.
    """

    def __init__(
        self, spec: ModelSpec, model: StateSpaceModel, jobs: int | None = None, jacobians: bool = True
    ) -> None:
        self.spec, self.model, self.nominal = spec, model, spec.model()
        self.jobs = jobs or os.cpu_count() or 1
        self.names = model.parameter_names
        self._rows = {name: i for i, name in enumerate(self.names)}
        options = (spec.step, spec.integrator, spec.substeps)
        self.compiled, self.duals = (
            compile_model(model, *options, duals=duals, jacobians=jacobians) for duals in (False, True)
        )
        self._free = load_source(
            "run_free", paste(self.compiled, "run_free", [time_loops.run_free], time_loops.FREE_RUN)
        )
        self._follow = load_source("follow", paste(self.duals, "follow", [time_loops.follow]))
        self._limits = model.limits
        starts = started_by(model)
        self._started, self._starts = list(starts), list(starts.values())
        sources = [model.rates.get(name, name) for name in model.inputs]
        late = {self.row(p.name): [i for i, s in enumerate(sources) if s == p.late] for p in model.parameters if p.late}
        self._late = {row: columns for row, columns in late.items() if columns}
        self._effects = InputEffects(self.duals)
        self._remembered = LastUsed[tuple[DriveData, FilterRun]](REMEMBERED)

    @abstractmethod
    def _filter(self, drive: DriveData, held: Held, notes: tuple[Floats, ...]) -> Floats:
        """Return log-likelihood and first sample outside the limits of ``LANES`` candidates ``(2, LANES)``.

        Args:
            drive: The recording.
            held: By the candidates.
            notes: What ``time_loops.keep_lanes`` writes to.
        """

    @property
    def nx(self) -> int:
        """Number of states that the filter corrects."""
        return len(self.nominal.states)

    def row(self, name: str) -> int:
        """Return the row of a parameter."""
        return self._rows[name]

    def stated(self) -> Floats:
        """Return the parameters of the model at hand ``(np,)``."""
        return np.array([self.spec.values[n] for n in self.names])

    def along(self, names: Sequence[str]) -> Floats:
        """Return the directions of single parameters ``(np, n)``.

        Raises:
            UserError: If the model has no such parameter.
        """
        for name in names:
            if name not in self._rows:
                raise UserError(f"the model has no parameter '{name}'{closest(name, self.names)}")
        directions = np.zeros((len(self.names), len(names)))
        directions[[self._rows[n] for n in names], range(len(names))] = 1.0
        return directions

    def drive(
        self, recording: xr.Dataset, name: str, between: Between = "held", signal: InputSignal | None = None
    ) -> DriveData:
        """Return a recording in terms of this model, with the spread of the first state and what its inputs' errors do.

        How far the first state may lie from its mean is taken from a free run of the model at hand over the inputs of
        the recording: the mean square of each state, and its process noise. A state that a parameter starts has no
        spread but its noise. The effect of the errors is linearised along a pass of the filter with the model at hand.

        Args:
            recording: From ``harness.recordings.load_recording`` or ``harness.simulation.simulate.simulate_drive``.
            name: Of the recording, for errors and reports.
            between: How inputs go on behind a sample.
            signal: What of them is taken, see ``harness.identification.measured_inputs.inputs_of``.

        Raises:
            UserError: If a signal is missing or the step is not the model's.
        """
        if abs(step_of(recording) - self.spec.step) > STEP_TOLERANCE * self.spec.step:
            coarser = max(step_of(recording), self.spec.step)
            raise UserError(
                f"{name}: its samples are {step_of(recording):g} s apart, those of the model {self.spec.step:g} s; all "
                f'recordings need the same step: state [recording] step = "{1e3 * coarser:g} ms" in the channel maps'
            )
        drive = drive_from(steered(recording, self.spec.values), self.model, name, between, signal)
        states = self.free_run(drive, self.stated()).states[:, : self.nx]
        variance = np.mean((states - states[0]) ** 2, axis=0)
        variance[[i for i in self._started if i < self.nx]] = 0.0
        return self._with_effects(replace(drive, first_variance=variance + self._start_variance()))

    def _start_variance(self) -> Floats:
        """Return the variance that the first state has besides that of the free run ``(nx,)``."""
        return np.array([self.spec.process_noise[s] for s in self.nominal.states])

    def _with_effects(self, drive: DriveData) -> DriveData:
        """Return a drive with what the errors of its inputs do to the corrected states and to the outputs."""
        if not drive.input_errors.rows:
            return drive
        stated, values = Candidates.of(self.spec), self.stated()
        kept = self.run(drive, replace(stated, values=values[:, None]))
        states = kept.state
        states[0] = self.first_state(drive, values)
        read, held = self.read_ahead(drive, values[:, None])
        effects, spread = self._effects.along(read, states, held[:, 0], self.nx)
        return replace(drive, effects=effects, spread=spread)

    def log_likelihoods(self, drives: Sequence[DriveData], candidates: Each, keep_first: bool = False) -> Floats:
        """Return the log-likelihood of all recordings for each candidate ``(n,)``; minus infinity if it diverges.

        Args:
            drives: The recordings.
            candidates: The same for all recordings or for each its own.
            keep_first: Whether ``runs`` and ``slopes`` will be asked for at the first candidate: its run is then kept,
                which costs a tenth more here and saves a run there.
        """
        tasks = [(d, c, b) for d, c in zip(drives, for_each(candidates, drives), strict=True) for b in self._batches(c)]

        def of(task: tuple[DriveData, Candidates, list[int]]) -> Floats:
            drive, held, columns = task
            if not keep_first or columns[0] > 0:
                return self._likelihoods(drive, held.take(columns), self._notes(drive, 0))
            notes = self._notes(drive, 1)
            values = self._likelihoods(drive, held.take(columns), notes)
            (kept,) = _runs(values[:1], notes)
            self._remembered.keep([_key(drive, held.take([0]))], [(drive, kept)])
            return values

        totals = self.share(of, tasks)
        total = np.zeros(tasks[0][1].count)
        for (_, _, columns), part in zip(tasks, totals, strict=True):
            total[columns] += part
        return total

    def _batches(self, candidates: Candidates) -> list[list[int]]:
        """Return the columns of candidates by up to ``LANES``, which read the inputs ahead alike."""
        alike: dict[tuple[int, ...], list[int]] = {}
        for column, values in enumerate(candidates.values.T):
            alike.setdefault(self._samples_ahead(values), []).append(column)
        return [columns[s : s + LANES] for columns in alike.values() for s in range(0, len(columns), LANES)]

    def _samples_ahead(self, values: Floats) -> tuple[int, ...]:
        """Return by how many whole samples each channel of an input is late with parameters ``(np,)``."""
        late = -values[[*self._late]] / self.spec.step
        return tuple(int(n) for n in np.rint(np.where(np.isfinite(late), np.maximum(late, 0.0), 0.0)))

    def read_ahead(self, drive: DriveData, values: Floats) -> tuple[DriveData, Floats]:
        """Return a recording with what is late of its inputs read ahead, and what is left of the delays.

        An input that was recorded late is a negative delay, which no equation of the past follows: over 40 ms the
        second order of ``steering_delay`` is 7 % and 5 ms off at 2 Hz, which resembles a lag of the steering or of the
        tyres. The recording knows what comes. Of a delay less than half a sample is left; done twice it is the same.

        Args:
            drive: The recording.
            values: Parameters ``(np, n)``, of which each says the same of the whole samples.
        """
        if not values.shape[1] or not any(ahead := self._samples_ahead(values[:, 0])):
            return drive, values
        inputs, between = drive.inputs.copy(), drive.between.copy()
        for samples, columns in zip(ahead, self._late.values(), strict=True):
            later = np.minimum(np.arange(len(inputs)) + samples, len(inputs) - 1)
            inputs[:, columns], between[:, columns] = drive.inputs[later][:, columns], drive.between[later][:, columns]
        return replace(drive, inputs=inputs, between=between), self.without_delays(values)

    def without_delays(self, values: Floats) -> Floats:
        """Return parameters ``(np, n)`` for a recording whose late inputs are read ahead already."""
        shifted = values.copy()
        for samples, row in zip(self._samples_ahead(values[:, 0]), self._late, strict=True):
            shifted[row] += samples * self.spec.step
        return shifted

    def _likelihoods(self, drive: DriveData, candidates: Candidates, notes: tuple[Floats, ...]) -> Floats:
        """Return the log-likelihoods of up to ``LANES`` candidates, which read inputs ahead alike, on one recording."""
        drive, values = self.read_ahead(drive, candidates.values)
        at = replace(candidates, values=values).in_lanes()
        variance = np.repeat(drive.first_variance[:, None], LANES, axis=1)
        held = Held(at.values, at.process, at.measurement, self._first(drive, at.values), variance)
        return of_valid(self._filter(drive, held, notes), drive)[: candidates.count]

    def _notes(self, drive: DriveData, lanes: int) -> tuple[Floats, ...]:
        """Return what ``time_loops.keep_lanes`` writes to; nothing is kept of no lanes."""
        shape, ny = (lanes, len(drive.inputs)), self.compiled.ny
        seen = [np.full((*shape, ny), np.nan) for _ in range(3)]
        return *seen, np.zeros((*shape, ny, ny)), np.zeros((*shape, self.nx, ny)), np.zeros((*shape, self.compiled.nx))

    def run(self, drive: DriveData, point: Candidates) -> FilterRun:
        """Run the filter over a recording for one candidate and keep what it does."""
        (kept,) = self.runs_of(drive, point)
        return kept

    def runs_of(self, drive: DriveData, candidates: Candidates) -> list[FilterRun]:
        """Run the filter over a recording for each candidate, in lanes, and keep what it does. One thread."""
        runs: dict[int, FilterRun] = {}
        for columns in self._batches(candidates):
            notes = self._notes(drive, len(columns))
            values = self._likelihoods(drive, candidates.take(columns), notes)
            runs |= zip(columns, _runs(values, notes), strict=True)
        return [runs[column] for column in range(candidates.count)]

    def runs(self, drives: Sequence[DriveData], points: Each) -> list[FilterRun]:
        """Run the filter over every recording, which must not change meanwhile: the last few runs are remembered."""
        pairs = list(zip(drives, for_each(points, drives), strict=True))
        keys = [_key(*pair) for pair in pairs]
        remembered = self._remembered.get(keys)
        new = iter(self.share(lambda i: self.run(*pairs[i]), [i for i, kept in enumerate(remembered) if kept is None]))
        runs = [next(new) if kept is None else kept[1] for kept in remembered]
        self._remembered.keep(keys, list(zip(drives, runs, strict=True)))
        return runs

    @np.errstate(over="ignore", invalid="ignore")  # of a filter that diverges
    def slopes(self, drives: Sequence[DriveData], points: Each, directions: Each) -> Slopes:
        """Return the log-likelihood of all recordings at a point, with gradient and Fisher information.

        Here gains and the covariance of the innovations are held as they are at the point, so that directions of the
        noise have no effect.

        Args:
            drives: The recordings.
            points: One candidate, or one for each recording.
            directions: Derivatives of what is held, one column per direction.
        """
        at, along = for_each(points, drives), for_each(directions, drives)
        kept = self.runs(drives, at)

        @np.errstate(over="ignore", invalid="ignore")  # in a thread of its own
        def of_drive(i: int) -> tuple[Floats, Floats]:
            columns = self.sensitivities(drives[i], at[i].values, along[i].values, kept[i])
            residual = np.nan_to_num(kept[i].whitened)
            return -np.einsum("kan,ka->n", columns, residual), np.tensordot(columns, columns, ((0, 1), (0, 1)))

        by_drive = self.share(of_drive, range(len(drives)))
        gradient, information = (np.sum([f[part] for f in by_drive], axis=0) for part in (0, 1))
        return Slopes(sum(k.log_likelihood for k in kept), gradient, information)

    def sensitivities(self, drive: DriveData, values: Floats, directions: Floats, kept: FilterRun) -> Floats:
        """Return derivatives of the whitened innovations with gains and whitening held fixed ``(samples, ny, n)``.

        Rows of the first sample and of missing measurements are zero. With ``kept.whitened`` they are what a score
        (Lagrange-multiplier) test of parameters needs that were not fitted. One thread.

        Args:
            drive: The recording.
            values: Parameters at which they are taken ``(np, 1)``; or for each direction its own ``(np, n)``, which
                may differ in what has no effect at ``kept``.
            directions: Of the parameters ``(np, n)``.
            kept: From ``run``.
        """
        n = directions.shape[1]
        slopes = np.empty((*drive.measurements.shape, n))
        drive, values = self.read_ahead(drive, values)
        at = np.broadcast_to(values, directions.shape)
        for s in range(0, n, LANES):
            columns = [min(k, n - 1) for k in range(s, s + LANES)]
            both = np.concatenate([at[:, columns], directions[:, columns]], axis=1)
            derivatives = np.zeros((*drive.measurements.shape, LANES))
            self._follow.follow(
                drive.inputs,
                drive.between,
                drive.measurements,
                self.duals.constants(both),
                self._first(drive, both),
                kept.gain,
                kept.whitening,
                derivatives,
            )
            slopes[:, :, s : s + LANES] = derivatives[:, :, : n - s]
        return slopes

    def free_run(self, drive: DriveData, values: Floats, start: Start | None = None) -> FreeRun:
        """Run the model free over the inputs of a recording.

        Args:
            drive: The recording.
            values: Parameters ``(np,)``.
            start: From ``free_run.found_start``; the first sample and ``first_state`` by default.
        """
        begin, first = start or Start(0, self.first_state(drive, values))
        drive, held = self.read_ahead(drive, np.repeat(values[:, None], LANES, axis=1))
        inputs, between, valid_until = drive.inputs[begin:], drive.between[begin:], np.empty((1, LANES))
        states, outputs = (np.empty((len(inputs), n)) for n in (self.compiled.nx, self.compiled.ny))
        constants, lanes = self.compiled.constants(held), np.repeat(first[:, None], LANES, axis=1)
        self._free.run_free((inputs, between), constants, lanes, self._limits, states, outputs, valid_until)
        until, simulated = int(valid_until[0, 0]), np.full(drive.measurements.shape, np.nan)
        simulated[begin : begin + until] = outputs[:until]
        return FreeRun(states[: max(1, until)], simulated)

    def first_state(self, drive: DriveData, values: Floats) -> Floats:
        """Return the state in which a recording begins ``(nx,)``, with parameters ``(np,)``."""
        return self._first(drive, values[:, None])[:, 0]

    def _first(self, drive: DriveData, held: Floats) -> Floats:
        """Return the first mean in lanes or duals: of the recording, but for states that a parameter starts."""
        first = np.zeros((self.compiled.nx, held.shape[1]))
        first[:, :LANES] = drive.first_mean[:, None]
        first[self._started] = held[self._starts]
        return first

    def share(self, work: Callable[[_Task], _Answer], tasks: Iterable[_Task]) -> list[_Answer]:
        """Do independent work in threads; the kernels release the GIL, and answers come in the order of the tasks."""
        tasks = list(tasks)
        if self.jobs == 1 or len(tasks) < 2:
            return [work(task) for task in tasks]
        with ThreadPoolExecutor(self.jobs) as pool:
            return list(pool.map(work, tasks))


def _key(drive: DriveData, point: Candidates) -> tuple[int, bytes, bytes, bytes]:
    """Return what tells a run from others, kept with the drive, so that its id stays its own."""
    return id(drive), point.values.tobytes(), point.process.tobytes(), point.measurement.tobytes()


def of_valid(total: Floats, drive: DriveData) -> Floats:
    """Return log-likelihoods, minus infinity where the filter left the range in which the equations hold."""
    likelihood, valid_until = total[0, :LANES], total[1, :LANES]
    return np.where((valid_until < len(drive.inputs)) | ~np.isfinite(likelihood), -np.inf, likelihood)
