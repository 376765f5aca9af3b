"""Standing of the estimators over all designs of a study, by target."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from harness.common.arrays import Floats
from harness.study.report.analysis import Findings
from harness.study.results import Design

ALIKE = 0.03
"""Share by which errors may differ that are said in one number."""


@dataclass(frozen=True)
class Standing:
    """What the estimators of a study bear of one target.

    Attributes:
        designs: Those by level, and those over a box, which are a single level.
        target: Index of the target.
        limit: Largest tolerable RMSE in report units; ``None`` without one.
    """

    designs: Sequence[Findings]
    target: int
    limit: float | None

    @cached_property
    def area(self) -> Floats:
        """Area under the median error over the deviation by the width of its range, ``(design, estimator)``.

        Of a design of one factor by trapezoids over its levels, else the mean over its levels. Levels at which every
        estimator diverges in most runs, or none has any, tell none from another and are left out.
        """
        return np.array([self._area(f.design, f.medians[self.target]) for f in self.designs])

    @staticmethod
    def _area(design: Design, medians: Floats) -> Floats:
        used = np.isfinite(medians).any(axis=1)
        if not used.any():
            return np.full(medians.shape[1], np.nan)
        if len(design.factors) != 1 or used.sum() == 1:
            return np.asarray(medians[used].mean(axis=0))
        centres = (design.factors[0].lower + design.factors[0].upper)[used] / 2
        order = np.argsort(centres, kind="stable")
        x, y = centres[order], medians[used][order]
        if not np.ptp(x) > 0:
            return np.asarray(y.mean(axis=0))
        with np.errstate(invalid="ignore"):
            return np.asarray(np.trapezoid(y, x, axis=0) / np.ptp(x))

    @cached_property
    def weights(self) -> Floats:
        """Weight of each design in a mean over all ``(design,)``: how likely it is where that is stated, else alike."""
        shares = [f.population.share if f.design.sampling == "population" else None for f in self.designs]
        return np.ones(len(shares)) if all(s is None for s in shares) else np.array([s or 0.0 for s in shares])

    @cached_property
    def mean(self) -> Floats:
        """The same in the mean over the designs, ``(estimator,)``; infinite where most runs of a level diverged."""
        scored = ~np.isnan(self.area).all(axis=1) & (self.weights > 0.0)
        if not scored.any():
            return np.full(self.area.shape[1], np.nan)
        return np.asarray(np.average(self.area[scored], axis=0, weights=self.weights[scored]))

    @cached_property
    def worst(self) -> Floats:
        """Largest median error of each design, ``(design, estimator)``."""
        tables = [f.medians[self.target] for f in self.designs]
        return np.array([np.fmax.reduce(medians, axis=0) for medians in tables])

    @cached_property
    def within(self) -> Floats:
        """Share of the runs of a vehicle under control whose error is within the limit, ``(design, estimator)``.

        One without a limit.
        """
        limit = np.inf if self.limit is None else self.limit
        shares = []
        for findings in self.designs:
            errors = np.moveaxis(findings.design.errors[self.target], 1, 0)
            runs = errors.reshape(len(errors), -1)
            counted = ~np.isnan(runs)
            shares.append((counted & (runs <= limit)).sum(axis=1) / np.maximum(counted.sum(axis=1), 1))
        return np.array(shares)

    @cached_property
    def order(self) -> list[int]:
        """Estimators that give the target, best first.

        By the share within the limit if there is one, then by area, then by the runs in which they diverged.
        """
        return self._sorted(np.average(self.within, axis=0, weights=self.weights), self.mean)

    def order_in(self, place: int) -> list[int]:
        """Return the same of one design."""
        return self._sorted(self.within[place], self.area[place])

    def _sorted(self, within: Floats, area: Floats) -> list[int]:
        giving = [e for e in range(len(area)) if not np.isnan(area[e])]
        shares = within if self.limit is not None else np.zeros(len(area))
        diverged = [sum(f.design.diverged(e) for f in self.designs) for e in range(len(area))]
        return sorted(giving, key=lambda e: (-shares[e], area[e], diverged[e]))

    @property
    def leaders(self) -> list[int]:
        """The best estimator, and those behind it whose area is within ``ALIKE`` of its own."""
        if not self.order:
            return []
        best = self.mean[self.order[0]]
        return [e for e in self.order if e == self.order[0] or self.mean[e] <= (1 + ALIKE) * best]

    def harm(self, place: int) -> float:
        """Return how harmful a design is: its largest median over the limit, without one over that as believed."""
        order = self.order_in(place)
        if not order:
            return 0.0
        worst = self.worst[place, order[0]]
        if self.limit is not None:
            return float(worst / self.limit)
        home = self.home(place, order[0], self.worst_level(place))
        return float(worst / home) if home is not None and home > 0 else 0.0

    def worst_level(self, place: int) -> int:
        """Return the level of a design at which the median error of the best estimator in it is largest."""
        medians = self.designs[place].medians[self.target][:, self.order_in(place)[0]]
        return int(np.nanargmax(medians))

    def alike(self, place: int, level: int) -> list[int]:
        """Return the estimators whose median error at a level is within ``ALIKE`` of that of the best in the design."""
        order, medians = self.order_in(place), self.designs[place].medians[self.target, level]
        best = medians[order[0]]  # infinite where every estimator diverged
        return [e for e in order if medians[e] == best or abs(medians[e] / best - 1) <= ALIKE]

    def tells_growth(self, place: int) -> bool:
        """Return whether a design says more than the errors over all levels do: from what the error grows."""
        return len(self.designs[place].design.bands) > 1 or any(f.design.matched is not None for f in self.designs)

    def home(self, place: int, estimator: int, level: int) -> float | None:
        """Return the median error as believed, of the runs that a level has too: runs out of control there are no part.

        Of a design without such a level that of the first design that has one.
        """
        own = self.designs[place].design
        if own.matched is not None:
            as_believed, there = (own.errors[self.target, b, estimator] for b in (own.matched, level))
            both = as_believed[~np.isnan(as_believed) & ~np.isnan(there)]
            if both.size and np.isfinite(value := np.median(both)):
                return float(value)
        for findings in self.designs:
            matched = findings.design.matched
            if matched is not None and np.isfinite(value := findings.medians[self.target, matched, estimator]):
                return float(value)
        return None


def standings(designs: Sequence[Findings], limits: dict[str, float]) -> list[Standing]:
    """Return the standing of the estimators for each target.

    Args:
        designs: All of a study; those of nested boxes have a section of their own.
        limits: Largest tolerable RMSE by target, SI.
    """
    chosen = [f for f in designs if f.design.sampling != "tolerance"] or list(designs)
    targets = chosen[0].design.targets
    scaled = [limits[q.name] * q.scale if q.name in limits else None for q in targets]
    return [Standing(chosen, t, limit) for t, limit in enumerate(scaled)]
