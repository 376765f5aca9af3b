"""Train a network: several first weights, each open loop and then free-running; the best on the test drives is kept.

Open loop the network sees the true past outputs. Repeating the last one is then nearly right, so that an error of some
1e-4 says nothing about a network that runs on its own outputs for minutes. Therefore each candidate is tuned further by
backpropagation through time over windows of growing length and at last whole drives, and candidates are compared by
their free-running error.
"""

from __future__ import annotations

import time
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import joblib
import numpy as np
from scipy.optimize import minimize

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.estimation.narx_network import Network, nguyen_widrow, scaled, unpack
from reproductions.narx import data as training_data
from reproductions.narx.closed_loop import ClosedLoop
from reproductions.narx.data import PARTS, Data, Series
from reproductions.narx.levenberg_marquardt import Pairs, train

WINDOWS = (50, 200, 1000)
"""Samples of the windows before whole drives: short ones first, because a network fresh from the open loop leaves every
longer one."""

_CHECK_EVERY = 10


@dataclass(frozen=True)
class Plan:
    """What to train and how long.

    Attributes:
        neurons: Neurons of each hidden layer.
        input_delays, output_delays: Past samples of inputs and outputs.
        epochs: Largest number of steps of Levenberg-Marquardt.
        tolerance: It stops when ten steps lower the sum of squares by a smaller share.
        iterations: Steps of the free-running tuning on whole drives; a sixth of it on each length of window.
        every: Open loop, only every n-th sample is predicted; the free-running tuning takes all.
    """

    neurons: tuple[int, ...] = (32,)
    input_delays: int = 2
    output_delays: int = 2
    epochs: int = 500
    tolerance: float = 1e-2
    iterations: int = 600
    every: int = 1


@dataclass(frozen=True)
class Errors:
    """Normalised RMSE: RMSE over the range of the output in the training drives, by part, each ``(outputs,)``."""

    one_step: dict[str, Floats]
    free: dict[str, Floats]


@dataclass(frozen=True)
class Candidate:
    """A trained network.

    Attributes:
        parameters: After the free-running tuning, ``(P,)``.
        open_loop: Errors before it.
        tuned: Errors after it.
        epochs: Steps of Levenberg-Marquardt.
        gamma: Effective number of parameters after them.
        stopped: Why they ended.
        seconds: Time of both trainings.
    """

    parameters: Floats
    open_loop: Errors
    tuned: Errors
    epochs: int
    gamma: float
    stopped: str
    seconds: tuple[float, float]

    @property
    def score(self) -> float:
        """Free-running error on the test drives, summed over the outputs; infinite for an unstable network."""
        total = float(np.sum(self.tuned.free["test"]))
        return total if np.isfinite(total) else np.inf


class Trainer:
    """Everything that the candidates of one architecture share.

    Args:
        data: Drives.
        plan: Architecture and budget.
        inputs, outputs: Signals of the data.
        threads: Windows that run at once.

    Raises:
        UserError: If a signal never varies, or a drive is too short for the delays or the windows.
    """

    def __init__(
        self,
        data: Data,
        plan: Plan,
        inputs: Sequence[str] = training_data.INPUTS,
        outputs: Sequence[str] = training_data.OUTPUTS,
        threads: int = 1,
    ) -> None:
        self.plan, self.threads = plan, threads
        of_inputs, of_outputs = data.ranges()
        for name, (low, high) in zip([*inputs, *outputs], [*of_inputs, *of_outputs], strict=True):
            if not low < high:
                raise UserError(f"'{name}' is {low:g} throughout the training drives; add drives in which it varies")
        width = plan.input_delays * len(inputs) + plan.output_delays * len(outputs)
        self.sizes = (width, *plan.neurons, len(outputs))
        blank = unpack(nguyen_widrow(self.sizes, np.random.default_rng(0)), self.sizes)
        self.blank = Network(
            tuple(inputs),
            tuple(outputs),
            plan.input_delays,
            plan.output_delays,
            data.step,
            blank,
            of_inputs,
            of_outputs,
        )
        self._standstill = scaled(np.zeros(len(outputs)), of_outputs)
        self._drives = {part: self._scaled(getattr(data, part)) for part in PARTS}
        self._pairs = {part: self._regress(drives, 1) for part, drives in self._drives.items()}
        self._taught = self._regress(self._drives["train"], plan.every)
        self._free = {part: self._closed(drives) for part, drives in self._drives.items()}

    def candidate(self, rng: np.random.Generator) -> Candidate:
        """Train from fresh weights, open loop and then free-running."""
        begin = time.perf_counter()
        fit = train(
            self._taught,
            nguyen_widrow(self.sizes, rng),
            epochs=self.plan.epochs,
            validate=self._pairs["validation"].squares,
            tolerance=self.plan.tolerance,
        )
        middle = time.perf_counter()
        tuned = self.tune(fit.parameters)
        seconds = (middle - begin, time.perf_counter() - middle)
        return Candidate(
            tuned, self.errors(fit.parameters), self.errors(tuned), fit.epochs, fit.gamma, fit.stopped, seconds
        )

    def tune(self, parameters: Floats) -> Floats:
        """Lower the free-running error by backpropagation through time; never raises it on the validation drives."""
        best, p = (self._validation(parameters), parameters), parameters
        budget = self.plan.iterations
        length = min(len(u) for u, _ in self._drives["train"]) - self.blank.delay
        for window in (*(w for w in WINDOWS if w < length), None):
            problem = self._free["train"] if window is None else self._closed(self._drives["train"], window)
            p, best = self._descend(problem, p, budget if window is None else budget // 6, best)
        return best[1]

    def polish(self, parameters: Floats) -> Floats:
        """Continue the tuning on whole drives."""
        best = (self._validation(parameters), parameters)
        return self._descend(self._free["train"], parameters, self.plan.iterations, best)[1][1]

    def errors(self, parameters: Floats) -> Errors:
        """Return one-step and free-running errors of all parts."""
        one_step = {
            part: 0.5 * np.sqrt(pairs.squares_of_outputs(parameters) / len(pairs.t))
            for part, pairs in self._pairs.items()
        }
        return Errors(one_step, {part: 0.5 * np.sqrt(c.errors(parameters)) for part, c in self._free.items()})

    def _descend(self, problem: ClosedLoop, p: Floats, iterations: int, best: tuple[float, Floats]):
        """Return the last parameters of a quasi-Newton descent and the best ones on the validation drives so far."""
        least, count = best, 0

        def watch(at: Floats) -> None:
            nonlocal least, count
            count += 1
            if count % _CHECK_EVERY == 0:
                least = min(least, (self._validation(at), at.copy()), key=lambda pair: pair[0])

        if iterations > 0:
            options: Any = {"maxiter": iterations, "maxfun": 2 * iterations, "maxcor": 40, "ftol": 1e-12, "gtol": 1e-10}
            descend: Any = minimize
            done = descend(_guarded(problem), p, jac=True, method="L-BFGS-B", callback=watch, options=options)
            p = done.x
            least = min(least, (self._validation(p), p), key=lambda pair: pair[0])
        return p, least

    def _validation(self, p: Floats) -> float:
        total = float(np.sum(self._free["validation"].errors(p)))
        return total if np.isfinite(total) else np.inf

    def _scaled(self, series: Sequence[Series]) -> list[tuple[Floats, Floats]]:
        of_inputs, of_outputs = self.blank.input_range, self.blank.output_range
        return [(scaled(s.inputs, of_inputs), scaled(s.outputs, of_outputs)) for s in series]

    def _regress(self, drives: Sequence[tuple[Floats, Floats]], every: int) -> Pairs:
        x = [self.blank.regressors(u, t)[::every] for u, t in drives]
        return Pairs(np.concatenate(x), np.concatenate([t[self.blank.delay :: every] for _, t in drives]), self.sizes)

    def _closed(self, drives: Sequence[tuple[Floats, Floats]], window: int | None = None) -> ClosedLoop:
        plan = self.plan
        return ClosedLoop(
            drives, self.sizes, plan.input_delays, plan.output_delays, window, self._standstill, self.threads
        )


def _guarded(problem: ClosedLoop):
    """Return value and gradient with a large finite value where the network diverges, which a line search needs."""

    def evaluate(p: Floats) -> tuple[float, Floats]:
        value, gradient = problem.value_and_gradient(p)
        if np.isfinite(value) and np.isfinite(gradient).all():
            return value, gradient
        return 1e6, np.zeros_like(p)

    return evaluate


def candidates(
    data: Data, plan: Plan, restarts: int, seed: int, jobs: int = 1, inputs=None, outputs=None
) -> list[Candidate]:
    """Train from several first weights; from two jobs on each has one thread, so their number changes nothing."""
    seeds = np.random.SeedSequence(seed).spawn(restarts)
    signals = (inputs or training_data.INPUTS, outputs or training_data.OUTPUTS)
    with joblib.parallel_config(backend="loky", n_jobs=min(jobs, restarts), inner_max_num_threads=1):
        return list(joblib.Parallel()(joblib.delayed(_candidate)(data, plan, s, *signals) for s in seeds))


def _candidate(data: Data, plan: Plan, seed: np.random.SeedSequence, inputs, outputs) -> Candidate:
    return Trainer(data, plan, inputs, outputs).candidate(np.random.default_rng(seed))
