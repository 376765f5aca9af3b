"""Inputs as estimators know them where they are measured with noise: from the past alone, and without differences.

Filtered, an input is what its samples so far say of it (``harness.recordings.smooth.kinematic_smoother``), and so is
its rate. As measured, it is the sample itself; its rate is the filtered one still. Either way the estimator is told how
far both may be off. Errors of the filter hardly change from one sample to the next, so that the error that moved the
state is in the outputs as well; errors of single samples are independent.
"""

from __future__ import annotations

import threading

import numpy as np

from harness.common.arrays import Floats
from harness.config import InputSignal, ModelSpec
from harness.engine.simd.lanes import LANES
from harness.recordings.smooth.kinematic_smoother import Filtered, filtered
from harness.runner.contract import Batch, InputSeries


class NoisyInputs:
    """The inputs of a belief, with what is not known of them.

    Args:
        belief: With noise of inputs.
    """

    def __init__(self, belief: ModelSpec) -> None:
        self._step, self._model, self._signals = belief.step, belief.model(), tuple(belief.input_noise)
        self._last = threading.local()

    def known(self, batch: Batch, table: Floats, variances: Floats, kind: InputSignal) -> InputSeries:
        """Return inputs at the samples ``(samples, nu, LANES)``, and what is not known of them.

        Args:
            batch: Whose inputs they are.
            table: The inputs without noise, but for those that sensors of the vehicle supply ``(samples, nu, LANES)``.
            variances: What is believed of each noisy signal ``(signals, LANES)``; with zero it is exact.
            kind: What the estimator takes.
        """
        at, between, roots = table.copy(), table.copy(), []
        for signal, each in self._filtered(batch, table, variances).items():
            root = np.zeros((*table.shape[:2], 2, LANES))
            for lane, (read, smoothed) in enumerate(each):
                if smoothed is None:
                    continue
                values, spread = smoothed.value, smoothed.covariance
                if kind == "measured":
                    values, spread = read, smoothed.of_the_sample
                halves = np.linalg.cholesky(spread)
                for half, column in enumerate(self._columns(signal)):
                    at[:, column, lane] = between[:, column, lane] = values if half == 0 else smoothed.rate
                    root[:, column, :, lane] = halves[:, half]
                    if half == 1:  # over a step, the rate is that in the middle of it
                        between[:-1, column, lane] += np.diff(smoothed.rate) / 2
            roots.append(root)
        together = np.concatenate(roots, axis=2)
        if kind == "filtered":
            return InputSeries(at, between, together, together)
        nothing = np.zeros_like(together)
        pairs = (together, nothing), (nothing, together)
        return InputSeries(at, between, *(np.concatenate(pair, axis=2) for pair in pairs))

    def _columns(self, signal: str) -> list[int]:
        """Return the place of a signal among the inputs, and that of its rate where that is one."""
        rates = [rate for rate, source in self._model.rates.items() if source == signal]
        return [self._model.inputs.index(name) for name in (signal, *rates)]

    def _filtered(
        self, batch: Batch, table: Floats, variances: Floats
    ) -> dict[str, list[tuple[Floats, Filtered | None]]]:
        """Return what is read of each noisy signal and what its past says, by lane; for all estimators alike."""
        last = getattr(self._last, "filtered", None)
        if last is not None and last[0] is batch and np.array_equal(last[1], variances):
            return dict(last[2])
        by_signal = {}
        for row, signal in enumerate(self._signals):
            errors = batch.input_errors.get(signal, np.zeros((len(table), LANES)))
            exact = table[:, self._model.inputs.index(signal)]
            reads = [exact[:, lane] + errors[:, lane] for lane in range(LANES)]
            deviations = np.sqrt(variances[row])
            by_signal[signal] = [
                (read, filtered(read, self._step, deviation) if deviation > 0 else None)
                for read, deviation in zip(reads, deviations, strict=True)
            ]
        self._last.filtered = batch, variances.copy(), by_signal
        return by_signal
