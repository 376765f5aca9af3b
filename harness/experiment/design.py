"""Search for drives: each manoeuvre's free quantities by a pattern search, and a sequence of them by greedy choice."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from functools import cached_property, partial

import numpy as np
from scipy.stats import qmc

from harness.common.arrays import Floats
from harness.config import DriveSpec
from harness.experiment.contract import Evidence, Goal, total
from harness.experiment.kept_drives import KeptDrives
from harness.experiment.manoeuvres import Manoeuvre, SearchRange
from harness.experiment.rehearsal import Rehearsal, Rehearsed
from harness.models.contracts import Profile

_FIRST = 8
"""Points of the unit cube that a search begins with."""

_EASED = 0.25
"""By how much of the way from the gentlest to the hardest a drive is eased that passes a limit."""

_EASED_LITTLE = 0.01
"""The same of a drive that may be like another one, which just keeps to the limits; each time twice as much."""

_EASINGS = 5
_REACH, _CLOSER = 0.25, 0.6
"""Standard deviation of the first steps about the best point, and by how much those of each later round are shorter."""

_FARTHER, _NEARER = 1.2, 0.75
"""The same of a drive of many free quantities: behind a round that has found a better one, and behind one that has not
(as by the success rule of evolution strategies; Beyer and Schwefel 2002, doi 10.1023/A:1015059928466)."""

_FEW = 4
"""Free quantities up to which each is changed as far; of more all together are changed as far as of these."""

_IMITATED = 4
"""Drives of other manoeuvres, the best, that a free one begins with."""

_BATCH = 4
_BUDGET = "budget"


@dataclass(frozen=True)
class TriedDrive:
    """A drive that keeps to the limits, and what it tells.

    Attributes:
        manoeuvre: Its manoeuvre.
        duration: Of one turn in s.
        evidence: What it tells, driven once.
        times: How often it is driven: until nothing is left to be driven for, or the budget is spent.
        value: The criterion behind that.
        preference: What decides between drives that settle as much, or not all.
        settles: Whether nothing is left to be driven for then.
        rehearse: Returns the drive as it was rehearsed.
    """

    manoeuvre: Manoeuvre
    duration: float
    evidence: Evidence
    times: int
    value: float
    preference: float
    settles: bool
    rehearse: Callable[[], Rehearsed]

    @cached_property
    def rehearsed(self) -> Rehearsed:
        """The drive."""
        return self.rehearse()

    @property
    def seconds(self) -> float:
        """Duration of all its turns in s."""
        return self.times * self.duration

    @property
    def rank(self) -> tuple[float, float]:
        """The smaller the better: the sooner all is settled, and then what is preferred."""
        return self.seconds if self.settles else math.inf, self.preference


@dataclass(frozen=True)
class DrivePlan:
    """Drives of a budget.

    Attributes:
        ranked: The best of each manoeuvre, repeated alone, the best first.
        sequence: Drives, each with how often it is driven; none where no drive tells more than is known now.
        evidence: What the sequence tells.
        value: The criterion behind it.
        refused: Of each manoeuvre without a drive, which limits its drives pass.
        tried: Number of drives that were rehearsed.
    """

    ranked: tuple[TriedDrive, ...]
    sequence: tuple[tuple[TriedDrive, int], ...]
    evidence: Evidence | None
    value: float
    refused: dict[str, str]
    tried: int

    @property
    def seconds(self) -> float:
        """Duration of the sequence in s."""
        return sum(t.duration * times for t, times in self.sequence)


def design(
    goal: Goal,
    rehearsal: Rehearsal,
    room: SearchRange,
    manoeuvres: Sequence[Manoeuvre],
    budget: float,
    effort: int,
    jobs: int = 2,
    seed: int = 0,
    say: Callable[[str], None] = lambda _: None,
    kept: KeptDrives | None = None,
) -> DrivePlan:
    """Return the drives that tell most within a budget of seconds.

    Args:
        goal: What is to be found out.
        rehearsal: Simulates drives, and refuses those that pass a limit.
        room: Of the free quantities.
        manoeuvres: To choose from.
        budget: s of driving.
        effort: Drives that are tried of each manoeuvre.
        jobs: Threads.
        seed: Of the points tried.
        say: Takes a line on what is being done.
        kept: What an interrupted design has tried, and this one tries.
    """
    pool: list[TriedDrive] = []
    refused, count = {}, 0
    trial = _Trial(goal, rehearsal, budget, kept or KeptDrives())
    with ThreadPoolExecutor(jobs) as threads:
        for number, manoeuvre in enumerate(sorted(manoeuvres, key=lambda m: m.like is not None), 1):
            say(f"manoeuvre {number} of {len(manoeuvres)}: {manoeuvre.name}")
            search = _Search(trial, room, manoeuvre)
            models = [] if manoeuvre.like is None else [t.rehearsed.profile for t in _best(pool)[:_IMITATED]]
            search.run(effort, np.random.default_rng([seed, number]), lambda f, xs: list(threads.map(f, xs)), models)
            pool += search.tried if goal.surrogate is None else _finalists(search.tried)
            count += search.rehearsed
            if not search.tried:
                refused[manoeuvre.name] = ", ".join(sorted(search.reasons))
        if goal.surrogate is not None:
            say(f"judging the best {len(pool)} in full")
            pool = list(threads.map(trial.in_full, pool))
    ranked = tuple(_best(pool))
    sequence = greedy(goal, pool, budget)
    evidence = total([(t.evidence, times) for t, times in sequence]) if sequence else None
    seconds = sum(t.duration * times for t, times in sequence)
    settled = goal.value(evidence) <= goal.enough
    if ranked and not (seconds if settled else math.inf, goal.preference(evidence)) < ranked[0].rank:
        sequence = ((ranked[0], ranked[0].times),)
        evidence = total([(ranked[0].evidence, ranked[0].times)])
    if not goal.preference(evidence) < goal.preference(None):  # it would not tell more than is known now
        sequence, evidence = (), None
    return DrivePlan(ranked, sequence, evidence, goal.value(evidence), refused, count)


def _finalists(tried: Sequence[TriedDrive]) -> list[TriedDrive]:
    """Return the drives of a manoeuvre that are judged in full: the first one, and the one that is preferred.

    These differ where a surrogate, which may promise too much, takes all for settled by a shorter drive.
    """
    if not tried:
        return []
    first, preferred = min(tried, key=lambda t: t.rank), min(tried, key=lambda t: t.preference)
    return [first] if first is preferred else [first, preferred]


def _best(pool: Sequence[TriedDrive]) -> list[TriedDrive]:
    """Return the best drive of each manoeuvre, the best first."""
    by_manoeuvre: dict[str, TriedDrive] = {}
    for tried in sorted(pool, key=lambda t: t.rank):
        by_manoeuvre.setdefault(tried.manoeuvre.name, tried)
    return list(by_manoeuvre.values())


def greedy(goal: Goal, pool: Sequence[TriedDrive], budget: float) -> tuple[tuple[TriedDrive, int], ...]:
    """Return drives of a budget, each time the one with the largest gain per second, with how often each is driven.

    They end where nothing is left to be driven for. Where nothing is preferred yet, the one that is so alone begins.
    """
    taken: dict[int, int] = {}
    evidence: Evidence | None = None
    spent, preference = 0.0, goal.preference(None)
    while goal.value(evidence) > goal.enough and (
        fit := [i for i, t in enumerate(pool) if spent + goal.turns * t.duration <= budget + 1e-9]
    ):
        after = [
            goal.preference(total([(pool[i].evidence, goal.turns), *([(evidence, 1)] if evidence else [])]))
            for i in fit
        ]
        if math.isfinite(preference):
            gains = [(preference - a) / pool[i].duration for i, a in zip(fit, after, strict=True)]
            k = int(np.argmax(gains))
            if not gains[k] > 0:
                break
        else:
            k = int(np.argmin([a if math.isfinite(a) else pool[i].preference for i, a in zip(fit, after, strict=True)]))
        i = fit[k]
        taken[i] = taken.get(i, 0) + goal.turns
        evidence = total([(pool[i].evidence, goal.turns), *([(evidence, 1)] if evidence else [])])
        spent, preference = spent + goal.turns * pool[i].duration, after[k]
    return tuple((pool[i], times) for i, times in taken.items())


@dataclass(frozen=True)
class _Trial:
    """Drives driven until all is settled or the budget is spent.

    Attributes:
        goal: What is to be found out.
        rehearsal: Simulates them.
        budget: s of driving.
        kept: What was tried before.
    """

    goal: Goal
    rehearsal: Rehearsal
    budget: float
    kept: KeptDrives

    def of(self, manoeuvre: Manoeuvre, drive: DriveSpec, in_full: bool) -> TriedDrive | str:
        """Return a drive with what it tells, or what it passes.

        Args:
            manoeuvre: Its manoeuvre.
            drive: The drive.
            in_full: Whether by the evidence in place of a surrogate.
        """
        surrogate = None if in_full else self.goal.surrogate
        rehearse: Callable[[], Rehearsed] = partial(self.rehearsal.again, drive)
        outcome = self.kept.read(drive, surrogate is None)
        if outcome is None:
            rehearsed = self.rehearsal.of(drive)
            if isinstance(rehearsed, str):
                outcome = rehearsed
            elif rehearsed.seconds * self.goal.turns > self.budget + 1e-9:
                return _BUDGET
            else:
                evidence = (surrogate or self.goal.evidence)(rehearsed)
                outcome, rehearse = (rehearsed.seconds, evidence), lambda: rehearsed
            self.kept.write(drive, surrogate is None, outcome)
        if isinstance(outcome, str):
            return outcome
        duration, evidence = outcome
        turns, enough, most = self.goal.turns, self.goal.enough, int(self.budget / duration + 1e-9)
        if most < turns:
            return _BUDGET
        most -= most % turns
        for times in range(turns if math.isfinite(enough) else most, most + 1, turns):
            repeated = total([(evidence, times)])
            value = self.goal.value(repeated)
            if value <= enough:
                break
        preference = self.goal.preference(repeated)
        return TriedDrive(manoeuvre, duration, evidence, times, value, preference, value <= enough, rehearse)

    def in_full(self, tried: TriedDrive) -> TriedDrive:
        """Return a drive that a surrogate was taken for, with what it tells."""
        outcome = self.of(tried.manoeuvre, tried.rehearsed.drive, in_full=True)
        assert isinstance(outcome, TriedDrive), outcome
        return outcome


class _Search:
    """The search of one manoeuvre."""

    def __init__(self, trial: _Trial, room: SearchRange, manoeuvre: Manoeuvre) -> None:
        self.trial, self.room, self.manoeuvre, self.rehearsed = trial, room, manoeuvre, 0
        self.tried: list[TriedDrive] = []
        self.reasons: set[str] = set()

    def run(
        self,
        effort: int,
        random: np.random.Generator,
        share: Callable[
            [Callable[[Floats], tuple[Floats, TriedDrive | str]], list[Floats]], list[tuple[Floats, TriedDrive | str]]
        ],
        models: Sequence[Profile] = (),
    ) -> None:
        """Try drives like others, points of the unit cube, then points about the best, closer from round to round.

        Where the best settles all, it is tried once more as short as a recording may be.
        """
        free, like = self.manoeuvre.free, self.manoeuvre.like
        first = [] if like is None else [point for profile in models for point in like(profile, self.room)]
        cube = [*first, *qmc.Sobol(free, rng=random).random(_FIRST)[len(first) :]]
        points, reach, best = cube[:effort], _REACH * min(1.0, math.sqrt(_FEW / free)), None
        spent = 0
        while points:
            spent += len(points)
            before = None if best is None else best[0]
            for point, result in share(lambda p: self._at(p, self.room), points):
                if isinstance(result, str):
                    self.reasons.add(result)
                    continue
                self.tried.append(result)
                best = (point, result.rank) if best is None or result.rank < best[1] else best
            if best is None:
                return
            count = min(_BATCH, effort - spent)
            points = [np.clip(best[0] + reach * random.standard_normal(free), 0.0, 1.0) for _ in range(count)]
            reach *= _CLOSER if like is None else _FARTHER if best[0] is not before else _NEARER
        if best is not None and math.isfinite(best[1][0]):
            shortest = replace(self.room, limits=replace(self.room.limits, duration=self.room.shortest))
            _, result = self._at(best[0], shortest)
            self.tried += [] if isinstance(result, str) else [result]

    def _at(self, point: Floats, room: SearchRange) -> tuple[Floats, TriedDrive | str]:
        """Return the drive at a point, or at a gentler one where it passes a limit, or which it passes at last."""
        point = point.copy()
        eased = _EASED if self.manoeuvre.like is None else _EASED_LITTLE
        reason = _BUDGET
        for _ in range(_EASINGS):
            self.rehearsed += 1
            drive = self.manoeuvre.drive(point, room, self.manoeuvre.name)
            result = self.trial.of(self.manoeuvre, drive, in_full=False)
            if not isinstance(result, str) or result == _BUDGET:
                return point, result
            reason = result
            if point[0] <= 0.0:
                break
            point[0] = max(0.0, point[0] - eased)
            eased *= 1.0 if self.manoeuvre.like is None else 2.0
        return point, reason
