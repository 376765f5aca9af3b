"""The innovations of a filter over recordings, their likelihood, and exact derivatives of both.

``Innovations`` compiles a filter for a model twice: over plain lanes, where eight candidates run at a time, and over
dual numbers (``harness.engine.simd.dual``), where one candidate runs with its derivatives along eight directions.
Whatever the filter computes is differentiated: means, covariances, gains, the likelihood. Nothing is differenced.
"""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from types import ModuleType
from typing import TypeVar

import numpy as np
import xarray as xr

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.config import ModelSpec
from harness.engine.compile import CompiledModel, compile_model, load_source, paste
from harness.engine.kernel_names import Belief
from harness.engine.simd.lanes import LANES
from harness.estimation.contract import kernels_of, load_estimator
from harness.identification import time_loops
from harness.identification.data import Drive, drive_from, step_of

_STEP_TOLERANCE = 1e-3
_Task = TypeVar("_Task")
_Answer = TypeVar("_Answer")


@dataclass(frozen=True)
class Held:
    """What candidates hold, or directions in that space; one column each.

    Attributes:
        values: Parameters in the model's order ``(np, n)``.
        process: Variances per step ``(nx, n)``.
        measurement: Variances per sample ``(ny, n)``.
    """

    values: Floats
    process: Floats
    measurement: Floats

    @property
    def count(self) -> int:
        """Number of candidates."""
        return self.values.shape[1]

    def take(self, columns: slice | Sequence[int]) -> Held:
        """Return some of the candidates."""
        return Held(self.values[:, columns], self.process[:, columns], self.measurement[:, columns])


def hold(spec: ModelSpec) -> Held:
    """Return what a resolved model holds, as one candidate."""
    model = spec.model()
    return Held(
        np.array([[spec.values[n]] for n in model.parameter_names]).reshape(-1, 1),
        np.array([[spec.process_noise[n]] for n in model.states]),
        np.array([[spec.measurement_noise[n]] for n in model.outputs]),
    )


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
class Pass:
    """What one run of the filter over a recording leaves.

    Attributes:
        log_likelihood: Of the recording.
        innovation: Measurement minus its prediction ``(samples, ny)``, NaN where missing and at the first sample.
        deviation: Standard deviation that the filter states of it ``(samples, ny)``, NaN at the first sample.
        whitened: Innovations over the Cholesky factor of their covariance ``(samples, ny)``, white and of variance 1
            if the model is right; NaN where missing and at the first sample.
        whitening: Inverse of that factor ``(samples, ny, ny)``.
        gain: Gains ``(samples, nx, ny)``.
    """

    log_likelihood: float
    innovation: Floats
    deviation: Floats
    whitened: Floats
    whitening: Floats
    gain: Floats


@dataclass(frozen=True)
class FreeRun:
    """The model alone over a recording, one column per candidate.

    Attributes:
        states: ``(samples, nx, n)``.
        outputs: ``(samples, ny, n)``.
        left_at: First sample outside the range in which the equations hold ``(n,)``; ``samples`` if there is none.
    """

    states: Floats
    outputs: Floats
    left_at: Floats


class Innovations:
    """A filter compiled for identification.

    Args:
        spec: The model; its values and variances are where a search begins.
        kind: File in ``harness/estimation/methods``; of Kalman type and without memory of its own.
        jobs: Threads; all cores by default.
    """

    def __init__(self, spec: ModelSpec, kind: str = "ekf", jobs: int | None = None) -> None:
        self.spec, self.model = spec, spec.model()
        self.jobs = jobs or os.cpu_count() or 1
        file = load_estimator(kind)
        self.compiled, self.duals = (
            compile_model(self.model, spec.step, spec.integrator, spec.substeps, duals=duals) for duals in (False, True)
        )
        self.tuning = np.array(file.tuning(file.Settings(), self.compiled.nx, self.compiled.ny), dtype=float)

        def loop(compiled: CompiledModel, note: Callable[..., None], *more: Callable[..., None]) -> ModuleType:
            given = {**kernels_of(file), time_loops.note: note}
            source = paste(compiled, f"innovations_{kind}", [time_loops.innovate, *more], given)
            return load_source(f"innovations_{kind}", source)

        self._plain = loop(self.compiled, time_loops.note_gain, time_loops.run_free)
        self._slopes = loop(self.duals, time_loops.note_slopes, time_loops.follow)
        self._limits = np.array([self.model.valid.get(name, np.inf) for name in self.model.states])
        starts = {s: source for s, source in self.model.start.items() if source in self.model.parameter_names}
        self._started = [self.model.states.index(s) for s in starts]
        self._starts = [self.model.parameter_names.index(str(source)) for source in starts.values()]

    def drive(self, recording: xr.Dataset, name: str) -> Drive:
        """Return a recording in terms of this model, with the spread of the first state.

        How far the first state may lie from its mean is taken from a free run of the model at hand over the inputs of
        the recording: the mean square of each state, and its process noise. A state that a parameter starts has no
        spread but its noise.

        Raises:
            UserError: If a signal is missing.
        """
        drive, held = drive_from(recording, self.model, name), hold(self.spec)
        if abs(step_of(recording) - self.spec.step) > _STEP_TOLERANCE * self.spec.step:
            raise UserError(
                f"{name}: its samples are {step_of(recording):g} s apart, those of the model {self.spec.step:g} s; "
                "all recordings of a fit need the same step"
            )
        free = self.free_run(drive, held)
        kept = free.states[: max(1, int(free.left_at[0])), :, 0]
        variance = np.mean((kept - kept[0]) ** 2, axis=0)
        variance[self._started] = 0.0
        return replace(drive, first_variance=variance + held.process[:, 0])

    def free_run(self, drive: Drive, candidates: Held) -> FreeRun:
        """Run the model alone over the inputs of a recording, for up to ``LANES`` candidates."""
        samples = len(drive.inputs)
        filled = _contiguous(candidates.take([min(k, candidates.count - 1) for k in range(LANES)]))
        states, outputs = np.empty((samples, self.compiled.nx, LANES)), np.empty((samples, self.compiled.ny, LANES))
        left = np.empty((1, LANES))
        constants, first = self.compiled.constants(filled.values), self._first(drive, filled)
        self._plain.run_free(drive.inputs, drive.between, constants, first, self._limits, states, outputs, left)
        n = candidates.count
        return FreeRun(states[:, :, :n], outputs[:, :, :n], left[0, :n])

    def along(self, names: Sequence[str]) -> Held:
        """Return the directions of single parameters, one column each.

        Raises:
            UserError: If the model has no such parameter.
        """
        known = self.model.parameter_names
        for name in names:
            if name not in known:
                raise UserError(f"the model has no parameter '{name}'{closest(name, known)}")
        values = np.zeros((len(known), len(names)))
        values[[known.index(n) for n in names], range(len(names))] = 1.0
        nx, ny = self.compiled.nx, self.compiled.ny
        return Held(values, np.zeros((nx, len(names))), np.zeros((ny, len(names))))

    def log_likelihoods(self, drives: Sequence[Drive], candidates: Held) -> Floats:
        """Return the log-likelihood of all recordings for each candidate ``(n,)``; minus infinity if it diverges."""
        starts = range(0, candidates.count, LANES)
        tasks = [(drive, candidates.take(slice(s, s + LANES))) for s in starts for drive in drives]
        found = self._share(lambda task: self._likelihood(*task), tasks)
        sums = [sum(found[i : i + len(drives)]) for i in range(0, len(found), len(drives))]
        return np.concatenate(sums)

    def _likelihood(self, drive: Drive, candidates: Held) -> Floats:
        filled = candidates.take([min(k, candidates.count - 1) for k in range(LANES)])
        total = np.empty((2, LANES))
        ny = self.compiled.ny
        nothing = np.empty((0, ny))
        notes = (nothing, nothing, nothing, np.empty((0, ny, ny)), np.empty((0, self.compiled.nx, ny)))
        self._innovate(self._plain, self.compiled, drive, _contiguous(filled), total, notes)
        return _judged(total, drive)[: candidates.count]

    def slopes(self, drives: Sequence[Drive], point: Held, directions: Held) -> Slopes:
        """Return the log-likelihood of all recordings at a point, with gradient and Fisher information.

        Args:
            drives: The recordings.
            point: One candidate.
            directions: Derivatives of what is held, one column per direction.
        """
        starts = range(0, directions.count, LANES)
        tasks = [(drive, directions.take(slice(s, s + LANES))) for drive in drives for s in starts]
        found = self._share(lambda task: self._slope(task[0], point, task[1]), tasks)
        n = directions.count
        total, gradient, information = 0.0, np.zeros(n), np.zeros((n, n))
        for i in range(0, len(found), len(starts)):
            of_drive = found[i : i + len(starts)]
            total += of_drive[0][0]
            gradient += np.concatenate([g for _, g, _ in of_drive])[:n]
            rows = np.concatenate([r.reshape(-1, LANES) for _, _, r in of_drive], axis=1)[:, :n]
            information += rows.T @ rows
        return Slopes(total, gradient, information)

    def _slope(self, drive: Drive, point: Held, directions: Held) -> tuple[float, Floats, Floats]:
        samples, ny = drive.measurements.shape
        total = np.empty((2, 2 * LANES))
        rows = np.zeros((samples, ny + ny * (ny + 1) // 2, LANES))
        self._innovate(self._slopes, self.duals, drive, _dual(point, directions), total, rows)
        return float(_judged(total, drive)[0]), total[0, LANES:].copy(), rows

    def run(self, drive: Drive, point: Held) -> Pass:
        """Run the filter over a recording and keep innovations, whitening and gains."""
        (samples, ny), nx = drive.measurements.shape, self.compiled.nx
        total = np.empty((2, LANES))
        seen = [np.full((samples, ny), np.nan) for _ in range(3)]
        notes = (*seen, np.zeros((samples, ny, ny)), np.zeros((samples, nx, ny)))
        filled = point.take([0] * LANES)
        self._innovate(self._plain, self.compiled, drive, _contiguous(filled), total, notes)
        return Pass(float(_judged(total, drive)[0]), *notes)

    def sensitivities(self, drive: Drive, point: Held, directions: Held, kept: Pass) -> Floats:
        """Return derivatives of the whitened innovations with gains and whitening held fixed ``(samples, ny, n)``.

        Rows of the first sample and of missing measurements are zero. With ``kept.whitened`` they are what a score
        (Lagrange-multiplier) test of parameters needs that were not fitted.

        Args:
            drive: The recording.
            point: One candidate, the one ``kept`` belongs to.
            directions: One column per direction; those of the noise have no effect here.
            kept: From ``run``.
        """

        def follow(start: int) -> Floats:
            """Return the derivatives along the directions of one batch of lanes."""
            held = _dual(point, directions.take(slice(start, start + LANES)))
            slopes = np.zeros((*drive.measurements.shape, LANES))
            first = self._first(drive, held)
            constants = self.duals.constants(held.values)
            self._slopes.follow(
                drive.inputs, drive.between, drive.measurements, constants, first, kept.gain, kept.whitening, slopes
            )
            return slopes

        parts = self._share(follow, range(0, directions.count, LANES))
        return np.concatenate(parts, axis=2)[:, :, : directions.count]

    def _innovate(
        self, module: ModuleType, compiled: CompiledModel, drive: Drive, held: Held, total: Floats, notes: object
    ) -> None:
        variance = np.zeros((compiled.nx, compiled.lanes))
        variance[:, :LANES] = drive.first_variance[:, None]
        belief = Belief(compiled.constants(held.values), held.process, held.measurement, self.tuning)
        memory = np.zeros((0, compiled.lanes))
        module.innovate(
            drive.inputs,
            drive.between,
            drive.measurements,
            belief,
            self._first(drive, held),
            variance,
            memory,
            self._limits,
            total,
            notes,
        )

    def _first(self, drive: Drive, held: Held) -> Floats:
        """Return the first mean in lanes or duals: of the recording, but for states that a parameter starts."""
        first = np.zeros((self.compiled.nx, held.values.shape[1]))
        first[:, :LANES] = drive.first_mean[:, None]
        first[self._started] = held.values[self._starts]
        return first

    def _share(self, work: Callable[[_Task], _Answer], tasks: Iterable[_Task]) -> list[_Answer]:
        """Do independent work in threads; the kernels release the GIL, and answers come in the order of the tasks."""
        if self.jobs == 1:
            return [work(task) for task in tasks]
        with ThreadPoolExecutor(self.jobs) as pool:
            return list(pool.map(work, tasks))


def _contiguous(held: Held) -> Held:
    return Held(*(np.ascontiguousarray(a, dtype=float) for a in (held.values, held.process, held.measurement)))


def _dual(point: Held, directions: Held) -> Held:
    """Return a point with directions as duals: the value in every lane, then up to ``LANES`` tangents."""

    def join(value: Floats, tangent: Floats) -> Floats:
        both = np.zeros((len(value), 2 * LANES))
        both[:, :LANES] = value
        both[:, LANES : LANES + tangent.shape[1]] = tangent
        return both

    return Held(
        join(point.values, directions.values),
        join(point.process, directions.process),
        join(point.measurement, directions.measurement),
    )


def _judged(total: Floats, drive: Drive) -> Floats:
    """Return log-likelihoods, minus infinity where the filter left the range in which the equations hold."""
    likelihood, left = total[0, :LANES], total[1, :LANES]
    return np.where((left < len(drive.inputs)) | ~np.isfinite(likelihood), -np.inf, likelihood)
