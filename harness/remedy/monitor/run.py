"""A trust monitor for an estimator of a study: calibrated on runs as believed, counted on others and on the designs."""

from __future__ import annotations

import dataclasses
import itertools
import math
import os
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.config import StudySpec
from harness.config.specs import MonitorSpec
from harness.engine.simd.lanes import LANES
from harness.realtime.export.monitor import Monitor
from harness.remedy.monitor.answer import sentences
from harness.remedy.monitor.bounds import Calibrated, calibrated, peaks
from harness.remedy.monitor.counts import Counts, area, counted, joined
from harness.remedy.monitor.outcome import Counted, Level
from harness.remedy.monitor.runs import WatchedRun, Watcher
from harness.remedy.monitor.sensors import Shares, parameter_information
from harness.runner.monitor import Bounds, bounds_of
from harness.study.design import Unit

ENOUGH = 10
"""Alarms that are allowed in the hours of a round of runs as believed."""

FEW = 5
"""Alarms that are allowed in the hours within the limits, below which another round is driven."""

ROUNDS = 8
"""Most rounds."""

MARGIN = 0.01
"""Of its width by which an envelope is wider than what was driven, to either side, so that no rounding decides."""

FEW_HOURS = 0.1
"""Hours within the limits below which there is nothing to calibrate on."""


@dataclass(frozen=True)
class _Envelope:
    """What calibration keeps: runs of each drive; of those within limits hours, peaks, range of values, presence."""

    runs: int
    hours: float
    peaks: list[Floats]
    lowest: Floats
    highest: Floats
    presence: float
    kept: tuple[str, ...]


def count_monitor(
    study: StudySpec,
    asked: MonitorSpec,
    estimator: str | None = None,
    jobs: int | None = None,
    say: Callable[[str], None] = lambda _: None,
    computed: Shares | None = None,
) -> Counted:
    """Calibrate a monitor and count its alarms.

    Args:
        study: The study.
        asked: What it is to be.
        estimator: Name of an estimator; the first by default.
        jobs: Worker threads; by default one per core.
        say: Informed of what is going on.
        computed: What was computed with other estimators of the study already, added to.

    Raises:
        UserError: If there is no such estimator, no limit, or no run as believed that keeps the limits.
    """
    if not asked.limits:
        raise UserError(
            f"study '{study.name}' has no [limits], so that no error counts as one: state one for a target there, or "
            f'with --limit, such as --limit {study.targets[0]}="..."'
        )
    for name, limit in asked.limits.items():
        check_target(study, name)
        if not limit > 0.0:
            raise UserError(f"--limit {name}: give an error above zero, not {limit:g}")
    say("building models and drives")
    lengths = _lengths(study)
    step, window = study.belief.step, window_of(study, asked)
    watcher = Watcher(study, estimator, asked.limits, _repeats(lengths, asked))
    with ThreadPoolExecutor(jobs or os.cpu_count()) as pool:
        say("calibrating on runs as believed")
        envelope = _calibrate(watcher, pool, window, asked.per_hour)
        bounds = calibrated(envelope.peaks, asked.per_hour, envelope.hours)
        monitor = _monitor(watcher, envelope, bounds, window)
        kept, believed = _as_believed(watcher, monitor.bounds, pool, asked, window, envelope.runs)
        levels = []
        for index, design in enumerate(watcher.study.designs[1:], 1):
            for band, label in enumerate(design.band_labels):
                say(f"counting design '{design.name}', {label}")
                runs = _level(watcher, index, band, monitor.bounds, pool, asked.runs)
                counts = counted(runs, len(watcher.targets), round(asked.within / step), window)
                areas = [area(right, wrong, study.seed) for right, wrong in zip(believed, counts, strict=True)]
                levels.append(Level(design.name, label, tuple(counts), tuple(areas)))
    blind = any(level.is_blind(t) for level in levels for t in range(len(watcher.targets)))
    shares: Shares = {} if computed is None else computed
    if blind:
        say("what measurements tell of the parameters")
    shown = tuple(parameter_information(study, watcher.study.estimators[0].name, shares)) if blind else ()
    drives = tuple(d.name for d in study.drives)
    of_drives = envelope.kept, tuple(d for d in drives if d not in envelope.kept)
    result = Counted(
        watcher.study, asked, monitor, watcher.targets, bounds, tuple(kept), tuple(believed), tuple(levels), shown,
        of_drives,
    )  # fmt: skip
    return dataclasses.replace(result, monitor=dataclasses.replace(monitor, says=sentences(result)))


def window_of(study: StudySpec, asked: MonitorSpec) -> int:
    """Return the samples of a window.

    Raises:
        UserError: If it is shorter than two samples, or longer than any drive is scored.
    """
    step, longest = study.belief.step, max(_lengths(study)) - study.score_after
    if asked.window > longest:
        raise UserError(
            f"a monitor's window of {asked.window:g} s: no drive of study '{study.name}' is scored for longer than "
            f"{longest:g} s; take a shorter one"
        )
    if round(asked.window / step) < 2:
        raise UserError(
            f"a monitor's window of {asked.window:g} s holds no two samples of {step:g} s; take a longer one"
        )
    return round(asked.window / step)


def check_target(study: StudySpec, name: str) -> None:
    """Refuse a limit of what the study has no target of.

    Raises:
        UserError: If it has none of that name.
    """
    if name not in study.targets:
        raise UserError(f"--limit {name}: study '{study.name}' has no such target{closest(name, study.targets)}")


def _lengths(study: StudySpec) -> list[float]:
    """Return how long each drive is, in s."""
    from harness.simulation.drives import profile_of

    return [float(profile_of(study.plant, drive).time[-1]) for drive in study.drives]


def _repeats(lengths: Sequence[float], asked: MonitorSpec) -> int:
    """Return how many runs of each drive as believed there may be: two parts, each of rounds of some alarms allowed."""
    each = max(ENOUGH / asked.per_hour / (sum(lengths) / 3600.0), LANES)
    return 2 * ROUNDS * LANES * math.ceil(each / LANES)


def _calibrate(watcher: Watcher, pool: ThreadPoolExecutor, window: int, per_hour: float) -> _Envelope:
    """Watch runs that are as believed, round by round, and keep what those within their limits reach."""
    ports = watcher.estimator.ports
    nu, ny = len(ports.inputs), len(ports.outputs)
    wide = np.full(2 * nu + ny + len(watcher.estimator.signals), np.inf)
    loose = bounds_of(window, (-1.0, 1.0), [1.0] * ny, 0.0, -wide, wide)
    lowest, highest, kept, reached = wide, -wide, [], []
    hour, each = 3600.0 / watcher.study.belief.step, watcher.study.designs[0].repeats // (2 * ROUNDS)
    there = samples = rounds = 0
    while rounds == 0 or (0 < samples < FEW / per_hour * hour and rounds < ROUNDS):
        for d, drive in enumerate(watcher.study.drives):
            for run in watcher.runs(Unit(0, 0, d, 0, 1, rounds * each, (rounds + 1) * each), loose, pool):
                if not len(run.wrong) or run.wrong.any():
                    continue
                kept.append(drive.name)
                reached.append(peaks(run.statistics, window))
                lowest = np.fmin(lowest, np.fmin.reduce(run.seen, axis=0))
                highest = np.fmax(highest, np.fmax.reduce(run.seen, axis=0))
                there += int((~np.isnan(run.seen[:, 2 * nu : 2 * nu + ny])).any(axis=1).sum())
                samples += len(run.seen)
        rounds += 1
    if samples < FEW_HOURS * hour or not there:
        limits = ", ".join(watcher.targets)
        raise UserError(
            f"estimator '{watcher.study.estimators[0].name}' keeps the limits of {limits} in {len(kept)} of "
            f"{rounds * each * len(watcher.study.drives)} runs as believed: there is nothing that a "
            "monitor could be calibrated on; state larger limits, or drives that it manages"
        )
    return _Envelope(
        rounds * each, samples / hour, reached, lowest, highest, 0.5 * there / samples, tuple(dict.fromkeys(kept))
    )


def _monitor(watcher: Watcher, envelope: _Envelope, bounds: Calibrated, window: int) -> Monitor:
    ports, step = watcher.estimator.ports, watcher.study.belief.step
    groups = ports.inputs, ports.inputs, ports.outputs, watcher.estimator.signals
    names, nu = [name for group in groups for name in group], len(ports.inputs)
    scale = np.array([1.0 / step if nu <= i < 2 * nu else 1.0 for i in range(len(names))])
    margin = MARGIN * (envelope.highest - envelope.lowest)
    lowest, highest = (envelope.lowest - margin) * scale, (envelope.highest + margin) * scale
    ranges = [(float(a), float(b)) for a, b in zip(lowest, highest, strict=True)]
    ends = np.cumsum([0, *map(len, groups)])
    inputs, rates, measurements, estimates = (
        dict(zip(names[a:b], ranges[a:b], strict=True)) for a, b in itertools.pairwise(ends)
    )
    return Monitor(
        study=watcher.study.hash,
        estimator=watcher.study.estimators[0].name,
        step=step,
        window=window,
        presence=envelope.presence,
        nis=bounds.nis,
        bias=dict(zip(ports.outputs, bounds.bias, strict=True)),
        inputs=inputs,
        rates=rates,
        measurements=measurements,
        estimates=estimates,
        says=(),
    )


def _as_believed(
    watcher: Watcher, bounds: Bounds, pool: ThreadPoolExecutor, asked: MonitorSpec, window: int, runs: int
) -> tuple[list[Counts], list[Counts]]:
    """Count as many further runs that are as believed: those within their limits, and all."""
    targets, within = len(watcher.targets), round(asked.within / watcher.study.belief.step)
    parts, inside = [], []
    for d in range(len(watcher.study.drives)):
        for run in watcher.runs(Unit(0, 0, d, 0, 1, runs, 2 * runs), bounds, pool):
            parts.append(counted([run], targets, within, window))
            inside.append(not run.wrong.any())
    both = []
    for chosen in ([p for p, kept in zip(parts, inside, strict=True) if kept], parts):
        both.append([joined([part[t] for part in chosen]) for t in range(targets)] if chosen else [])
    return both[0], both[1]


def _level(
    watcher: Watcher, design: int, band: int, bounds: Bounds, pool: ThreadPoolExecutor, most: int
) -> Iterator[WatchedRun]:
    for d in range(len(watcher.study.drives)):
        yield from watcher.runs(Unit(design, band, d, 0, watcher.study.designs[design].samples), bounds, pool, most)
