"""What is recorded of a filter: scores of runs against the truth, or every sample of one run.

Kernels record while they run (``harness.runner.scores``, ``harness.runner.history``). ``of`` makes the same of a whole
history, for filters that are no kernels.
"""

from __future__ import annotations

from dataclasses import dataclass, field, fields
from functools import lru_cache
from typing import NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from harness.common.arrays import Floats, Mask
from harness.common.cache import ARRAY, kept
from harness.runner.contract import Filter, History
from harness.runner.limits import LARGEST

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
    """What is summed up of runs over time, from which their scores are made.

    Attributes:
        errors: Of each target ``(3, targets, runs)``; see ``harness.runner.scores.estimate``, also for the next.
        per_run: ``(10, runs)``. Of several batches both have their axis in front.
        stated: Whether the estimator states a covariance.
        kept: As in ``Scores``.
    """

    errors: Floats
    per_run: Floats
    stated: bool
    kept: Floats | None = None

    def scores(self) -> Scores:
        """Return the scores of any number of runs."""
        errors, per_run = self.errors, self.per_run
        with np.errstate(invalid="ignore", divide="ignore"):
            scored, nees_samples, updates = per_run[0], per_run[2], per_run[5]
            nothing = np.full(per_run.shape[1], np.nan)
            return Scores(
                rmse=np.sqrt(errors[0] / scored),
                bias=errors[1] / scored,
                max_error=np.where(scored > 0, errors[2], np.nan),
                nees=per_run[1] / nees_samples if self.stated else nothing,
                nees_inside=per_run[3] / nees_samples if self.stated else nothing,
                nis=per_run[4] / updates if self.stated else nothing,
                nis_inside=per_run[6] / updates if self.stated else nothing,
                log_likelihood=per_run[7] if self.stated else nothing,
                repairs=per_run[8],
                updates=updates,
                diverged_at=per_run[9],
                kept=self.kept,
            )


class Compared(NamedTuple):
    """What of a filter is compared with which row of the truth; see ``harness.runner.scores.estimate``.

    Attributes:
        rows: ``(nx + ns,)``.
        without: Targets that have no score ``(ns,)``; ``None`` where all have one.
        options: ``(4,)``.
        bounds: ``(1 + max(nx, ny), 2)``.
    """

    rows: NDArray[np.int64]
    without: Mask | None
    options: Floats
    bounds: Floats


@dataclass(frozen=True)
class Scoring:
    """Scores of runs against the truth.

    Attributes:
        truth: The plant's signals ``(..., samples, len(names), LANES)``.
        names: Their names. A target that is not among them has no score; the NEES needs every state.
        until: Scores stop before this sample ``(..., LANES)``; the truth of every target is a number up to there.
        since: Scores begin at this sample.
        keep: Whether to keep the estimates of the targets over time.
    """

    truth: Floats
    names: tuple[str, ...]
    until: Floats
    since: int = 0
    keep: bool = False

    def compared(self, filter_: Filter) -> Compared:
        """Return what of a filter is compared with what."""
        return compared(filter_, self.names, self.since)

    def of(self, history: History, filter_: Filter) -> Sums:
        """Return the sums of runs side by side."""
        rows, without, (every, comparable, stated, _), bounds = self.compared(filter_)
        nx, samples = len(filter_.ports.states), self.truth.shape[-3]
        targets, chosen = rows[nx:], rows[nx:] >= 0
        k = np.arange(samples)[:, None]
        nis, seen, likelihood, repairs, outside = np.moveaxis(history.facts, -2, 0)
        with np.errstate(invalid="ignore", over="ignore"):
            numbers = np.abs(history.estimate[..., chosen, :]) <= LARGEST
            bad = (outside > 0) | ~numbers.all(axis=-2)
            if stated:
                bad |= (seen > 0) & ~((nis <= LARGEST) & (np.abs(likelihood) <= LARGEST))
            bad &= (k > 0) & (k < self.until[..., None, :])
            diverged = np.where(bad.any(axis=-2), bad.argmax(axis=-2), samples)
            active = (k > 0) & (k < np.minimum(diverged, self.until)[..., None, :]) & (k >= self.since)
            error = np.zeros_like(history.estimate)
            error[..., chosen, :] = history.estimate[..., chosen, :] - self.truth[..., targets[chosen], :]
            error = np.where(active[..., None, :], error, 0.0)
            errors = np.stack([(error**2).sum(-3), error.sum(-3), np.abs(error).max(-3)], axis=-3)
            used = active & (seen > 0)
            low, high = np.moveaxis(bounds[np.where(used, seen, 0).astype(int)], -1, 0)
            nees = np.full(active.shape, np.nan)
            if comparable:
                due = slice(0, None, int(every))
                nees[..., due, :] = self._nees(history, rows[:nx], due)
            weighed = active & np.isfinite(nees)
            inside = weighed & (nees >= bounds[nx, 0]) & (nees <= bounds[nx, 1])
            counted = [
                active, np.where(weighed, nees, 0.0), weighed, inside, np.where(used, nis, 0.0), used,
                used & (nis >= low) & (nis <= high), np.where(used, likelihood, 0.0), np.where(active, repairs, 0.0),
            ]  # fmt: skip
        if without is not None:
            errors[..., without, :] = np.nan
        per_run = np.stack([*(np.sum(each, axis=-2, dtype=float) for each in counted), diverged], axis=-2)
        kept_ = np.stack([history.estimate, history.deviation], axis=-3) if self.keep else None
        return Sums(errors, per_run, filter_.has_covariance, kept_)

    def _nees(self, history: History, rows: NDArray[np.int64], due: slice) -> Floats:
        """Return the NEES at some samples ``(..., samples, LANES)``, NaN where the covariance has no inverse."""
        error = np.moveaxis(history.mean - self.truth[..., rows, :], -1, -2)[..., due, :, :]
        covariance = np.moveaxis(history.state_covariance, -1, -3)[..., due, :, :, :]
        lost = ~np.isfinite(covariance).all(axis=(-1, -2)) | (np.linalg.det(np.nan_to_num(covariance)) == 0.0)
        covariance = np.where(lost[..., None, None], np.eye(len(rows)), covariance)
        nees = np.einsum("...i,...i->...", error, np.linalg.solve(covariance, error[..., None])[..., 0])
        return np.where(lost | (nees < 0.0), np.nan, nees)


def compared(filter_: Filter, names: tuple[str, ...], since: int) -> Compared:
    """Return what of a filter is compared with signals of a plant from a sample on."""
    ports = filter_.ports
    given = tuple(map(bool, filter_.gives))
    return _compared(
        tuple(ports.states), len(ports.outputs), filter_.signals, given, filter_.has_covariance, names, since
    )


@lru_cache(maxsize=256)
def _compared(
    states: tuple[str, ...],
    outputs: int,
    signals: tuple[str, ...],
    given: tuple[bool, ...],
    stated: bool,
    names: tuple[str, ...],
    since: int,
) -> Compared:
    rows = np.array([names.index(n) if n in names else -1 for n in (*states, *signals)], dtype=np.int64)
    comparable = stated and bool(np.all(rows[: len(states)] >= 0))
    rows[len(states) :][~np.array(given, dtype=bool)] = -1
    without = rows[len(states) :] < 0
    options = np.array([NEES_EVERY, comparable, stated, since], dtype=float)
    bounds = chi_square_bounds(1 + max(len(states), outputs))
    return Compared(rows, without if without.any() else None, options, bounds)


@dataclass(frozen=True)
class EverySample:
    """All that a filter holds at every sample, of the first run.

    Attributes:
        of_state: Whether mean and covariance of the state are kept.
        of_signals: Whether the signals and their standard deviations are kept.
        rows: Signals of which the covariance is kept as well ``(m,)``.
    """

    of_state: bool = True
    of_signals: bool = False
    rows: NDArray[np.int64] = field(default_factory=lambda: np.empty(0, dtype=np.int64))

    def room(self, samples: int, filter_: Filter) -> History:
        """Return room for a run."""
        ports, referenced = filter_.ports, len(self.rows)
        nx, ns, ny = len(ports.states), len(filter_.signals), len(ports.outputs)
        of_states, of_signals = samples * self.of_state, samples * self.of_signals
        sizes = (of_states, nx), (of_states, nx, nx), (of_signals, ns), (of_signals, ns)
        further = (of_signals, referenced, referenced), (samples, ny), (samples, ny, ny), (samples, 5)
        room = History(*(np.zeros(size) for size in (*sizes, *further)))
        room.innovation[0] = room.spread[0] = room.facts[0, 0] = np.nan
        return room

    def of(self, history: History, filter_: Filter) -> History:
        """Return what is kept of the first of runs side by side."""
        first = (getattr(history, each.name)[..., 0] for each in fields(history))
        return History(*first)


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
