"""Evidence from the stored studies of the dissertation: medians, ratios and extremes of groups of runs."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from harness.common.arrays import Floats
from harness.common.statistics import median_interval
from reproductions.campaign.claims import CLAIMS, Claim
from reproductions.campaign.evidence import Evidence, ratio_of_medians
from reproductions.published.record import Kind, Record, Test, between, point
from reproductions.published.results import Stored

Group = tuple[str, str | None, str, str]
"""Study, level (``None`` for all), estimator, target."""

Pairs = dict[str, tuple[Group, Group]]
"""Groups with the same drives and noise, by what is said of them."""


def errors(stored: Stored, group: Group) -> Floats:
    """Return the RMSE of a group of runs in report units, ``(drive, sample, repeat)``."""
    study, band, estimator, target = group
    return stored.errors(study, band, estimator, target)


def median(group: Group, theirs: float, region: tuple[float, float] | None = None) -> Test:
    """Return the test of a median error, drives kept; reproduced within a factor of two unless a region is given."""

    def test(stored: Stored) -> list[Evidence]:
        values = errors(stored, group)
        strata = np.broadcast_to(np.arange(values.shape[0]).reshape(-1, 1, 1), values.shape)
        value = median_interval(values, strata)
        return [Evidence("", value, region or between(theirs), theirs, int(np.isfinite(values).sum()))]

    return test


def ratio(pairs: Pairs, region: tuple[float, float], theirs: float = np.nan) -> Test:
    """Return the test of ratios of median errors, each of a group over another with the same drives and noise."""

    def test(stored: Stored) -> list[Evidence]:
        evidence = []
        for what, (own, other) in pairs.items():
            value, n = ratio_of_medians(errors(stored, own), errors(stored, other))
            evidence.append(Evidence(what, value, region, theirs, n))
        return evidence

    return test


def extremes(pairs: Pairs, extreme: Callable[[Floats], np.floating], region: tuple[float, float]) -> Test:
    """Return the test of ratios of another statistic of the errors, such as the largest; it has no interval."""

    def test(stored: Stored) -> list[Evidence]:
        return [
            point(what, float(extreme(errors(stored, own)) / extreme(errors(stored, other))), region)
            for what, (own, other) in pairs.items()
        ]

    return test


def spread(errors: Floats) -> np.floating:
    """Return the difference of the largest and the smallest error."""
    return np.nanmax(errors) - np.nanmin(errors)


def middle_half(errors: Floats) -> np.floating:
    """Return the difference of the quartiles of the errors."""
    return np.subtract(*np.nanquantile(errors, [0.75, 0.25]))


def finding(claim: Claim, keep: float | None = None) -> Test:
    """Return the campaign's test of a finding, or the part of it that stands beside a number of theirs."""

    def test(stored: Stored) -> list[Evidence]:
        return [e for e in claim.test(stored) if keep is None or e.theirs == keep]

    return test


def findings(section: str, without: str = "nothing") -> tuple[Record, ...]:
    """Return the campaign's findings of a section, but those whose text begins so."""
    return tuple(
        Record(
            claim.place,
            claim.text.rstrip("."),
            kind=Kind.STATEMENT,
            test=finding(claim),
            needs=" ".join(claim.studies),
            reason=claim.reason,
        )
        for claim in CLAIMS
        if claim.place.startswith(section) and not claim.text.startswith(without)
    )
