"""Estimators at work: compile one for a belief, run it over batches with scores, or step it by hand.

The contract of a file in ``harness/estimation/methods``:

``workspace()``                 kernel: scratch arrays of a run
``step(before, u_before, u, y, belief, work, after, info)``
                                kernel: one sample; reads ``before``, writes ``after`` and ``info``

and, where the default in ``DEFAULTS`` does not serve,

``Settings``                    pydantic model of its settings in a study; by default it has none
``HAS_COVARIANCE``              whether it states an error covariance
``tuning(settings, nx, ny)``    the numbers its kernel reads
``memory_size(settings, compiled)``
                                rows of memory it carries beside mean and covariance, all zero at first
``write_covariance(state, work)``
                                kernel: writes the covariance of a state that ``step`` left, for an estimator that goes
                                on without it; called only where somebody reads it

and of an estimator that is made for particular signals, such as a trained network,

``fit(settings, compiled, folder)``
                                in place of ``tuning``: the numbers its kernel reads, for this compiled model; files
                                its settings name are relative to the folder. ``UserError`` if the model does not fit
``estimates(settings, folder)`` the signals it estimates; it has no score for any other target
``files(settings, folder)``     the files it reads: a store is not resumed with others

and of one whose memory begins with other than zeros, such as random numbers,

``first_memory(settings, nx, ny, seeds)``
                                in place of ``memory_size``: the memory before the first step, ``(rows, LANES)``;
                                ``seeds`` holds a ``numpy.random.SeedSequence`` per lane

Three flags tell the contract suite what to expect: ``KALMAN_TYPE`` (equals the textbook filter on a linear model),
``LINEAR`` (assumes a linear model, so it need not follow any other) and ``MONTE_CARLO`` (results scatter with the
seed).
``DEVICES`` names the devices (``harness.study.devices``) on which its scores were compared with the processor's and
differ by rounding (docs/gpu.md). ``REMEDY`` says what a filter does that needs no idea of what is wrong and may stand
in place of one of the Kalman type (``harness remedy``).

A kernel may call any function that its file defines or imports by name, such as those that several estimators share;
they are compiled with it from their source, behind the kernels of the model the estimator believes in
(``harness.engine.kernel_names`` lists the names that these offer, ``harness.engine.kernel_source`` says what else may
be used).
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
import scipy
from numba.core.dispatcher import Dispatcher
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict

from harness.common.arrays import Floats, batches
from harness.common.cache import ARRAY, kept
from harness.common.errors import UserError
from harness.config.roles import ESTIMATORS
from harness.engine import parameter_loops
from harness.engine.compile import CompiledModel, load_source, paste
from harness.engine.kernel_names import INPUT_ERRORS, Belief, Info, State
from harness.engine.simd.lanes import LANES
from harness.runner import filter_loop
from harness.runner.scores import SCORES, estimate

NEES_EVERY = 10
"""Samples between two evaluations of the NEES; neighbouring samples hardly add to it."""

COVERAGE = 0.95


@dataclass(frozen=True)
class Scores:
    """Scores of runs of one estimator, ``LANES`` of a batch or those of a whole unit.

    Attributes:
        rmse, bias, max_error: ``(targets, LANES)`` in SI units of the target, up to a divergence; NaN where the
            estimator does not give the target or there is no truth of it.
        nees, nis: Averages per step ``(LANES,)``; NaN if the estimator states no covariance.
        nees_inside, nis_inside: Share of samples inside the two-sided 95 % chi-square region.
        log_likelihood: Sum over the run; NaN if the estimator states no covariance.
        repairs: Samples at which a covariance factor had to be repaired.
        updates: Samples with a measurement.
        diverged_at: First sample with a state outside its range of validity, or without a score because a target, the
            NIS or the likelihood is no number; ``samples`` if none.
        kept: Estimates and standard deviations of the targets ``(samples, 2, targets, LANES)``, if asked for.
    """

    rmse: Floats
    bias: Floats
    max_error: Floats
    nees: Floats
    nis: Floats
    nees_inside: Floats
    nis_inside: Floats
    log_likelihood: Floats
    repairs: Floats
    updates: Floats
    diverged_at: Floats
    kept: Floats | None


@dataclass(frozen=True)
class Sums:
    """What a loop over time sums up of runs, from which their scores are made.

    Attributes:
        errors: Of each target ``(3, targets, runs)``; see ``harness.runner.scores.estimate``, also for the next.
        per_run: ``(10, runs)``. Of several batches both have their axis in front.
        kept: As in ``Scores``.
    """

    errors: Floats
    per_run: Floats
    kept: Floats | None = None


class NoSettings(BaseModel):
    """No settings beside the noise it believes in."""

    model_config = ConfigDict(extra="forbid")


DEFAULTS: dict[str, Any] = {
    "Settings": NoSettings,
    "HAS_COVARIANCE": True,
    "KALMAN_TYPE": False,
    "LINEAR": False,
    "MONTE_CARLO": False,
    "DEVICES": (),
    "REMEDY": "",
    "tuning": lambda settings, nx, ny: [0.0],
    "memory_size": lambda settings, compiled: 0,
    "files": lambda settings, folder: (),
    "write_covariance": filter_loop.write_covariance,
}
"""What a file need not export."""


def load_estimator(kind: str) -> SimpleNamespace:
    """Return the exports of an estimator's file, those it does not state by their defaults.

    Raises:
        ModelError: If there is none of that name or it lacks an export.
    """
    return SimpleNamespace(**{**DEFAULTS, **vars(ESTIMATORS.load(kind))})


class UncertainInputs(NamedTuple):
    """What an estimator is told of inputs that are not exact.

    Attributes:
        between: Inputs during the step behind each sample ``(samples, nu, LANES)``.
        before: What ``m`` independent errors of unit variance do to them ``(samples, nu, m, LANES)``.
        at: What the same errors do to the inputs at the next sample ``(samples, nu, m, LANES)``.
    """

    between: Floats
    before: Floats
    at: Floats


class Estimator:
    """An estimator compiled for the model it believes in.

    Args:
        kind: File in ``harness/estimation/methods``.
        compiled: The belief, with unknown inputs as states and the targets as signals.
        settings: The estimator's settings as in a study.
        folder: Folder of the study, to which files that settings name are relative.
        uncertain: Whether ``run`` tells it of errors of the inputs.

    Attributes:
        is_random: Whether it begins with random numbers, so that ``init`` needs seeds.
        tuning, priors: As in ``Belief``.
        limits, bounds: As in ``harness.runner.scores.estimate``.

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
        self.kind, self.compiled = kind, compiled
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
        kernels = kernels_of(file, uncertain, parameters=bool(compiled.model.within))
        self._kernels = load_source(f"estimate_{kind}", paste(compiled, kind, [estimate], kernels | SCORES))
        first = compiled.model.start_variance
        sizes = [[first[s], 1.0 if s in compiled.model.relative else first[s]] for s in compiled.model.within]
        self.priors = np.reshape(np.array(sizes, dtype=float), (-1, 2))
        self.limits = compiled.model.limits
        self.bounds = chi_square_bounds(1 + max(compiled.nx, compiled.ny))
        self._no_errors = np.empty((1, compiled.nu, 0, LANES))
        self._told: dict[tuple[tuple[str, ...], int], tuple[NDArray[np.int64], NDArray[np.bool_] | None, Floats]] = {}

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
        """Return what the estimator believes, for ``step`` and ``run``; arrays end in ``LANES``."""
        return Belief(constants, process_noise, measurement_noise, self.tuning, priors=self.priors)

    def run(self, *batch: Any, **further: Any) -> Scores:
        """Run over a batch and return its scores; the arguments are those of ``sums``."""
        return self.scores(self.sums(*batch, **further))

    def sums(
        self,
        inputs: Floats,
        measurements: Floats,
        truth: Floats,
        truth_names: tuple[str, ...],
        until: Floats,
        belief: Belief,
        first: State,
        keep: bool = False,
        uncertain: UncertainInputs | None = None,
        since: int = 0,
    ) -> Sums:
        """Run over a batch and sum up what scores are made of while it runs; ``scores`` makes them.

        Of several batches, all that ends in ``LANES`` has their axis in front, but for inputs that all have in common.

        Args:
            inputs: What the estimator knows ``(samples, nu, LANES)``.
            measurements: ``(samples, ny, LANES)``; NaN where missing.
            truth: The plant's signals ``(samples, len(truth_names), LANES)``.
            truth_names: Their names. A target that is not among them has no score; the NEES needs every state.
            until: Scores stop before this sample ``(LANES,)``; the truth of every target is a number up to there.
            belief: From ``belief``.
            first: From ``init``.
            keep: Whether to keep the estimates of the targets over time.
            uncertain: What is not known of the inputs; ``None`` where they are exact.
            since: Scores begin at this sample.
        """
        told = (inputs, *(uncertain or UncertainInputs(inputs, self._no_errors, self._no_errors)))
        if uncertain is not None and uncertain.at.shape[-2]:
            size = self.compiled.nx + self.compiled.ny
            belief = belief._replace(input_errors=np.zeros((size, uncertain.at.shape[-2], LANES)))
        rows, unknown, options = self.compared(truth_names, since)
        samples, targets, lead = truth.shape[-3], len(self.compiled.signal_names), truth.shape[:-3]
        sums, per_run = np.empty((*lead, 3, targets, LANES)), np.empty((*lead, 10, LANES))
        kept = np.empty((*lead, samples if keep else 0, 2, targets, LANES))
        self._kernels.estimate(
            tuple(batches(each, dimensions) for each, dimensions in zip(told, (3, 3, 4, 4), strict=True)),
            batches(measurements, 3),
            batches(truth, 3),
            rows,
            until.reshape(-1, 1, LANES),
            belief._replace(
                constants=batches(belief.constants, 2),
                process_noise=batches(belief.process_noise, 2),
                measurement_noise=batches(belief.measurement_noise, 2),
            ),
            State(batches(first.mean, 2), batches(first.covariance, 3), batches(first.memory, 2)),
            self.limits,
            options,
            self.bounds,
            batches(sums, 3),
            batches(per_run, 2),
            batches(kept, 4),
        )
        if unknown is not None:
            sums[..., unknown, :] = np.nan
        if keep:
            kept[..., ~self.gives, :] = np.nan
        return Sums(sums, per_run, kept if keep else None)

    def compared(
        self, truth_names: tuple[str, ...], since: int
    ) -> tuple[NDArray[np.int64], NDArray[np.bool_] | None, Floats]:
        """Return what ``harness.runner.scores.estimate`` is told of scores: ``rows`` and ``options``.

        Returns:
            ``rows``, the targets that have no score (``None`` where all have one), ``options``.
        """
        if (truth_names, since) not in self._told:
            states = self.compiled.model.states
            rows = np.array(
                [truth_names.index(n) if n in truth_names else -1 for n in (*states, *self.compiled.signal_names)]
            )
            comparable = self.has_covariance and bool(np.all(rows[: len(states)] >= 0))
            rows[len(states) :][~self.gives] = -1
            unknown = rows[len(states) :] < 0
            options = np.array([NEES_EVERY, comparable, self.has_covariance, since], dtype=float)
            self._told[truth_names, since] = rows, unknown if unknown.any() else None, options
        return self._told[truth_names, since]

    def scores(self, found: Sums) -> Scores:
        """Return the scores of any number of runs."""
        sums, per_run, stated = found.errors, found.per_run, self.has_covariance
        with np.errstate(invalid="ignore", divide="ignore"):
            scored, nees_samples, updates = per_run[0], per_run[2], per_run[5]
            nothing = np.full(per_run.shape[1], np.nan)
            return Scores(
                rmse=np.sqrt(sums[0] / scored),
                bias=sums[1] / scored,
                max_error=np.where(scored > 0, sums[2], np.nan),
                nees=per_run[1] / nees_samples if stated else nothing,
                nees_inside=per_run[3] / nees_samples if stated else nothing,
                nis=per_run[4] / updates if stated else nothing,
                nis_inside=per_run[6] / updates if stated else nothing,
                log_likelihood=per_run[7] if stated else nothing,
                repairs=per_run[8],
                updates=updates,
                diverged_at=per_run[9],
                kept=found.kept,
            )


def kernels_of(file: SimpleNamespace, input_errors: bool = False, parameters: bool = False) -> dict[Any, Any]:
    """Return the kernels of an estimator's file by what stands for them in the loops over time.

    Args:
        file: From ``load_estimator``.
        input_errors: Whether it is told what the errors of its inputs do (``Belief.input_errors``).
        parameters: Whether parameters are among its states, which are settled after each step.
    """
    kernels = {
        INPUT_ERRORS: int(input_errors),
        filter_loop.workspace: file.workspace,
        filter_loop.step: file.step,
        filter_loop.write_covariance: file.write_covariance,
    }
    if parameters:
        by_gain = parameter_loops.settle_parameters if file.KALMAN_TYPE else parameter_loops.bound_parameters
        kernels[filter_loop.settle] = by_gain
    return kernels


def chi_square_bounds(count: int, coverage: float = COVERAGE) -> Floats:
    """Return two-sided chi-square bounds by degrees of freedom, ``(count, 2)``; row 0 is empty."""

    def made() -> Floats:  # kept: to import scipy.special takes longer than all else that an estimator is built from
        bounds = np.zeros((count, 2))
        tail = (1 - coverage) / 2
        for degrees in range(1, count):  # as scipy.stats, whose import takes longer still
            bounds[degrees] = 2.0 * scipy.special.gammaincinv(degrees / 2.0, [tail, 1 - tail])
        return bounds

    bounds: Floats = kept("chi-square-bounds", f"{count} {coverage!r} scipy {scipy.__version__}", made, ARRAY)
    return bounds
