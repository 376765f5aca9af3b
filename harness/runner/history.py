"""All that a filter holds at every sample, of the first lane: all lanes are the same run."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, fields
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.engine.kernel_names import LANES, NS, NX, NY, Belief, State, put, signals, signals_jacobian
from harness.runner.contract import Filter, History, Recorder
from harness.runner.filter_loop import record_first, record_sample, recording_room, run_filter, write_covariance
from harness.runner.simulation_loop import outside


def follow_filter(source, belief, first, limits, rows, kept):
    """Run the estimator over a batch or a recording and keep what it says of every sample.

    Args:
        source: What the reader reads from (``harness.runner.filter_loop``).
        belief: ``harness.engine.kernel_names.Belief``.
        first: ``harness.engine.kernel_names.State`` before the first step.
        limits: Largest magnitude of each state ``(nx,)``.
        rows: Signals of which the covariance is kept ``(m,)``.
        kept: Written for every sample, or for none where they have no room: mean ``(samples, nx)`` and covariance
            ``(samples, nx, nx)`` of the state; signals and their standard deviations ``(samples, ns)`` and the
            covariance of those in ``rows`` ``(samples, m, m)``; and of all but the first sample the innovation
            ``(samples, ny)``, its covariance ``(samples, ny, ny)``, and NIS, measurements used, log-likelihood, repairs
            and whether the state is outside its limits ``(samples, 5)``.
    """
    memories = np.empty(first.memory.shape), np.empty(first.memory.shape)
    run_filter(source, belief, first, memories, (limits, rows, kept))


def room_of_history():
    """Return room for signals, their derivatives and a flag."""
    return np.empty((NS, LANES)), np.empty((NS, NX, LANES)), np.empty((1, LANES))


def begin_history(samples, state, u, belief, room, record):
    """Keep the first state and its signals."""
    s, slopes, _ = room
    _, rows, kept = record
    keep_state(0, state, kept)
    keep_signals(0, state, u, belief, s, slopes, rows, kept)


def add_history(k, state, previous, u_before, u, y, belief, work, info, room, record):
    """Keep one sample."""
    s, slopes, flag = room
    limits, rows, kept = record
    _, _, _, _, _, innovation, spread, facts = kept
    write_covariance(state, work)
    keep_state(k, state, kept)
    keep_signals(k, state, u, belief, s, slopes, rows, kept)
    put(outside(state.mean, limits), flag, 0)
    facts[k, 0], facts[k, 1] = info.nis[0, 0], info.seen[0, 0]
    facts[k, 2], facts[k, 3] = info.log_likelihood[0, 0], info.repairs[0, 0]
    facts[k, 4] = flag[0, 0]
    for a in range(NY):
        innovation[k, a] = info.innovation[a, 0]
        for b in range(NY):
            spread[k, a, b] = info.innovation_covariance[a, b, 0]


def keep_state(k, state, kept):
    """Write mean and covariance of the first lane, where there is room."""
    mean, covariance, _, _, _, _, _, _ = kept
    if mean.shape[0] > 0:
        for i in range(NX):
            mean[k, i] = state.mean[i, 0]
            for j in range(NX):
                covariance[k, i, j] = state.covariance[i, j, 0]


def keep_signals(k, state, u, belief, s, slopes, rows, kept):
    """Write signals of the first lane, standard deviations and the covariance of some, where there is room."""
    _, _, estimate, deviation, covariance, _, _, _ = kept
    if estimate.shape[0] > 0:
        signals(state.mean, u, belief.constants, s)
        signals_jacobian(state.mean, u, belief.constants, slopes)
        for a in range(NS):
            estimate[k, a] = s[a, 0]
            deviation[k, a] = np.sqrt(max(0.0, covariance_of_signals(slopes, state.covariance, a, a)))
        for m in range(rows.shape[0]):
            for n in range(rows.shape[0]):
                covariance[k, m, n] = covariance_of_signals(slopes, state.covariance, rows[m], rows[n])


def covariance_of_signals(slopes, P, a, b):
    """Return the covariance of two signals in the first lane."""
    total = 0.0
    for i in range(NX):
        if slopes[a, i, 0] != 0.0:
            for j in range(NX):
                if slopes[b, j, 0] != 0.0:
                    total += slopes[a, i, 0] * P[i, j, 0] * slopes[b, j, 0]
    return total


HISTORY = {recording_room: room_of_history, record_first: begin_history, record_sample: add_history}
"""Kernels of the recorder of ``follow_filter``."""


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
    recorder: ClassVar[Recorder] = Recorder(follow_filter, HISTORY)

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

    def run(
        self,
        loop: Callable[..., None],
        source: tuple[Any, ...],
        belief: Belief,
        first: State,
        limits: Floats,
        filter_: Filter,
    ) -> History:
        """Run the compiled loop over a batch of one run, or a recording, and return what is kept."""
        history = self.room(len(source[0]), filter_)
        loop(source, belief, first, limits, self.rows, tuple(vars(history).values()))
        return history

    def of(self, history: History, filter_: Filter) -> History:
        """Return what is kept of the first of runs side by side."""
        first = {each.name: getattr(history, each.name)[..., 0].copy() for each in fields(history)}
        if not self.of_state:
            first |= {name: first[name][:0] for name in ("mean", "state_covariance")}
        if len(self.rows) and not first["covariance"].shape[-1]:  # variances alone: what two have in common is unknown
            first["covariance"] = np.full((len(first["deviation"]), len(self.rows), len(self.rows)), np.nan)
            np.einsum("kaa->ka", first["covariance"])[:] = np.square(first["deviation"][:, self.rows])
        return History(**first)
