"""The innovations of a filter over recordings, their likelihood, and exact derivatives of both.

``Innovations`` compiles a filter for a model twice: over plain lanes, where eight candidates run at a time, and over
dual numbers (``harness.engine.simd.dual``), where one candidate runs with its derivatives along eight directions.
Whatever the filter computes is differentiated: means, covariances, gains, the likelihood. Nothing is differenced.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from harness.common.arrays import Floats
from harness.config import ModelSpec
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.identification import time_loops
from harness.identification.candidates import Candidates, Each, for_each
from harness.identification.data import DriveData
from harness.identification.filtered_model import FilteredModel, Slopes, of_valid
from harness.identification.time_loops import Likelihood
from harness.runner.contract import Held, InputSeries


class Innovations(FilteredModel):
    """A filter compiled for identification.

    Args:
        spec: The model; its values and variances are where a search begins.
        kind: File in ``harness/estimation/methods``; of Kalman type and without memory of its own.
        jobs: Threads; all cores by default.

    Attributes:
        loop: Of the filter over a recording, compiled.
    """

    def __init__(self, spec: ModelSpec, kind: str = "ekf", jobs: int | None = None) -> None:
        super().__init__(spec, spec.model(), jobs)
        self.kind = kind
        self._plain, self._slopes = CompiledEstimator(kind, self.compiled), CompiledEstimator(kind, self.duals)
        self._limits = self._slopes.limits = self._plain.limits
        self._slopes.module(Likelihood(time_loops.note_slopes, ()).recorder, recorded=True)  # before threads ask for it
        self.loop = self._plain.module(Likelihood(time_loops.note_run, ()).recorder, recorded=True).innovate

    def __reduce__(self) -> tuple[type[Innovations], tuple[ModelSpec, str, int]]:
        """Pickle what it is made of: its kernels are compiled again."""
        return Innovations, (self.spec, self.kind, self.jobs)

    def log_likelihoods(self, drives: Sequence[DriveData], candidates: Each, keep_first: bool = False) -> Floats:
        """Return the log-likelihood of each candidate; no run is kept, because the slopes here are not of a run."""
        return super().log_likelihoods(drives, candidates)

    def slopes(self, drives: Sequence[DriveData], points: Each, directions: Each) -> Slopes:
        """Return the log-likelihood of all recordings at a point, with its exact gradient and Fisher information.

        Args:
            drives: The recordings.
            points: One candidate, or one for each recording.
            directions: Derivatives of what is held, one column per direction.
        """
        n = for_each(directions, drives)[0].count
        total, gradient, information = 0.0, np.zeros(n), np.zeros((n, n))
        for value, slopes, rows in self._every_slope(drives, points, directions):
            total += value
            gradient += slopes
            flat = rows.reshape(-1, n)
            information += flat.T @ flat
        return Slopes(total, gradient, information)

    def scores(self, drives: Sequence[DriveData], points: Each, directions: Each) -> list[Floats]:
        """Return the derivatives of every sample's log-likelihood ``(samples, n)``, recording by recording.

        With the whitened innovations ``w``, those are ``-(L^-1 de)' w + tr(G (w w' - 1)) / 2`` (``note_slopes``).

        Args:
            drives: The recordings.
            points: One candidate, or one for each recording.
            directions: Derivatives of what is held, one column per direction.
        """
        by_drive = []
        for (_, _, rows), run in zip(
            self._every_slope(drives, points, directions), self.runs(drives, points), strict=True
        ):
            w = np.nan_to_num(run.whitened)
            a, b = np.tril_indices(w.shape[1])
            products = np.where(a == b, (w[:, a] * w[:, b] - 1.0) / np.sqrt(2.0), w[:, a] * w[:, b])
            by_drive.append(np.einsum("kan,ka->kn", rows, np.concatenate([-w, products], axis=1)))
        return by_drive

    def _every_slope(
        self, drives: Sequence[DriveData], points: Each, directions: Each
    ) -> Iterator[tuple[float, Floats, Floats]]:
        """Return of each recording the log-likelihood, its gradient ``(n,)`` and what ``note_slopes`` keeps."""
        at, along = for_each(points, drives), for_each(directions, drives)
        n = along[0].count
        starts = range(0, n, LANES)
        tasks = [
            (drive, point, moved.take(slice(s, s + LANES)))
            for drive, point, moved in zip(drives, at, along, strict=True)
            for s in starts
        ]
        slopes = self.share(lambda task: self._slope(*task), tasks)
        for i in range(0, len(slopes), len(starts)):
            of_drive = slopes[i : i + len(starts)]
            gradient = np.concatenate([g for _, g, _ in of_drive])[:n]
            yield of_drive[0][0], gradient, np.concatenate([r for _, _, r in of_drive], axis=2)[:, :, :n]

    def _slope(self, drive: DriveData, point: Candidates, directions: Candidates) -> tuple[float, Floats, Floats]:
        samples, ny = drive.measurements.shape
        drive, values = self.read_ahead(drive, point.values)
        dual = _dual(replace(point, values=values), directions)
        variance = np.zeros((self.nx, 2 * LANES))
        variance[:, :LANES] = drive.first_variance[:, None]
        held = Held(dual.values, dual.process, dual.measurement, self._first(drive, dual.values), variance)
        rows = np.zeros((samples, ny + ny * (ny + 1) // 2, LANES))
        total = self._run(self._slopes, drive, held, Likelihood(time_loops.note_slopes, rows))
        return float(of_valid(total, drive)[0]), total[0, LANES:].copy(), rows

    def _filter(self, drive: DriveData, held: Held, notes: tuple[Floats, ...]) -> Floats:
        return self._run(self._plain, drive, held, Likelihood(time_loops.note_run, notes))

    def _run(self, estimator: CompiledEstimator, drive: DriveData, held: Held, record: Likelihood) -> Floats:
        inputs = InputSeries(drive.inputs, drive.between, effects=drive.effects)
        return estimator.run(inputs, drive.measurements, held, record)


def _dual(point: Candidates, directions: Candidates) -> Candidates:
    """Return a point with directions as duals: the value in every lane, then up to ``LANES`` tangents."""

    def join(value: Floats, tangent: Floats) -> Floats:
        both = np.zeros((len(value), 2 * LANES))
        both[:, :LANES] = value
        both[:, LANES : LANES + tangent.shape[1]] = tangent
        return both

    return Candidates(
        join(point.values, directions.values),
        join(point.process, directions.process),
        join(point.measurement, directions.measurement),
    )
