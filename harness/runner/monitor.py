"""Trust monitor of a filter: windowed statistics of its innovations against bounds, and the envelope of a study.

Windows are exponential: an average over the last ``n`` samples gives a new one the weight ``a = 2 / (n + 1)``, and that
of independent numbers of unit variance has the variance ``a / (2 - a)`` (Roberts 1959, doi
10.1080/00401706.1959.10489860). So the memory is one number for each statistic. The normalised innovation squared of
``m`` measurements has mean ``m`` and variance ``2 m`` where the filter is right, each innovation over its standard
deviation mean 0 and variance 1 (Bar-Shalom, Li and Kirubarajan 2001, 5.4).

The kernels below run over the batches of a study and are printed to C next to an estimator by
``harness.realtime.export``.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from harness.common.arrays import Floats
from harness.engine.kernel_names import (
    LANES,
    NS,
    NU,
    NY,
    Belief,
    Info,
    State,
    absolute,
    get,
    maximum,
    minimum,
    put,
    select,
    signals,
    splat,
    sqrt,
)
from harness.runner.contract import Filter, History, Recorder
from harness.runner.filter_loop import record_first, record_sample, recording_room, run_filter
from harness.runner.simulation_loop import outside

TRUSTED, UNPROVEN, CONTRADICTED = 0, 1, 2
"""Levels of trust: all as studied; outside what was studied; not as believed."""

REASONS = {
    1: "NIS above its bound: measurements further from their predictions than stated",
    2: "NIS below its bound: nearer than stated",
    4: "bias: innovations of a measurement keep to one side",
    8: "state outside: beyond what the equations hold for, or no number; begin anew",
    16: "beyond the study: input, its rate, measurement or estimate",
    32: "few measurements within the window, as behind a beginning",
    64: "other parameters than those that the study believed",
}
"""Of a level that is not 0, by bit: up to 8 they make it 2, the others 1."""

REASON_NAMES = (
    "NIS_ABOVE", "NIS_BELOW", "BIASED", "OUTSIDE", "BEYOND_STUDY", "FEW_MEASUREMENTS", "OTHER_PARAMETERS",
)  # fmt: skip
"""Of ``REASONS``, in C."""

LARGEST = 100.0
"""Most that a single sample counts in an average, in standard deviations: what is infinite would never be forgotten."""


class Bounds(NamedTuple):
    """Against what a monitor holds its statistics.

    Attributes:
        numbers: Weight of a new sample, root of ``(2 - a) / a``, lower and upper bound of the NIS in standard
            deviations of its average, and the least share of samples with a measurement ``(5,)``.
        bias: Of each measurement, in standard deviations of its average ``(ny,)``.
        lowest, highest: Of inputs, rates of inputs per sample, measurements, and estimates ``(2 nu + ny + ns,)``.
    """

    numbers: Any
    bias: Any
    lowest: Any
    highest: Any


def bounds_of(
    window: int, nis: tuple[float, float], bias: Sequence[float], presence: float, lowest: Floats, highest: Floats
) -> Bounds:
    """Return bounds; ``window`` counts samples, the others are as in ``Bounds``."""
    weight = 2.0 / (window + 1.0)
    numbers = np.array([weight, np.sqrt((2.0 - weight) / weight), *nis, presence])
    return Bounds(numbers, np.array(bias, dtype=float), lowest, highest)


def size_of_monitor(nu: int, ny: int) -> int:
    """Return how many numbers ``watch`` carries from sample to sample."""
    return 4 + ny + nu


def begin_watch(held):
    """Begin a run ``(4 + ny + nu, LANES)``."""
    for i in range(held.shape[0]):
        put(splat(0.0), held, i)


def compare_parameters(p, believed, held):
    """Note whether parameters are those that the study believed.

    Args:
        p: Parameters ``(1, np, LANES)``.
        believed: Those of the study ``(np,)``.
        held: As in ``watch``, written.
    """
    differs = splat(0.0)
    for i in range(believed.shape[0]):
        apart = absolute(get(p, 0, i) - believed[i])
        differs = select(apart <= 1e-6 * absolute(believed[i]), differs, 1.0)
    put(differs, held, 3 + NY)


def watch(u, y, info, s, beyond, bounds, held, verdict):
    """Take one sample, whether or not it has measurements.

    Args:
        u: Inputs ``(nu, LANES)``.
        y: Measurements ``(ny, LANES)``.
        info: ``harness.engine.kernel_names.Info`` of the step.
        s: Estimated signals ``(ns, LANES)``.
        beyond: 1 where the state is beyond its limits ``(1, LANES)``.
        bounds: ``Bounds``.
        held: Averages of the NIS and of each innovation, the share of samples with a measurement, whether there was a
            sample, whether parameters are others, and the inputs before, overwritten ``(4 + ny + nu, LANES)``.
        verdict: Written ``(3, LANES)``: level of trust, reasons, and the largest of the statistics over their bounds.
    """
    weight, spread = bounds.numbers[0], bounds.numbers[1]
    seen, nis = get(info.seen, 0), get(info.nis, 0)
    there = (seen > 0.0) & (nis == nis)
    excess = minimum((nis - seen) / sqrt(2.0 * maximum(seen, 1.0)), LARGEST)
    put(get(held, 0) + weight * select(there, excess - get(held, 0), 0.0), held, 0)
    put(get(held, 1 + NY) + weight * (select(there, 1.0, 0.0) - get(held, 1 + NY)), held, 1 + NY)
    z = spread * get(held, 0)
    high, low = z / bounds.numbers[3], z / bounds.numbers[2]
    evidence = maximum(high, low)
    reasons = select(high > 1.0, 1.0, 0.0) + select(low > 1.0, 2.0, 0.0)
    biased, strange = splat(0.0), splat(0.0)
    for a in range(NY):
        variance = get(info.innovation_covariance, a, a)
        innovation = get(info.innovation, a)
        measured = (variance > 0.0) & (innovation == innovation) & there
        ratio = maximum(minimum(innovation / sqrt(variance), LARGEST), -LARGEST)
        put(get(held, 1 + a) + weight * select(measured, ratio - get(held, 1 + a), 0.0), held, 1 + a)
        share = absolute(spread * get(held, 1 + a)) / bounds.bias[a]
        biased = select(share > 1.0, 1.0, biased)
        evidence = maximum(evidence, share)
        row = 2 * NU + a
        inside = (get(y, a) >= bounds.lowest[row]) & (get(y, a) <= bounds.highest[row])
        strange = select(inside | ~measured, strange, 1.0)
    begun = get(held, 2 + NY) > 0.0
    for i in range(NU):
        now, rate = get(u, i), get(u, i) - get(held, 4 + NY + i)
        inside = (now >= bounds.lowest[i]) & (now <= bounds.highest[i])
        steady = (rate >= bounds.lowest[NU + i]) & (rate <= bounds.highest[NU + i])
        strange = select(inside & (steady | ~begun), strange, 1.0)
        put(now, held, 4 + NY + i)
    put(splat(1.0), held, 2 + NY)
    for a in range(NS):
        row = 2 * NU + NY + a
        inside = (get(s, a) >= bounds.lowest[row]) & (get(s, a) <= bounds.highest[row])
        strange = select(inside, strange, 1.0)
    gone = get(beyond, 0) > 0.0
    contradicted = (reasons + biased > 0.0) | gone
    few = get(held, 1 + NY) < bounds.numbers[4]
    others = get(held, 3 + NY) > 0.0
    unproven = (strange > 0.0) | few | others
    reasons = reasons + 4.0 * biased + select(gone, 8.0, 0.0)
    reasons = reasons + 16.0 * strange + select(few, 32.0, 0.0) + select(others, 64.0, 0.0)
    put(select(contradicted, 2.0, select(unproven, 1.0, 0.0)), verdict, 0)
    put(reasons, verdict, 1)
    put(evidence, verdict, 2)


def watch_filter(source, belief, first, limits, bounds, kept):
    """Run an estimator over a batch, and keep what it estimates and what the monitor says of every sample.

    Args:
        source: What the reader reads from (``harness.runner.filter_loop``).
        belief: ``harness.engine.kernel_names.Belief``.
        first: ``harness.engine.kernel_names.State`` before the first step.
        limits: Largest magnitude of each state ``(nx,)``.
        bounds: ``Bounds``.
        kept: Written: signals ``(samples, ns, LANES)``, statistics of NIS and innovations in standard deviations of
            their averages ``(samples, 1 + ny, LANES)``, and level, reasons and evidence ``(samples, 3, LANES)``.
    """
    memories = np.empty(first.memory.shape), np.empty(first.memory.shape)
    run_filter(source, belief, first, memories, (limits, bounds, kept))


def room_of_monitor():
    """Return room for signals, a flag, what the monitor holds, and of a sample that has no measurement."""
    row = np.zeros((4, LANES))
    row[0] = np.nan
    info = Info(np.zeros((NY, LANES)), np.zeros((NY, NY, LANES)), row[0:1], row[1:2], row[2:3], row[3:4])
    return np.empty((NS, LANES)), np.zeros((1, LANES)), np.zeros((4 + NY + NU, LANES)), np.zeros((NY, LANES)), info


def begin_monitor(samples, state, u, belief, room, record):
    """Begin to watch at the first sample, which has no measurement."""
    _, _, held, y, info = room
    begin_watch(held)
    keep_watched(0, state, u, y, belief, info, room, record)


def add_monitor(k, state, previous, u_before, u, y, belief, work, info, room, record):
    """Watch one sample."""
    keep_watched(k, state, u, y, belief, info, room, record)


def keep_watched(k, state, u, y, belief, info, room, record):
    """Watch one sample and keep what comes of it."""
    s, flag, held, _, _ = room
    limits, bounds, kept = record
    estimates, statistics, verdicts = kept
    put(outside(state.mean, limits), flag, 0)
    signals(state.mean, u, belief.constants, s)
    watch(u, y, info, s, flag, bounds, held, verdicts[k])
    for a in range(1 + NY):
        put(bounds.numbers[1] * get(held, a), statistics, k, a)
    for a in range(NS):
        put(get(s, a), estimates, k, a)


MONITOR = {recording_room: room_of_monitor, record_first: begin_monitor, record_sample: add_monitor}
"""Kernels of the recorder of ``watch_filter``."""


class Watched(NamedTuple):
    """What came of runs of a batch; all end in ``LANES``.

    Attributes:
        estimates: Signals ``(samples, ns, LANES)``.
        statistics: Of NIS and innovations, in standard deviations of their averages ``(samples, 1 + ny, LANES)``.
        verdicts: Level of trust, reasons, and largest statistic over its bound ``(samples, 3, LANES)``.
    """

    estimates: Floats
    statistics: Floats
    verdicts: Floats


@dataclass(frozen=True)
class Watching:
    """A monitor as what is recorded of a filter over a batch.

    Attributes:
        bounds: Of the monitor.
    """

    bounds: Bounds
    recorder: ClassVar[Recorder] = Recorder(watch_filter, MONITOR)

    def run(
        self,
        loop: Callable[..., None],
        source: tuple[Any, ...],
        belief: Belief,
        first: State,
        limits: Floats,
        filter_: Filter,
    ) -> Watched:
        """Run the compiled loop over a batch and return what the monitor says."""
        samples, outputs = len(source[0]), len(filter_.ports.outputs)
        sizes = len(filter_.signals), 1 + outputs, 3
        kept = Watched(*(np.empty((samples, size, LANES)) for size in sizes))
        loop(source, belief, first, limits, self.bounds, tuple(kept))
        return kept

    def of(self, history: History, filter_: Filter) -> Watched:
        """Refuse: a monitor is generated with the kernels of a filter.

        Raises:
            TypeError: Always.
        """
        raise TypeError(f"{type(filter_).__name__} is no kernel, and a monitor watches kernels")
