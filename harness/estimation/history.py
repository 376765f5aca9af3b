"""An estimator that is followed: all that it holds at every sample of one run."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.engine.compile import CompiledModel, load_source, paste
from harness.engine.kernel_names import Belief, State
from harness.estimation.contract import kernels_of, load_estimator
from harness.runner.filter_loop import BATCH, RECORDING
from harness.runner.history import HISTORY, follow_filter


@dataclass(frozen=True)
class History:
    """What an estimator held over a run, sample by sample; arrays of no samples were not asked for.

    Attributes:
        mean, state_covariance: Of the state ``(samples, nx)``, ``(samples, nx, nx)``.
        estimate, deviation: Of the signals ``(samples, ns)``.
        covariance: Of some of them ``(samples, m, m)``.
        innovation, spread: The innovation ``(samples, ny)`` and its covariance ``(samples, ny, ny)``; NaN at the first
            sample.
        facts: NIS (NaN at the first sample), measurements used, log-likelihood, repairs, and whether the state is
            outside its limits ``(samples, 5)``.
    """

    mean: Floats
    state_covariance: Floats
    estimate: Floats
    deviation: Floats
    covariance: Floats
    innovation: Floats
    spread: Floats
    facts: Floats

    @classmethod
    def empty(cls, samples: int, compiled: CompiledModel, of_state: bool, of_signals: bool, referenced: int) -> History:
        """Return room for a run: for the state, for the signals, and for the covariance of so many of these."""
        of_states, of_them = samples * of_state, samples * of_signals
        nx, ns, ny = compiled.nx, len(compiled.signal_names), compiled.ny
        sizes = (of_states, nx), (of_states, nx, nx), (of_them, ns), (of_them, ns), (of_them, referenced, referenced)
        kept = cls(*(np.zeros(size) for size in (*sizes, (samples, ny), (samples, ny, ny), (samples, 5))))
        kept.innovation[0] = kept.spread[0] = kept.facts[0, 0] = np.nan
        return kept


class FollowedEstimator:
    """An estimator compiled to be followed.

    Args:
        kind: File in ``harness/estimation/methods``.
        compiled: The belief.
        recorded: Whether it runs over recordings, plain arrays that all lanes share, and not over batches.
        input_errors: Whether it is told what the errors of its inputs do.
    """

    def __init__(self, kind: str, compiled: CompiledModel, recorded: bool, input_errors: bool) -> None:
        self.compiled = compiled
        kernels = kernels_of(load_estimator(kind), input_errors, parameters=bool(compiled.model.within))
        kernels |= (RECORDING if recorded else BATCH) | HISTORY
        source = paste(compiled, f"follow_{kind}", [follow_filter], kernels)
        self._loop = load_source(f"follow_{kind}", source).follow_filter

    def run(
        self,
        source: tuple[Floats, ...],
        belief: Belief,
        first: State,
        of_state: bool = True,
        of_signals: bool = False,
        rows: NDArray[np.int64] | None = None,
    ) -> History:
        """Run over a batch, of which the first lane is kept, or over a recording.

        Args:
            source: What ``harness.runner.filter_loop.read_batch`` or ``read_recording`` reads from.
            belief: Constants and noise.
            first: State before the first step.
            of_state: Whether mean and covariance of the state are kept.
            of_signals: Whether the signals and their standard deviations are kept.
            rows: Signals of which the covariance is kept as well ``(m,)``.
        """
        rows = np.empty(0, dtype=np.int64) if rows is None else rows
        history = History.empty(len(source[0]), self.compiled, of_state, of_signals, len(rows))
        kept: tuple[Any, ...] = tuple(vars(history).values())
        self._loop(source, belief, first, self.compiled.model.limits, rows, kept)
        return history
