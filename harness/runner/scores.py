"""Scores of a filter against the truth: sums that its kernels add up while they run, and what is made of them.

A kernel records through ``add_scores``. ``Scoring.of`` does the same arithmetic on a whole history, for filters that
are no kernels; a test holds the two equal (``tests/study/test_contracts_of_the_runner.py``).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray

from harness.common.arrays import Floats, Mask, batches
from harness.common.cache import ARRAY, kept
from harness.engine.kernel_names import (
    LANES,
    NS,
    NX,
    NY,
    Belief,
    State,
    cholesky,
    get,
    mahalanobis,
    put,
    select,
    signals,
    signals_jacobian,
    splat,
    sqrt,
)
from harness.models.signals import turn_of
from harness.runner.contract import Filter, History, Recorder
from harness.runner.filter_loop import (
    record_first,
    record_sample,
    recording_room,
    run_filter,
    within_turn,
    write_covariance,
)
from harness.runner.simulation_loop import LARGEST, outside, surprised, undefined

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
        errors: Of each target ``(3, targets, runs)``; see ``run_and_score``, also for the next.
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
    """What of a filter is compared with which row of the truth; see ``run_and_score``.

    Attributes:
        rows: ``(nx + ns,)``.
        turns: After how much each repeats itself ``(nx + ns,)``; 0 where it does not.
        without: Targets that have no score ``(ns,)``; ``None`` where all have one.
        options: ``(4,)``.
        bounds: ``(1 + max(nx, ny), 2)``.
    """

    rows: NDArray[np.int64]
    turns: Floats
    without: Mask | None
    options: Floats
    bounds: Floats


def run_and_score(inputs, y, truth, rows, turns, until, belief, first, limits, options, bounds, scores, per_run, kept):
    """Run the estimator over batches and score it against the truth while it runs.

    With an axis of batches in front come all that end in ``LANES`` but ``belief.input_errors``; that of ``inputs`` may
    have the length 1, where all batches have the same.

    Args:
        inputs: The first four of what ``harness.runner.filter_loop.read_batch`` reads.
        y: Measurements ``(samples, ny, LANES)``, NaN where missing.
        truth: The plant's signals ``(samples, plant signals, LANES)``.
        rows: Row of ``truth`` of each state of the estimator, then of each target ``(nx + ns,)``; -1 where the
            plant has no such quantity, or the estimator does not give it.
        turns: After how much each of these repeats itself ``(nx + ns,)``; 0 where it does not.
        until: Scores stop before this sample ``(1, LANES)``; the truth of every target is a number up to there.
        belief: ``harness.engine.kernel_names.Belief``.
        first: ``harness.engine.kernel_names.State`` before the first step.
        limits: Largest magnitude of each state ``(nx,)``.
        options: NEES every that many samples, 1 if there is one to compute, 1 if the estimator states a covariance,
            and the first sample scored ``(4,)``.
        bounds: Two-sided 95 % chi-square bounds ``(1 + max(nx, ny), 2)`` by degrees of freedom.
        scores: Sum of squares, sum and largest magnitude of the error, written ``(3, ns, LANES)``.
        per_run: Written ``(10, LANES)``: samples scored, sum of NEES, samples of it, those inside, sum of NIS,
            samples with a measurement, those inside, log-likelihood, repairs, sample of divergence.
        kept: Estimates and standard deviations of the targets, written ``(samples or 0, 2, ns, LANES)``.
    """
    u, between, moved, moved_at = inputs
    memories = np.empty(first.memory.shape[1:]), np.empty(first.memory.shape[1:])
    for b in range(y.shape[0]):
        own, own_errors = min(b, u.shape[0] - 1), min(b, moved.shape[0] - 1)
        source = u[own], between[own], moved[own_errors], moved_at[own_errors], y[b]
        held = Belief(
            belief.constants[b], belief.process_noise[b], belief.measurement_noise[b], belief.tuning,
            belief.input_errors, belief.priors,
        )  # fmt: skip
        begun = State(first.mean[b], first.covariance[b], first.memory[b])
        record = truth[b], rows, turns, until[b], limits, options, bounds, scores[b], per_run[b], kept[b]
        run_filter(source, held, begun, memories, record)


def room_of_scores():
    """Return room for the targets and their derivatives, and for the NEES."""
    return (
        (np.empty((NS, LANES)), np.empty((NS, NX, LANES))),
        (np.zeros((NX, NX, LANES)), np.empty((NX, LANES)), np.empty((NX, LANES))),
    )


def begin_scores(samples, state, u, belief, room, record):
    """Set all sums to zero and keep the first estimates, if any are kept."""
    _, _, _, _, _, _, _, scores, per_run, kept = record
    (s, slopes), _ = room
    scores[:] = 0.0
    per_run[:] = 0.0
    put(splat(1.0 * samples), per_run, 9)
    if kept.shape[0] > 0:
        keep_targets(state, u, belief, s, slopes, kept[0])


def add_scores(k, state, previous, u_before, u, y, belief, work, info, room, record):
    """Add one sample to all sums, as far as the run has not diverged, and keep the estimates."""
    truth, rows, turns, until, limits, options, bounds, scores, per_run, kept = record
    (s, slopes), (factor, error, scratch) = room
    every, comparable, stated = int(options[0]), options[1] > 0.5, options[2] > 0.5
    diverged = get(per_run, 9)
    signals(state.mean, u, belief.constants, s)
    bad = (outside(state.mean, limits) > 0.0) | (undefined(s, rows[NX:]) > 0.0)
    if stated:
        bad = bad | (surprised(info) > 0.0)
    bad = bad & (diverged > 1.0 * k) & (get(until, 0) > 1.0 * k)
    diverged = select(bad, 1.0 * k, diverged)
    put(diverged, per_run, 9)
    active = (diverged > 1.0 * k) & (get(until, 0) > 1.0 * k) & (splat(1.0 * k) >= options[3])
    score_targets(s, truth[k], rows, turns, active, scores)
    score_information(info, active, bounds, per_run)
    if comparable and k % every == 0:
        write_covariance(state, work)
        score_covariance(state, truth[k], rows, turns, active, bounds, factor, error, scratch, per_run)
    if kept.shape[0] > 0:
        write_covariance(state, work)
        keep_targets(state, u, belief, s, slopes, kept[k])


def score_targets(s, truth, rows, turns, active, scores):
    """Add one sample's target errors."""
    for i in range(NS):
        if rows[NX + i] >= 0:
            e = select(active, within_turn(get(s, i) - get(truth, rows[NX + i]), turns[NX + i]), 0.0)
            put(get(scores, 0, i) + e * e, scores, 0, i)
            put(get(scores, 1, i) + e, scores, 1, i)
            magnitude = select(e < 0.0, -e, e)
            largest = get(scores, 2, i)
            put(select(magnitude > largest, magnitude, largest), scores, 2, i)


def score_information(info, active, bounds, per_run):
    """Add one sample's NIS, likelihood and repairs."""
    seen = get(info.seen, 0)
    used = active & (seen > 0.0)
    nis = get(info.nis, 0)
    low, high = splat(0.0), splat(0.0)
    for m in range(1, NY + 1):
        low = select(seen == 1.0 * m, bounds[m, 0], low)
        high = select(seen == 1.0 * m, bounds[m, 1], high)
    put(get(per_run, 0) + select(active, 1.0, 0.0), per_run, 0)
    put(get(per_run, 4) + select(used, nis, 0.0), per_run, 4)
    put(get(per_run, 5) + select(used, 1.0, 0.0), per_run, 5)
    put(get(per_run, 6) + select(used & (nis >= low) & (nis <= high), 1.0, 0.0), per_run, 6)
    put(get(per_run, 7) + select(used, get(info.log_likelihood, 0), 0.0), per_run, 7)
    put(get(per_run, 8) + select(active, get(info.repairs, 0), 0.0), per_run, 8)


def score_covariance(state, truth, rows, turns, active, bounds, factor, error, scratch, per_run):
    """Add one sample's normalised estimation error squared."""
    cholesky(state.covariance, factor, NX)
    for i in range(NX):
        put(within_turn(get(state.mean, i) - get(truth, rows[i]), turns[i]), error, i)
    nees = mahalanobis(factor, error, scratch, NX)
    used = active & (nees == nees)
    put(get(per_run, 1) + select(used, nees, 0.0), per_run, 1)
    put(get(per_run, 2) + select(used, 1.0, 0.0), per_run, 2)
    inside = used & (nees >= bounds[NX, 0]) & (nees <= bounds[NX, 1])
    put(get(per_run, 3) + select(inside, 1.0, 0.0), per_run, 3)


def keep_targets(state, u, belief, s, slopes, kept):
    """Keep the estimates of the targets and their standard deviations."""
    signals(state.mean, u, belief.constants, s)
    signals_jacobian(state.mean, u, belief.constants, slopes)
    for a in range(NS):
        put(get(s, a), kept, 0, a)
        variance = splat(0.0)
        for i in range(NX):
            for j in range(NX):
                variance = variance + get(slopes, a, i) * get(state.covariance, i, j) * get(slopes, a, j)
        put(sqrt(select(variance < 0.0, 0.0, variance)), kept, 1, a)


SCORES = {recording_room: room_of_scores, record_first: begin_scores, record_sample: add_scores}
"""Kernels of the recorder of ``run_and_score``."""


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
    recorder: ClassVar[Recorder] = Recorder(run_and_score, SCORES)

    def compared(self, filter_: Filter) -> Compared:
        """Return what of a filter is compared with what."""
        return comparison(filter_, self.names, self.since)

    def run(
        self,
        loop: Callable[..., None],
        source: tuple[Any, ...],
        belief: Belief,
        first: State,
        limits: Floats,
        filter_: Filter,
    ) -> Sums:
        """Run the compiled loop over batches and return the sums."""
        rows, turns, without, options, bounds = self.compared(filter_)
        samples, targets, lead = self.truth.shape[-3], len(filter_.signals), self.truth.shape[:-3]
        sums, per_run = np.empty((*lead, 3, targets, LANES)), np.empty((*lead, 10, LANES))
        kept_ = np.empty((*lead, samples if self.keep else 0, 2, targets, LANES))
        *inputs, measurements = source
        loop(
            tuple(batches(each, dimensions) for each, dimensions in zip(inputs, (3, 3, 4, 4), strict=True)),
            batches(measurements, 3),
            batches(self.truth, 3),
            rows, turns, self.until.reshape(-1, 1, LANES),
            belief._replace(
                constants=batches(belief.constants, 2),
                process_noise=batches(belief.process_noise, 2),
                measurement_noise=batches(belief.measurement_noise, 2),
            ),
            State(batches(first.mean, 2), batches(first.covariance, 3), batches(first.memory, 2)),
            limits, options, bounds, batches(sums, 3), batches(per_run, 2), batches(kept_, 4),
        )  # fmt: skip
        if without is not None:
            sums[..., without, :] = np.nan
        if self.keep:
            kept_[..., ~filter_.gives, :] = np.nan
        return Sums(sums, per_run, filter_.has_covariance, kept_ if self.keep else None)

    def of(self, history: History, filter_: Filter) -> Sums:
        """Return the sums of runs side by side.

        The arithmetic of ``add_scores`` once more, over whole arrays; ``tests/study/test_contracts_of_the_runner.py``
        holds the two equal. What is NaN throughout, NIS or likelihood, is not stated and has no score.
        """
        if self.truth.ndim > 3:  # one batch after the other, which the caches hold
            alone = [replace(self, truth=t, until=u) for t, u in zip(self.truth, self.until, strict=True)]
            held = [History(*(part[b] for part in vars(history).values())) for b in range(len(alone))]
            parts = [each.of(its, filter_) for each, its in zip(alone, held, strict=True)]
            errors, per_run = np.stack([p.errors for p in parts]), np.stack([p.per_run for p in parts])
            over_time = [p.kept for p in parts if p.kept is not None]
            return Sums(errors, per_run, filter_.has_covariance, np.stack(over_time) if over_time else None)
        rows, turns, without, (every, comparable, stated, _), bounds = self.compared(filter_)
        nx, samples = len(filter_.ports.states), self.truth.shape[-3]
        targets, chosen = rows[nx:], rows[nx:] >= 0
        k = np.arange(samples)[:, None]
        nis, seen, likelihood, repairs, outside = np.moveaxis(history.facts, -2, 0)
        with np.errstate(invalid="ignore", over="ignore"):
            no_nis, no_likelihood = (np.isnan(each).all(axis=-2, keepdims=True) for each in (nis, likelihood))
            numbers = np.abs(history.estimate[..., chosen, :]) <= LARGEST
            bad = (outside > 0) | ~numbers.all(axis=-2)
            if stated:
                expected = (no_nis | (nis <= LARGEST)) & (no_likelihood | (np.abs(likelihood) <= LARGEST))
                bad |= (seen > 0) & ~expected
            bad &= (k > 0) & (k < self.until[..., None, :])
            diverged = np.where(bad.any(axis=-2), bad.argmax(axis=-2), samples)
            active = (k > 0) & (k < np.minimum(diverged, self.until)[..., None, :]) & (k >= self.since)
            error = np.zeros_like(history.estimate)
            error[..., chosen, :] = history.estimate[..., chosen, :] - self.truth[..., targets[chosen], :]
            error = np.where(active[..., None, :], _within_turns(error, turns[nx:]), 0.0)
            errors = np.stack([(error**2).sum(-3), error.sum(-3), np.abs(error).max(-3)], axis=-3)
            used = active & (seen > 0)
            low, high = np.moveaxis(bounds[np.where(used, seen, 0).astype(int)], -1, 0)
            nees = np.full(active.shape, np.nan)
            if comparable:
                due = slice(0, None, int(every))
                nees[..., due, :] = self._nees(history, rows[:nx], turns[:nx], due)
            weighed = active & np.isfinite(nees)
            inside = weighed & (nees >= bounds[nx, 0]) & (nees <= bounds[nx, 1])
            counted = [
                active, np.where(weighed, nees, 0.0), weighed, inside, np.where(used, nis, 0.0), used,
                np.where(no_nis, np.nan, used & (nis >= low) & (nis <= high)), np.where(used, likelihood, 0.0),
                np.where(active, repairs, 0.0),
            ]  # fmt: skip
        if without is not None:
            errors[..., without, :] = np.nan
        per_run = np.stack([*(np.sum(each, axis=-2, dtype=float) for each in counted), diverged], axis=-2)
        kept_ = np.stack([history.estimate, history.deviation], axis=-3) if self.keep else None
        return Sums(errors, per_run, filter_.has_covariance, kept_)

    def _nees(self, history: History, rows: NDArray[np.int64], turns: Floats, due: slice) -> Floats:
        """Return the NEES at some samples ``(..., samples, LANES)``, NaN where the covariance has no inverse."""
        error = _within_turns(history.mean - self.truth[..., rows, :], turns)
        error = np.moveaxis(error, -1, -2)[..., due, :, :]
        covariance = np.moveaxis(history.state_covariance, -1, -3)[..., due, :, :, :]
        lost = ~np.isfinite(covariance).all(axis=(-1, -2)) | (np.linalg.det(np.nan_to_num(covariance)) == 0.0)
        covariance = np.where(lost[..., None, None], np.eye(len(rows)), covariance)
        nees = np.einsum("...i,...i->...", error, np.linalg.solve(covariance, error[..., None])[..., 0])
        return np.where(lost | (nees < 0.0), np.nan, nees)


def _within_turns(apart: Floats, turns: Floats) -> Floats:
    """Return differences ``(..., n, LANES)``, those of signals that repeat themselves nearest to zero."""
    for i in np.flatnonzero(turns):
        apart[..., i, :] -= turns[i] * np.floor(apart[..., i, :] / turns[i] + 0.5)
    return apart


def comparison(filter_: Filter, names: tuple[str, ...], since: int) -> Compared:
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
    turns = np.array([turn_of(n) for n in (*states, *signals)])
    without = rows[len(states) :] < 0
    options = np.array([NEES_EVERY, comparable, stated, since], dtype=float)
    bounds = chi_square_bounds(1 + max(len(states), outputs))
    return Compared(rows, turns, without if without.any() else None, options, bounds)


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
