"""Region of the box in which a finding holds, and the factors on which that hinges."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import joblib
import numpy as np
from SALib.analyze import delta

from harness.common.arrays import Floats
from harness.common.statistics import Interval
from reproductions.box.evidence import BILD_56, IN_BOX, PUBLISHED, PointEvidence, of_network
from reproductions.box.factors import FACTORS, onto_choices
from reproductions.box.plausibility import plausibility
from reproductions.box.points import SEED, Point
from reproductions.box.totals import Totals, total_indices
from reproductions.campaign.evidence import Evidence, share

EVERYWHERE, NOWHERE = 0.9, 0.1
IDLE = 0.02
"""Total index up to which a factor is not named: that of a smooth surrogate is never quite zero."""

EXPLAINED = 0.5
"""Share of the variance at points left out that a surrogate must explain for its total indices to be told."""

LARGEST_MARGIN = 3.0
"""Powers of two; beyond it a margin says no more."""


def margin(evidence: Sequence[Evidence]) -> float:
    """Return how far the worst number of a finding lies inside its region, in powers of two; negative outside.

    The base is a factor of two of the ratio; a share of no run counts as a half run of 60.
    """
    margins = []
    for e in evidence:
        value = max(e.value.value, 0.5 / 60) if np.isfinite(e.value.value) else np.nan
        low, high = max(e.region[0], 1e-6), min(e.region[1], 1e6)
        margins.append(min(np.log2(value / low), np.log2(high / value)))
    worst = np.nanmin(margins) if np.isfinite(margins).any() else -LARGEST_MARGIN
    return float(np.clip(worst, -LARGEST_MARGIN, LARGEST_MARGIN))


@dataclass(frozen=True)
class Hinge:
    """What a finding hinges on.

    Attributes:
        first: First-order index of each factor, ``(factors,)``: the share of the variance of the margin that the factor
            alone explains, from given data (Plischke, Borgonovo and Smith 2013).
        error: Half-width of its 95 % interval.
        total: Total indices from the same data.
    """

    first: Floats
    error: Floats
    total: Totals

    def strongest(self, count: int = 2) -> list[int]:
        """Return the factors with the largest first-order index whose interval excludes zero, strongest first."""
        order = np.argsort(-self.first)
        return [int(k) for k in order[:count] if self.first[k] - self.error[k] > 0.0]

    def strongest_in_total(self, count: int = 2) -> list[int]:
        """Return the factors with the largest total index whose interval begins above ``IDLE``, strongest first.

        None where the surrogate explains less than ``EXPLAINED``: its indices are then of a fit to what may be chance.
        """
        if self.total.explained < EXPLAINED:
            return []
        order = np.argsort(-self.total.value)
        return [int(k) for k in order[:count] if self.total.lower[k] > IDLE]


@dataclass(frozen=True)
class Survival:
    """Where a finding holds.

    Attributes:
        share: Of the box, all estimators counted.
        filters: Of the box, the network's numbers left out.
        hinge: What the filters' margin hinges on; ``None`` where it is the same everywhere.
    """

    share: Interval
    filters: Interval
    hinge: Hinge | None

    @property
    def verdict(self) -> str:
        """Say where in the box the finding holds, by the interval of the share."""
        if self.share.lower >= EVERYWHERE:
            return "nearly everywhere"
        return "nearly nowhere" if self.share.upper <= NOWHERE else "in part"


def survivals(points: Sequence[Point], evidence: Sequence[PointEvidence], jobs: int = 1) -> list[Survival]:
    """Return where each finding of ``IN_BOX`` holds, from the points of the sequence.

    The shares have exact binomial intervals, which are wide for a Sobol sequence.
    """
    places = np.array([p.place for p in points])
    every, filters = (np.array([s.holds(network) for s in evidence]) for network in (True, False))
    margins = [np.array([margin(_of_filters(s.findings[k])) for s in evidence]) for k in range(len(IN_BOX))]
    hinges = joblib.Parallel(jobs)(joblib.delayed(_hinge)(places, own) for own in margins)
    return [
        Survival(
            share(int(every[:, k].sum()), len(evidence)), share(int(filters[:, k].sum()), len(evidence)), hinges[k]
        )
        for k in range(len(IN_BOX))
    ]


RARE = 0.1
"""Share of the points below which a finding is too rare to be said to exclude another."""


def exclusions(evidence: Sequence[PointEvidence]) -> list[tuple[int, int, float]]:
    """Return the pairs of findings that hold together least, against what their shares alone would give.

    Returns:
        Numbers of two findings (from 0) and the ratio of the points at which both hold to what independence would give,
        for ratios below a half, smallest first; findings that hold at fewer than ``RARE`` of the points left out.
    """
    holds = np.array([s.holds() for s in evidence], dtype=float)
    shares, both = holds.mean(axis=0), holds.T @ holds / len(evidence)
    pairs = [
        (a, b, float(both[a, b] / (shares[a] * shares[b])))
        for a in range(len(shares))
        for b in range(a + 1, len(shares))
        if min(shares[a], shares[b]) >= RARE
    ]
    return sorted((pair for pair in pairs if pair[2] < 0.5), key=lambda pair: pair[2])


def most_findings(points: Sequence[Point], evidence: Sequence[PointEvidence]) -> int:
    """Return which point has most findings.

    Of those whose vehicle is plausible and whose medians of the ideal case (Bild 5.6) are within a factor of two, or of
    all if there are none; the nearer one if two have the same.
    """
    medians = [k for k, p in enumerate(PUBLISHED) if p.place == BILD_56]

    def rank(k: int) -> tuple[bool, int, float]:
        near = bool((evidence[k].distances()[medians] <= 1.0).all()) and plausibility(points[k].at).plausible
        return (near, sum(evidence[k].holds()), -evidence[k].off())

    return max(range(len(evidence)), key=rank)


def _of_filters(evidence: Sequence[Evidence]) -> list[Evidence]:
    return [e for e in evidence if not of_network(e)] or list(evidence)


def _hinge(places: Floats, margins: Floats) -> Hinge | None:
    if np.ptp(margins) == 0.0:
        return None
    problem = {"num_vars": len(FACTORS), "names": [f.name for f in FACTORS], "bounds": [[0.0, 1.0]] * len(FACTORS)}
    indices = delta.analyze(problem, places, margins, method="sobol", seed=SEED)
    first, error = (np.asarray(indices[key], dtype=float) for key in ("S1", "S1_conf"))
    return Hinge(first, error, total_indices(places, margins, SEED, onto_choices))
