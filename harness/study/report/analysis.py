"""The numbers of a report, computed once and used by words, figures and tables alike."""

from __future__ import annotations

import warnings
from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property
from itertools import count
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.common import statistics
from harness.reporting.style import Look, looks
from harness.study.report.population import Population
from harness.study.report.ranking import Ranking
from harness.study.results import Design, StudyResults

_SHOWN = 0.05
"""p-value below which a difference is shown."""

EXACT_AT_ZERO = ("input_noise_scale", "both")
"""Factor and owner: with it at zero, inputs are exact and estimators know it."""


@dataclass(frozen=True)
class Paired:
    """One paired comparison of two estimators.

    Attributes:
        target: Number of the target.
        first: Number of the estimator compared with.
        second: Number of the estimator compared.
        band: Number of the band; None for all bands together.
        result: Second over first.
        p_corrected: p-value after Holm's correction over all comparisons of the design.
    """

    target: int
    first: int
    second: int
    band: int | None
    result: statistics.PairedComparison
    p_corrected: float

    @property
    def shown(self) -> bool:
        """Whether a difference is shown at the 5 % level."""
        return bool(self.p_corrected < _SHOWN)


@dataclass(frozen=True)
class FilterConsistency:
    """NEES or NIS of a band and estimator, each divided by its expectation.

    Attributes:
        ratio: Average over expectation; 1 for a consistent filter.
        lower: Lower bound of the average over expectation, 95 %.
        upper: Upper bound.
        inside: Share of samples inside the 95 % region; 0.95 for a consistent filter.
        runs: Number of runs averaged.
    """

    ratio: float
    lower: float
    upper: float
    inside: float
    runs: int

    @property
    def verdict(self) -> str:
        """What the ratio says about the covariance."""
        if not np.isfinite(self.ratio):
            return "–"
        if self.ratio > self.upper:
            return "over-confident"
        return "cautious" if self.ratio < self.lower else "consistent"


_LEVELS = 14
"""Levels side by side whose numbers can be read."""


class Findings:
    """All numbers of one design."""

    def __init__(self, design: Design, seed: int, attributes: Mapping[str, Any] | None = None):
        self.design = design
        self.seed = seed
        self._attributes = attributes or {}

    @cached_property
    def summaries(self) -> list[list[list[statistics.Summary]]]:
        """Box-plot numbers by target, band, estimator."""
        d = self.design
        return [
            [
                [statistics.summarise(d.errors[t, b, e], d.strata, seed=self.seed) for e in range(len(d.estimators))]
                for b in range(len(d.bands))
            ]
            for t in range(len(d.targets))
        ]

    @cached_property
    def medians(self) -> NDArray[np.float64]:
        """Median errors, ``(target, band, estimator)``: infinite where most runs diverged, NaN without a run."""
        return np.array([[[s.median.value for s in row] for row in table] for table in self.summaries])

    @cached_property
    def reference(self) -> int:
        """Estimator that many are compared with: the best over all targets and bands.

        That is the one with the smallest mean logarithm of its median over the smallest one, of the targets it gives.
        """
        with np.errstate(invalid="ignore", divide="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore", RuntimeWarning)  # a band without any run has no smallest median
            behind = np.log(self.medians / np.nanmin(self.medians, axis=2, keepdims=True))
            mean = np.nanmean(behind, axis=(0, 1))
        return int(np.argmin(np.where(np.isnan(mean), np.inf, mean)))

    @cached_property
    def pairs(self) -> list[tuple[int, int]]:
        """Estimators compared: the two of a pair, of more each with the best."""
        count = len(self.design.estimators)
        if count <= 2:
            return [(0, 1)][: count - 1]
        return [(self.reference, b) for b in range(count) if b != self.reference]

    @cached_property
    def ranking(self) -> Ranking:
        """Sobol indices of a ``saltelli`` design."""
        return Ranking(self.design, self.seed)

    @cached_property
    def population(self) -> Population:
        """What a ``population`` design says."""
        return Population(self.design, self.seed, self._attributes)

    @cached_property
    def input_shares(self) -> NDArray[np.float64] | None:
        """Share of the mean square error that the noise of the inputs has, ``(target, band, estimator, 3)``.

        With its interval. Runs are compared with those in which the inputs are exact, which share drive and all other
        noise; ``None`` where no band of the design is that.
        """
        d = self.design
        exact = [b for f in d.factors if (f.name, f.of) == EXACT_AT_ZERO for b in np.flatnonzero(f.upper == 0.0)]
        if not exact or len(d.factors) > 1:
            return None
        shares = [
            [
                [
                    statistics.share_of_squares(d.errors[t, exact[0], e], d.errors[t, b, e], d.strata, seed=self.seed)
                    for e in range(len(d.estimators))
                ]
                for b in range(len(d.bands))
            ]
            for t in range(len(d.targets))
        ]
        return np.array(shares)

    @property
    def told(self) -> list[int | None]:
        """Bands of which words and tables compare estimators: the one believed, and all together (None)."""
        if len(self.design.bands) == 1:
            return [0]
        return [None] if self.design.matched is None else [self.design.matched, None]

    @cached_property
    def comparisons(self) -> list[Paired]:
        """All paired comparisons: by target and pair, every band and then all bands together."""
        d = self.design
        rows: list[tuple[int, int, int, int | None, statistics.PairedComparison]] = []
        for t in range(len(d.targets)):
            for first, second in self.pairs:
                values = d.errors[t]
                for b in range(len(d.bands)):
                    first_values, second_values = values[b, first], values[b, second]
                    result = statistics.compare(first_values, second_values, d.strata, seed=self.seed)
                    rows.append((t, first, second, b, result))
                if len(d.bands) > 1:
                    first_values, second_values = _over_bands(values[:, first], values[:, second])
                    result = statistics.compare(first_values, second_values, d.strata, seed=self.seed)
                    rows.append((t, first, second, None, result))
        corrected = statistics.holm([row[4].p_value for row in rows])
        return [Paired(*row, float(p)) for row, p in zip(rows, corrected, strict=True)]

    def compared(self, target: int, first: int, second: int, band: int | None) -> Paired:
        """Return one comparison; all bands together where there is a single band is that band."""
        wanted = 0 if band is None and len(self.design.bands) == 1 else band
        return next(
            c for c in self.comparisons if (c.target, c.first, c.second, c.band) == (target, first, second, wanted)
        )

    @cached_property
    def pairs_needed(self) -> int:
        """Pairs of runs with which the best that a test can show is a difference at the 5 % level, after Holm."""
        tests = sum(c.result.n > 0 for c in self.comparisons)
        return next(n for n in count(1) if tests * statistics.one_sided(n) < _SHOWN)

    @cached_property
    def decides(self) -> bool:
        """Whether any test of the design can show a difference."""
        return any(c.result.n >= self.pairs_needed for c in self.comparisons)

    @cached_property
    def with_covariance(self) -> list[int]:
        """Estimators that state a covariance, hence have NEES or NIS."""
        nees, nis = self.design.per_run("nees"), self.design.per_run("nis")
        return [
            e
            for e in range(len(self.design.estimators))
            if np.isfinite(nees[:, e]).any() or np.isfinite(nis[:, e]).any()
        ]

    def consistency(self, score: str, band: int, estimator: int) -> FilterConsistency:
        """Return ``nees`` or ``nis`` of a band and estimator against its bounds."""
        d = self.design
        averages = d.per_run(score)[band, estimator]
        used = np.isfinite(averages)
        runs = int(used.sum())
        dimension = d.state_dimension if score == "nees" else d.output_dimension
        if runs == 0 or dimension < 1:
            return FilterConsistency(np.nan, np.nan, np.nan, np.nan, runs)
        weights = np.ones(runs)
        count = float(runs)
        if score == "nis":
            weights = d.per_run("updates")[band, estimator][used]
            count = float(weights.sum())
        lower, upper = statistics.average_bounds(dimension, count)
        inside = d.per_run(f"{score}_inside")[band, estimator][used]
        return FilterConsistency(
            float(np.average(averages[used], weights=weights)) / dimension,
            lower / dimension,
            upper / dimension,
            float(np.average(inside, weights=weights)),
            runs,
        )

    def alone(self, band: int, estimator: int) -> tuple[int, int]:
        """Count the runs whose own average NEES is above the upper bound of a single run, and all that have one."""
        d = self.design
        averages = d.per_run("nees")[band, estimator]
        used = averages[np.isfinite(averages)]
        return int(np.sum(used > statistics.average_bounds(d.state_dimension, 1.0)[1])), used.size

    def repairs(self, band: int, estimator: int) -> int:
        """Count the steps of a band and estimator at which a covariance factor had to be repaired."""
        return int(np.nansum(self.design.per_run("repairs")[band, estimator]))


def _over_bands(
    first: NDArray[np.float64], second: NDArray[np.float64]
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Return the mean errors of each run over the bands in which both estimators have one.

    Bands share the noise of a run: to count it once for each would make an interval too narrow and a p-value too small.
    """
    both = ~np.isnan(first) & ~np.isnan(second)
    count = both.sum(axis=0)
    means = (np.where(both, x, 0.0).sum(axis=0) / np.maximum(count, 1) for x in (first, second))
    first_mean, second_mean = (np.where(count > 0, mean, np.nan) for mean in means)
    return first_mean, second_mean


class Analysis:
    """A store with its numbers and the looks of its estimators."""

    def __init__(self, store: StudyResults):
        self.store = store
        self.findings = [Findings(design, store.seed, store.attributes) for design in store.designs]
        names = list(dict.fromkeys(e for d in store.designs for e in d.estimators))
        self.looks: dict[str, Look] = looks(names)

    @property
    def main(self) -> Findings:
        """The first design of the study, which the answer in words is about."""
        return self.findings[0]

    @property
    def one_factor_each(self) -> list[Findings]:
        """Designs that a single figure shows: those of the levels of one factor each, if there are several."""
        chosen = [f for f in self.levelled if len(f.design.factors) == 1 and not f.design.sampled]
        factors = {f.design.factors[0].name for f in chosen}
        levels = sum(len(f.design.bands) for f in chosen)
        fits = chosen[:1] == self.levelled[:1] and len(chosen) == len(factors) > 1 and levels <= _LEVELS
        return chosen if fits else []

    @property
    def levelled(self) -> list[Findings]:
        """Designs shown by level: the first, and those that no section of their own or scatter over a factor shows."""
        first, *others = self.findings
        one_factor = [f for f in others if f.design.sampled and len(f.design.factors) == 1]
        return [first, *(f for f in others if f not in one_factor and f.design.sampling == "sobol")]
