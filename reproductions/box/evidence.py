"""Evidence of a point of the box on the dissertation's findings and numbers."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from harness.common.arrays import Floats
from harness.common.statistics import Interval, median_interval
from harness.study.score_names import OK
from reproductions.box.points import Point
from reproductions.box.studies import TARGETS
from reproductions.campaign.claims import ANGLE, CLAIMS, EKF, FORCE, MATCHED, MEDIANS, NETWORK, THEIRS, UKF
from reproductions.campaign.evidence import Evidence, ratio_of_medians, share

ESTIMATORS = (EKF, UKF, NETWORK)
SCALES = {FORCE: 1e-3, ANGLE: 180.0 / np.pi}
"""From SI to kN and degrees."""

IN_BOX = tuple(c for c in CLAIMS if not c.place.startswith("6"))
"""Findings of chapter 5; the time of a step (6.3.3) depends on the machine alone."""


class PointResults:
    """The studies of a point, asked for as those of a campaign (``reproductions.campaign.results.Results``).

    Args:
        point: The point. Its ideal case is the level that the estimators believe of every study.
    """

    study_names: tuple[str, ...] = THEIRS

    def __init__(self, point: Point) -> None:
        self.point = point
        limit = np.radians(point.at["divergence_limit"])
        self._lost = {
            study: (point.scores[f"{study}/status"] != OK)
            | ~(point.scores[f"{study}/max_error"][..., TARGETS.index(ANGLE)] <= limit)
            for study in point.bands
        }

    def bands(self, study: str) -> list[str]:
        """Return the labels of a study's levels."""
        return self.point.bands[study]

    def errors(self, study: str, band: str | None, estimator: str, target: str) -> Floats:
        """Return the RMSE of a group of runs in kN or degrees, ``(stratum, sample, repeat)``; NaN where it is lost."""
        if study not in self.point.bands or (band == MATCHED.get(study) and band not in self.point.bands[study]):
            study, band = "ideal", None
        chosen = range(len(self.bands(study))) if band is None else [self.bands(study).index(band)]
        e, t = ESTIMATORS.index(estimator), TARGETS.index(target)
        values = np.where(self._lost[study], np.nan, self.point.scores[f"{study}/rmse"][..., t])[..., e]
        return np.concatenate([values[b] for b in chosen]).astype(float) * SCALES[target]

    @property
    def times(self) -> NoReturn:
        """The box has no times: findings about them are not tested here."""
        raise LookupError("a point of the box has no computing times")

    def diverged(self, study: str, band: str, estimator: str) -> tuple[int, int]:
        """Return how many runs of a group were lost, and how many there are."""
        lost = self._lost[study][self.bands(study).index(band)][..., ESTIMATORS.index(estimator)]
        return int(lost.sum()), lost.size

    def lost_by_any(self, study: str, band: str, estimators: Sequence[str]) -> tuple[int, int]:
        """Return how many runs at least one of some estimators lost."""
        lost = self._lost[study][self.bands(study).index(band)]
        any_of = lost[..., [ESTIMATORS.index(e) for e in estimators]].any(axis=-1)
        return int(any_of.sum()), any_of.size


@dataclass(frozen=True)
class Published:
    """A number of chapter 5, and how a point answers it.

    Attributes:
        words: What it is.
        place: Where it stands.
        theirs: The number.
        ours: Returns ours with its interval.
        network: Whether it is the network's, which is trained anew at the nearest point only.
    """

    words: str
    place: str
    theirs: float
    ours: Callable[[PointResults], Interval]
    network: bool = False


def _median(study: str, band: str | None, estimator: str, target: str) -> Callable[[PointResults], Interval]:
    def ours(results: PointResults) -> Interval:
        errors = results.errors(study, band, estimator, target)
        return median_interval(errors, np.broadcast_to(np.arange(len(errors))[:, None, None], errors.shape))

    return ours


def _growth(band: str) -> Callable[[PointResults], Interval]:
    def ours(results: PointResults) -> Interval:
        errors = [results.errors("tyre", b, EKF, FORCE) for b in (band, MATCHED["tyre"])]
        return ratio_of_medians(errors[0], errors[1])[0]

    return ours


def _lost(study: str, band: str) -> Callable[[PointResults], Interval]:
    return lambda results: share(*results.lost_by_any(study, band, (EKF, UKF)))


def _delay(results: PointResults) -> Interval:
    return Interval(*3 * (results.point.delay,))


BILD_56 = "5.3, Bild 5.6"

PUBLISHED: tuple[Published, ...] = (
    *(
        Published(
            f"median error of the {words}, {name}, in {unit}",
            BILD_56,
            MEDIANS[estimator, target],
            _median("ideal", None, estimator, target),
            estimator == NETWORK,
        )
        for target, words, unit in ((FORCE, "force", "kN"), (ANGLE, "angle", "deg"))
        for estimator, name in ((EKF, "EKF"), (UKF, "UKF"), (NETWORK, "network"))
    ),
    Published("delay of the steering-wheel angle, in s", "5.3, Bild 5.7", 0.7, _delay),
    Published("share of runs lost at ten-fold noise", "5.4.1", 14 / 120, _lost("process-noise", "×10")),
    Published("median error of the angle at 8 t, EKF, in deg", "5.4.2", 3.0, _median("mass", "8 t", EKF, ANGLE)),
    Published("median error of the angle at 32 t, EKF, in deg", "5.4.2", 3.0, _median("mass", "32 t", EKF, ANGLE)),
    Published("share of runs lost with the CoG 2 m back", "5.4.3", 11 / 60, _lost("cog", "-2 m")),
    Published("growth of the force's error, tyres ±10 %", "5.4.5", 1.046, _growth("±10 %")),
    Published("growth of the force's error, tyres ±20 %", "5.4.5", 1.238, _growth("±20 %")),
    Published("growth of the force's error, tyres ±30 %", "5.4.5", 1.509, _growth("±30 %")),
)
"""The numbers of chapter 5 that decide how near a point is to the dissertation."""

LARGEST = 4.0
"""Largest distance of one number, so that a run that is lost does not outweigh all others."""


def distance(theirs: float, ours: float) -> float:
    """Return how far a number is off: 1 is a factor of two. Half a run of sixty stands for no run at all."""
    if not np.isfinite(ours):
        return LARGEST
    least = 0.5 / 60
    return float(min(abs(np.log2(max(ours, least) / max(theirs, least))), LARGEST))


@dataclass(frozen=True)
class PointEvidence:
    """Evidence of a point on findings and numbers.

    Attributes:
        findings: Evidence by claim, in the order of ``IN_BOX``.
        numbers: Ours with intervals, in the order of ``PUBLISHED``.
    """

    findings: tuple[tuple[Evidence, ...], ...]
    numbers: tuple[Interval, ...]

    def holds(self, network: bool = True) -> list[bool]:
        """Return for each finding whether all numbers behind it lie where it puts them.

        Args:
            network: Whether the network's count. A finding about nothing but the network counts either way.
        """
        holding = []
        for evidence in self.findings:
            counted = [e for e in evidence if network or not of_network(e)] or list(evidence)
            holding.append(all(np.isfinite(e.value.value) and _inside(e) for e in counted))
        return holding

    def distances(self) -> Floats:
        """Return how far each number is off, see ``distance``."""
        return np.array([distance(p.theirs, n.value) for p, n in zip(PUBLISHED, self.numbers, strict=True)])

    def off(self, network: bool = True) -> float:
        """Return the root mean square distance of the numbers.

        Args:
            network: Whether the network's count.
        """
        counted = np.array([network or not p.network for p in PUBLISHED])
        return float(np.sqrt(np.mean(self.distances()[counted] ** 2)))


def _inside(evidence: Evidence) -> bool:
    return evidence.region[0] <= evidence.value.value <= evidence.region[1]


def of_network(evidence: Evidence) -> bool:
    """Tell whether a number is the network's."""
    return evidence.what.startswith((NETWORK, "network"))


def evidence_of(point: Point) -> PointEvidence:
    """Return the evidence of a point on every finding and number."""
    results = PointResults(point)
    findings = tuple(tuple(claim.test(results)) for claim in IN_BOX)
    return PointEvidence(findings, tuple(p.ours(results) for p in PUBLISHED))
