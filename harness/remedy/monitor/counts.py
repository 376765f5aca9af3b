"""How often a trust monitor is right, by level: errors beyond a limit and what it says of them."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from harness.common.arrays import Floats
from harness.common.statistics import Interval
from harness.remedy.monitor.runs import WatchedRun
from harness.runner.monitor import CONTRADICTED, REASONS, TRUSTED

BINS = np.concatenate([[-np.inf], np.geomspace(1e-3, 1e3, 121), [np.inf]])
"""Edges of evidence, 1 among them, in which samples are counted."""

_RESAMPLES = 500


@dataclass(frozen=True)
class Counts:
    """Samples of the runs of a level and a target, all ``(runs,)`` but where it says so.

    Attributes:
        samples: Of each run.
        wrong: Of them, those with an error beyond the limit.
        counted: Wrong ones of which it is known whether the monitor said so in time.
        said: Of these, those at which it did.
        warned: Wrong ones at which it did not trust the estimate for any reason.
        false: Right ones in an alarm.
        unproven: Right ones at which it did not trust the estimate.
        delay: From the first error to the alarm, in samples; infinite where none follows, NaN without an error.
        alarms: That began in it.
        evidence: Of the right samples, then of the wrong ``(runs, 2, bins)``.
        reasons: Samples at which each was given ``(runs, reasons)``.
    """

    samples: Floats
    wrong: Floats
    counted: Floats
    said: Floats
    warned: Floats
    false: Floats
    unproven: Floats
    delay: Floats
    alarms: Floats
    evidence: Floats
    reasons: Floats

    @property
    def wrong_share(self) -> float:
        """Share of the samples in error."""
        return _ratio(self.wrong, self.samples)

    @property
    def said_share(self) -> float:
        """Share of the samples in error that the monitor speaks of in time; NaN without any."""
        return _ratio(self.said, self.counted)

    @property
    def false_share(self) -> float:
        """Share of the samples without error in an alarm; NaN without any."""
        return _ratio(self.false, self.samples - self.wrong)

    def of_runs(self, chosen: slice) -> Counts:
        """Return those of some runs."""
        return Counts(*(each[chosen] for each in vars(self).values()))


def _ratio(part: Floats, whole: Floats) -> float:
    return float(part.sum() / whole.sum()) if whole.sum() > 0 else float("nan")


def counted(runs: Iterable[WatchedRun], targets: int, within: int, window: int) -> list[Counts]:
    """Count what the monitor says in runs, by target.

    Args:
        runs: Of a level.
        targets: How many.
        within: Samples within which it has to speak of an error.
        window: Samples within which alarms are one.
    """
    rows: list[list[list[object]]] = [[] for _ in range(targets)]
    for run in runs:
        level, bits = run.verdicts[:, 0], run.verdicts[:, 1].astype(int)
        alarmed, distrusted = level == CONTRADICTED, level > TRUSTED
        following, alarms = _following(alarmed), _alarms(alarmed, window)
        reasons = [int((bits & bit > 0).sum()) for bit in REASONS]
        evidence = np.where(np.isnan(run.verdicts[:, 2]), np.inf, run.verdicts[:, 2])
        for t in range(targets):
            wrong = run.wrong[:, t]
            places = np.arange(len(wrong))
            said = wrong & (following <= within)
            known = wrong & (said | (places + within < len(wrong)))
            sides = [np.histogram(evidence[side], BINS)[0] for side in (~wrong, wrong)]
            delay = following[np.argmax(wrong)] if wrong.any() else np.nan
            sums = [known, said, wrong & distrusted, ~wrong & alarmed, ~wrong & distrusted]
            counts = [len(wrong), int(wrong.sum()), *(int(each.sum()) for each in sums)]
            rows[t].append([*counts, delay, alarms, sides, reasons])
    return [Counts(*(np.array(column, dtype=float) for column in zip(*each, strict=True))) for each in rows]


def _following(alarmed: Floats) -> Floats:
    """Return in how many samples the next alarm is, 0 within one, infinite where none follows."""
    places = np.arange(len(alarmed), dtype=float)
    after = np.where(alarmed, places, np.inf)
    return np.minimum.accumulate(after[::-1])[::-1] - places


def _alarms(alarmed: Floats, window: int) -> int:
    """Return how many alarms there are; those closer than a window are one."""
    places = np.flatnonzero(alarmed)
    return 0 if not len(places) else 1 + int((np.diff(places) > window).sum())


def roc(right: Counts, wrong: Counts) -> tuple[Floats, Floats]:
    """Return the share of right samples above each evidence and that of wrong ones, from all to none."""
    sides = right.evidence[:, 0].sum(axis=0), wrong.evidence[:, 1].sum(axis=0)
    above = [np.append(np.cumsum(each[::-1])[::-1], 0.0) / max(each.sum(), 1.0) for each in sides]
    return above[0], above[1]


def area(right: Counts, wrong: Counts, seed: int) -> Interval:
    """Return the area under the curve of ``roc`` with its interval at 95 %, from whole runs drawn with replacement.

    It is the probability that a wrong sample has more evidence than a right one (Hanley and McNeil 1982). NaN where
    there is none of either.
    """
    sides = right.evidence[:, 0], wrong.evidence[:, 1]
    if min(each.sum() for each in sides) == 0:
        return Interval(float("nan"), float("nan"), float("nan"))
    drawn, generator = [], np.random.default_rng(seed)
    for each in sides:
        weights = generator.multinomial(len(each), np.full(len(each), 1.0 / len(each)), _RESAMPLES)
        drawn.append(np.concatenate([each.sum(axis=0)[None], weights @ each]))
    areas = _areas(*drawn)
    low, high = np.nanquantile(areas[1:], [0.025, 0.975])
    return Interval(float(areas[0]), float(low), float(high))


def _areas(right: Floats, wrong: Floats) -> Floats:
    """Return areas of histograms ``(n, bins)``, equals counted half."""
    below = np.cumsum(right, axis=1) - right
    with np.errstate(invalid="ignore", divide="ignore"):
        areas: Floats = (wrong * (below + 0.5 * right)).sum(axis=1) / (right.sum(axis=1) * wrong.sum(axis=1))
    return areas


def per_hour(counts: Counts, step: float) -> tuple[Interval, int, float]:
    """Return alarms in an hour with their interval at 95 % (Garwood 1936), how many there were, and the hours."""
    from scipy.stats import chi2

    alarms, hours = int(counts.alarms.sum()), float(counts.samples.sum()) * step / 3600.0
    if not hours:
        return Interval(float("nan"), float("nan"), float("nan")), 0, 0.0
    low = chi2.ppf(0.025, 2 * alarms) / 2.0 if alarms else 0.0
    high = chi2.ppf(0.975, 2 * alarms + 2) / 2.0
    return Interval(alarms / hours, float(low) / hours, float(high) / hours), alarms, hours


def joined(parts: Sequence[Counts]) -> Counts:
    """Return the counts of all runs."""
    return Counts(*(np.concatenate(each) for each in zip(*(vars(p).values() for p in parts), strict=True)))
