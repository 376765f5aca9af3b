"""Compiled estimators: for a model that they believe in, run over batches and recordings or stepped by hand."""

from __future__ import annotations

import functools
from collections.abc import Callable, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
from numba.core.dispatcher import Dispatcher

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.engine.compile import CompiledModel, load_source, paste
from harness.engine.kernel_names import Belief, Info, State
from harness.engine.simd.lanes import LANES
from harness.estimation.contract import kernels_of, load_estimator
from harness.models.assembly.degradation import refuse_degradations
from harness.runner.contract import Held, InputSeries, Kept, Ports, Record, Recorder
from harness.runner.filter_loop import BATCH, RECORDING
from harness.runner.scores import Scoring


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
        limits: Largest magnitude of each state ``(nx,)``.

    Raises:
        UserError: If a setting does not fit, or the estimator not the model.
    """

    def __init__(
        self,
        kind: str,
        compiled: CompiledModel,
        settings: dict[str, Any] | None = None,
        folder: Path = Path(),
        uncertain: bool = False,
    ) -> None:
        file = load_estimator(kind)
        if hasattr(file, "filter_of"):
            raise UserError(f"estimator '{kind}' is no kernel; it runs in studies, on recordings and nowhere else")
        self.kind, self.compiled, self._file, self._uncertain = kind, compiled, file, uncertain
        self.ports, self.signals = Ports.of(compiled.model), compiled.signal_names
        self.has_covariance = bool(file.HAS_COVARIANCE)
        if compiled.model.considered and not file.KALMAN_TYPE:
            raise UserError(f"estimator '{kind}' has no gain of a Kalman filter, so it cannot consider parameters")
        refuse_degradations(compiled.model)
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
            self._first_memory = functools.partial(file.first_memory, chosen, compiled.nx, compiled.ny)
        else:
            self._memory_size = int(file.memory_size(chosen, compiled))
        self._modules: dict[tuple[Any, ...], ModuleType] = {}
        first = compiled.model.start_variance
        sizes = [[first[s], 1.0 if s in compiled.model.relative else first[s]] for s in compiled.model.within]
        self.priors = np.reshape(np.array(sizes, dtype=float), (-1, 2))
        self.limits = compiled.model.limits
        self._no_errors = np.empty((1, compiled.nu, 0, LANES))

    def module(self, recorder: Recorder, recorded: bool) -> ModuleType:
        """Return the estimator's kernels with a recorder's, and the reader of a batch or of a recording."""
        name, key = recorder.loop.__name__, (recorder.loop, *recorder.kernels.values(), recorded)
        if key not in self._modules:
            kernels = kernels_of(self._file, self.compiled.model, self._uncertain or recorded)
            kernels |= (RECORDING if recorded else BATCH) | dict(recorder.kernels)
            source = paste(self.compiled, f"{name} of {self.kind}", [recorder.loop], kernels)
            self._modules[key] = load_source(f"{name}_{self.kind}", source)
        return self._modules[key]

    @functools.cached_property
    def _kernels(self) -> ModuleType:
        return self.module(Scoring.recorder, recorded=False)

    @property
    def loop(self) -> Dispatcher:
        """The compiled loop over time that scores, the same for all settings."""
        return getattr(self._kernels, Scoring.recorder.loop.__name__)

    def init(self, mean: Floats, variance: Floats, seeds: Sequence[np.random.SeedSequence] | None = None) -> State:
        """Return the first state.

        Args:
            mean: ``(nx,)`` or ``(nx, lanes)`` as the model is compiled; of several batches ``(batches, nx, LANES)``,
                and so is all else.
            variance: Of each state; same shapes, or a covariance ``(nx, nx)``.
            seeds: One per lane, for estimators that draw random numbers; by default the same for all.
        """
        nx, lead = self.compiled.nx, np.shape(mean)[:-2]
        x, P = (np.zeros((*lead, *sizes, self.compiled.lanes)) for sizes in ((nx,), (nx, nx)))
        x[:] = np.reshape(mean, (*lead, nx, -1))
        if np.shape(variance) == (nx, nx):
            P[:] = np.asarray(variance)[:, :, None]
        else:
            P.reshape(*lead, -1, P.shape[-1])[..., :: nx + 1, :] = np.reshape(variance, (*lead, nx, -1))
        if not self.is_random:
            return State(x, P, np.zeros((*lead, self._memory_size, self.compiled.lanes)))
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
        """Run over batches or a recording, see ``harness.runner.contract.Filter``; the record says what kernels do."""
        belief, first = self.begin(held)
        source, belief = self._source(inputs, measurements, belief)
        module = self.module(record.recorder, recorded=inputs.effects is not None)
        loop = getattr(module, record.recorder.loop.__name__)
        return record.run(loop, source, belief, first, self.limits, self)

    def _source(self, inputs: InputSeries, measurements: Floats, belief: Belief) -> tuple[tuple[Any, ...], Belief]:
        """Return what a reader reads from, and a belief with room for what errors of the inputs do."""
        between = inputs.at if inputs.between is None else inputs.between
        if inputs.effects is not None:
            room = np.zeros((*inputs.effects.shape[1:], self.compiled.lanes))
            return (inputs.at, between, measurements, inputs.effects), belief._replace(input_errors=room)
        if inputs.errors_between is None or inputs.errors_at is None:
            return (inputs.at, between, self._no_errors, self._no_errors, measurements), belief
        room = np.zeros((self.compiled.nx + self.compiled.ny, inputs.errors_at.shape[-2], LANES))
        source = inputs.at, between, inputs.errors_between, inputs.errors_at, measurements
        return source, belief._replace(input_errors=room)
