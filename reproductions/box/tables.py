"""Rows of the tables of a point: published numbers beside ours, and its factors."""

from __future__ import annotations

from collections.abc import Mapping

from harness.reporting.style import number
from reproductions.box.evidence import PUBLISHED, PointEvidence
from reproductions.box.factors import FACTORS

NUMBER_HEADER = ("number", "place", "theirs", "ours", "95 % interval", "factor")
FACTOR_HEADER = ("factor", "value", "unit", "from", "to")


def number_rows(evidence: PointEvidence) -> list[list[str]]:
    """Return the rows of the table of numbers at a point."""
    rows = []
    for published, ours, off in zip(PUBLISHED, evidence.numbers, evidence.distances(), strict=True):
        interval = "–" if ours.lower == ours.upper else f"{number(ours.lower)} to {number(ours.upper)}"
        rows.append([published.words, published.place, number(published.theirs), number(ours.value), interval,
                     number(2**off, 2)])  # fmt: skip
    return rows


def factor_rows(at: Mapping[str, float]) -> list[list[str]]:
    """Return the rows of the table of a point's factors, given by their values."""
    return [[f.words, number(at[f.name]), f.unit, number(f.value(0.0)), number(f.value(1.0))] for f in FACTORS]
