"""Compiled estimators: for a model that they believe in, run over batches and recordings or stepped by hand."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
from numba.core.dispatcher import Dispatcher

from harness.common.arrays import Floats, batches
from harness.common.errors import UserError
from harness.engine.compile import CompiledModel, load_source, paste
from harness.engine.kernel_names import Belief, Info, State
from harness.engine.simd.lanes import LANES
from harness.estimation.contract import kernels_of, load_estimator
from harness.runner.contract import Held, History, InputSeries, Kept, Ports, Record
from harness.runner.filter_loop import BATCH, RECORDING
from harness.runner.history import HISTORY, follow_filter
from harness.runner.records import EverySample, Scoring, Sums
from harness.runner.scores import SCORES, estimate


class CompiledEstimator:
    """An estimator compiled for the model it believes in.

    Args:
        kind: File in ``harness/estimation/methods``.
        compiled: The belief, with unknown inputs as states and the targets as signals.
        settings: The estimator's settings as in a study.
        folder: Folder of the study, to which files that settings name are relative.
        uncertain: Whether it is told what errors of the inputs do.

    Attributes:
        tuning, priors: As in ``Belief``.
        limits: As in ``harness.runner.scores.estimate``.

    Raises:
        UserError: If a setting does not fit, or the estimator not the model.
    """

    in_lanes = True

    def __init__(
        self,
        kind: str,
        compiled: CompiledModel,
        settings: dict[str, Any] | None = None,
        folder: Path = Path(),
        uncertain: bool = False,
    ) -> None:
        file = load_estimator(kind)
        self.kind, self.compiled, self._file, self._uncertain = kind, compiled, file, uncertain
        self.ports, self.signals = Ports.of(compiled.model), compiled.signal_names
        self.has_covariance = bool(file.HAS_COVARIANCE)
        if compiled.model.considered and not file.KALMAN_TYPE:
            raise UserError(f"estimator '{kind}' has no gain of a Kalman filter, so it cannot consider parameters")
        try:
            chosen = file.Settings(**(settings or {}))
            if hasattr(file, "fit"):
                self.tuning = np.array(file.fit(chosen, compiled, folder), dtype=float)
            else:
                self.tuning = np.array(file.tuning(chosen, compiled.nx, compiled.ny), dtype=float)
        except ArithmeticError as error:
            raise UserError(
                f"settings of estimator '{kind}': a number is too large or too small to reckon with"
            ) from error
        except UserError:
            raise
        except ValueError as error:
            raise UserError(f"settings of estimator '{kind}': {error}") from error
        given = file.estimates(chosen, folder) if hasattr(file, "estimates") else compiled.signal_names
        self.gives = np.array([name in given for name in compiled.signal_names], dtype=bool)
        self.is_random = hasattr(file, "first_memory")
        self._first_memory: Callable[[Sequence[np.random.SeedSequence]], Floats]
        if self.is_random:
            self._first_memory = partial(file.first_memory, chosen, compiled.nx, compiled.ny)
        else:
            self._memory_size = int(file.memory_size(chosen, compiled))
        scoring = self._made_of(uncertain) | SCORES
        self._kernels = load_source(f"estimate_{kind}", paste(compiled, kind, [estimate], scoring))
        self._following: dict[bool, Dispatcher] = {}
        first = compiled.model.start_variance
        sizes = [[first[s], 1.0 if s in compiled.model.relative else first[s]] for s in compiled.model.within]
        self.priors = np.reshape(np.array(sizes, dtype=float), (-1, 2))
        self.limits = compiled.model.limits
        self._no_errors = np.empty((1, compiled.nu, 0, LANES))

    def _made_of(self, uncertain: bool) -> dict[Any, Any]:
        return kernels_of(self._file, uncertain, parameters=bool(self.compiled.model.within))

    @property
    def loop(self) -> Dispatcher:
        """The compiled loop over time, the same for all settings."""
        return self._kernels.estimate

    def init(self, mean: Floats, variance: Floats, seeds: Sequence[np.random.SeedSequence] | None = None) -> State:
        """Return the first state.

        Args:
            mean: ``(nx,)`` or ``(nx, LANES)``; of several batches ``(batches, nx, LANES)``, and so is all else.
            variance: Of each state; same shapes, or a covariance ``(nx, nx)``.
            seeds: One per lane, for estimators that draw random numbers; by default the same for all.
        """
        nx, lead = self.compiled.nx, np.shape(mean)[:-2]
        x, P = np.empty((*lead, nx, LANES)), np.zeros((*lead, nx, nx, LANES))
        x[:] = np.reshape(mean, (*lead, nx, -1))
        if np.shape(variance) == (nx, nx):
            P[:] = np.asarray(variance)[:, :, None]
        else:
            P.reshape(*lead, -1, LANES)[..., :: nx + 1, :] = np.reshape(variance, (*lead, nx, -1))
        if not self.is_random:
            return State(x, P, np.zeros((*lead, self._memory_size, LANES)))
        chosen = [np.random.SeedSequence(0)] * (x.size // nx) if seeds is None else seeds
        memory = [self._first_memory(chosen[k : k + LANES]) for k in range(0, len(chosen), LANES)]
        return State(x, P, np.stack(memory) if lead else memory[0])

    def step(self, state: State, u_before: Floats, u: Floats, y: Floats, belief: Belief) -> tuple[State, Info]:
        """Take one sample: state in, new state and info out; nothing is changed in place.

        Args:
            state: From ``init`` or an earlier ``step``.
            u_before: Inputs at the previous sample ``(nu, LANES)``.
            u: Inputs at this sample ``(nu, LANES)``.
            y: Measurements at this sample ``(ny, LANES)``; NaN where missing.
            belief: Constants and noise.
        """
        nx, ny = self.compiled.nx, self.compiled.ny
        after = State(np.empty((nx, LANES)), np.zeros((nx, nx, LANES)), np.empty_like(state.memory))
        info = Info(np.zeros((ny, LANES)), np.zeros((ny, ny, LANES)), *(np.zeros((1, LANES)) for _ in range(4)))
        work = self._kernels.workspace()
        self._kernels.advance(state, u_before, u, y, belief, work, after, info)
        self._kernels.write_covariance(after, work)
        return after, info

    def belief(self, constants: Floats, process_noise: Floats, measurement_noise: Floats) -> Belief:
        """Return what the estimator believes, for ``step``; arrays end in ``LANES``."""
        return Belief(constants, process_noise, measurement_noise, self.tuning, priors=self.priors)

    def begin(self, held: Held) -> tuple[Belief, State]:
        """Return what it believes and its first state as kernels take them."""
        belief = self.belief(self.compiled.constants(held.values), held.process_noise, held.measurement_noise)
        variance = held.process_noise if held.first_variance is None else held.first_variance
        return belief, self.init(held.first, variance, held.seeds)

    def run(self, inputs: InputSeries, measurements: Floats, held: Held, record: Record[Kept]) -> Kept:
        """Run over batches or a recording, see ``harness.runner.contract.Filter``.

        Raises:
            TypeError: If no kernel records what is asked for.
        """
        belief, first = self.begin(held)
        if isinstance(record, Scoring):
            return cast(Kept, self._scored(inputs, measurements, belief, first, record))
        if isinstance(record, EverySample):
            return cast(Kept, self._followed(inputs, measurements, belief, first, record))
        raise TypeError(f"no kernel records {type(record).__name__}")

    def _scored(self, inputs: InputSeries, measurements: Floats, belief: Belief, first: State, record: Scoring) -> Sums:
        source, belief = self._source(inputs, belief)
        rows, without, options, bounds = record.compared(self)
        samples, targets, lead = record.truth.shape[-3], len(self.signals), record.truth.shape[:-3]
        sums, per_run = np.empty((*lead, 3, targets, LANES)), np.empty((*lead, 10, LANES))
        kept = np.empty((*lead, samples if record.keep else 0, 2, targets, LANES))
        self._kernels.estimate(
            tuple(batches(each, dimensions) for each, dimensions in zip(source, (3, 3, 4, 4), strict=True)),
            batches(measurements, 3),
            batches(record.truth, 3),
            rows,
            record.until.reshape(-1, 1, LANES),
            belief._replace(
                constants=batches(belief.constants, 2),
                process_noise=batches(belief.process_noise, 2),
                measurement_noise=batches(belief.measurement_noise, 2),
            ),
            State(batches(first.mean, 2), batches(first.covariance, 3), batches(first.memory, 2)),
            self.limits,
            options,
            bounds,
            batches(sums, 3),
            batches(per_run, 2),
            batches(kept, 4),
        )
        if without is not None:
            sums[..., without, :] = np.nan
        if record.keep:
            kept[..., ~self.gives, :] = np.nan
        return Sums(sums, per_run, self.has_covariance, kept if record.keep else None)

    def _followed(
        self, inputs: InputSeries, measurements: Floats, belief: Belief, first: State, record: EverySample
    ) -> History:
        recorded, history = inputs.effects is not None, record.room(len(measurements), self)
        if inputs.effects is not None:
            source: tuple[Any, ...] = (inputs.at, inputs.between, measurements, inputs.effects)
            belief = belief._replace(input_errors=np.zeros((*inputs.effects.shape[1:], LANES)))
        else:
            series, belief = self._source(inputs, belief)
            source = *series, measurements
        if recorded not in self._following:
            reader = (RECORDING if recorded else BATCH) | HISTORY
            kernels = self._made_of(self._uncertain or recorded) | reader
            pasted = paste(self.compiled, f"follow_{self.kind}", [follow_filter], kernels)
            self._following[recorded] = load_source(f"follow_{self.kind}", pasted).follow_filter
        self._following[recorded](source, belief, first, self.limits, record.rows, tuple(vars(history).values()))
        return history

    def _source(self, inputs: InputSeries, belief: Belief) -> tuple[tuple[Floats, Floats, Floats, Floats], Belief]:
        """Return inputs of batches as a reader takes them, and a belief with room for what their errors do."""
        between = inputs.at if inputs.between is None else inputs.between
        if inputs.errors_between is None or inputs.errors_at is None:
            return (inputs.at, between, self._no_errors, self._no_errors), belief
        room = np.zeros((self.compiled.nx + self.compiled.ny, inputs.errors_at.shape[-2], LANES))
        errors = inputs.errors_between, inputs.errors_at
        return (inputs.at, between, *errors), belief._replace(input_errors=room)
