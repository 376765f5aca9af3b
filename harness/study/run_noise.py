"""The random numbers of a run, and the inputs that an estimator knows where they are measured with noise.

Random numbers depend on neither the order of the runs nor the number of workers. Inputs are known from the past alone
and without differences: filtered, an input is what its samples so far say of it
(``harness.recordings.smooth.kinematic_smoother``), and so is its rate; as measured, it is the sample itself, and its
rate the filtered one still. Either way the estimator is told how far both may be off. Errors of the filter hardly
change from one sample to the next, so that the error that moved the state is in the outputs as well; errors of single
samples are independent.
"""

from __future__ import annotations

import copy
import threading
import zlib
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.config import InputSignal, ModelSpec, StudySpec
from harness.engine.simd.lanes import LANES
from harness.engine.standard_normal import seed_words, standard_normal
from harness.recordings.smooth.kinematic_smoother import Filtered, filtered
from harness.runner.contract import Batch, InputSeries
from harness.study.design import Unit

Scalar = TypeVar("Scalar", bound=np.generic)


class Case(NamedTuple):
    """One run of a unit: its Sobol point and its repeat."""

    sample: int
    repeat: int


Cases = Sequence[Case] | NDArray[np.int64]
"""Runs of a unit; in an array ``(runs, 2)`` many of them."""


class RunNoise:
    """The noise of a study's runs and the seeds of its estimators.

    Args:
        study: The study.
    """

    def __init__(self, study: StudySpec) -> None:
        self._seed, self._begin = study.seed, study.count_from
        self._common = [design.common_noise for design in study.designs]

    def in_common(self, design: int) -> RunNoise:
        """Return the same noise, but that all points of a design share the first one's."""
        other = copy.copy(self)
        other._common = [i == design or is_common for i, is_common in enumerate(self._common)]
        return other

    def key(self, unit: Unit, case: Case) -> tuple[int, int, int]:
        """Return what a run's noise depends on: not the band, as levels share it, and in some designs not the point."""
        begin, sample = self._begin, 0 if self._common[unit.design] else case.sample
        return begin.drive + unit.drive, begin.sample + sample, begin.repeat + case.repeat

    def words(self, unit: Unit, cases: Cases, *further: int) -> NDArray[np.uint64]:
        """Return what the noise of runs is drawn from, one row each; lanes without a run repeat the last one.

        Args:
            unit: That the runs belong to.
            cases: The runs.
            further: Behind what each depends on, for noise of another kind.
        """
        counted = in_whole_batches(np.asarray(cases, dtype=np.uint64))
        keys = np.empty((len(counted), 3 + len(further)), dtype=np.uint64)
        keys[:, :3], keys[:, 3:] = self.key(unit, Case(0, 0)), further
        keys[:, 2] += counted[:, 1]
        if not self._common[unit.design]:
            keys[:, 1] += counted[:, 0]
        return seed_words(self._seed, keys)

    def of_input(self, unit: Unit, group: Cases, samples: int, signal: str) -> NDArray[np.float64]:
        """Return standard normal numbers ``(..., samples, LANES)`` for an input, which no other noise depends on."""
        return standard_normal(self.words(unit, group, zlib.crc32(signal.encode()), 1), samples, 1)[..., 0, :]

    def seeds(self, unit: Unit, group: Cases, estimator: str) -> list[np.random.SeedSequence]:
        """Return the seed of an estimator in each lane; it depends on its name, not on its place in the study."""
        tag = zlib.crc32(estimator.encode())
        keys = [(*self.key(unit, Case(int(sample), int(repeat))), tag) for sample, repeat in group]
        keys += keys[-1:] * (-len(group) % LANES)
        return [np.random.SeedSequence(self._seed, spawn_key=key) for key in keys]


def in_whole_batches(rows: NDArray[Scalar]) -> NDArray[Scalar]:
    """Return rows of runs ``(runs, ...)`` with the last one repeated for the lanes without a run."""
    spare = -len(rows) % LANES
    return np.concatenate([rows, np.repeat(rows[-1:], spare, axis=0)]) if spare else rows


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
