"""Words for rows: ours with its interval, what counts as reproduced, and the counts on top."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from harness.models.quantities import listed
from harness.reporting.style import number
from reproductions.campaign.evidence import Evidence, Verdict
from reproductions.published.record import HERE, INCOMPARABLE, Kind, Outcome, Row, count
from reproductions.stored import LONG

SHOWN = 3
"""Most numbers of a row that are written out."""

COMPARED = {
    Outcome.REPRODUCED: "are reproduced",
    Outcome.NOT_REPRODUCED: "are not",
    Outcome.UNDECIDED: "cannot be decided",
    Outcome.MISSING: "wait for a stored result that is missing",
}
BECAUSE = {
    Outcome.IMAGE: "are shown only in an image",
    Outcome.MEASURED: "rest on measured data that are not published",
    Outcome.FOREIGN: "belong to what is not computed here",
}


@dataclass(frozen=True)
class Chapter:
    """A document or a part of one, with its rows.

    Attributes:
        title: Author, year and what it is about.
        note: What has to be known to read the rows.
        rows: Of its records.
    """

    title: str
    note: str
    rows: Sequence[Row]

    @property
    def results(self) -> list[Row]:
        """The numbers and statements that are compared, or would be if nothing were missing."""
        return [r for r in self.rows if r.record.kind is not Kind.SETTING and r.outcome not in INCOMPARABLE]

    @property
    def settings(self) -> list[Row]:
        """What was taken over or not."""
        return [r for r in self.rows if r.record.kind is Kind.SETTING]

    @property
    def incomparable(self) -> list[Row]:
        """What has no counterpart."""
        return [r for r in self.rows if r.outcome in INCOMPARABLE]


def value(e: Evidence) -> str:
    """Write a number with its interval, if it has one."""
    if not np.isfinite(e.value.value):
        return "none"
    whole = float(e.value.value).is_integer() and abs(e.value.value) < 1e6
    text = f"{e.value.value:.0f}" if whole else number(e.value.value)
    if e.value.upper > e.value.lower:
        text += f" ({number(e.value.lower)} to {number(e.value.upper)})"
    return text


def ours(row: Row) -> str:
    """Write ours: every number if they are few, else their range and, where one decides against, that one."""
    evidence = list(row.evidence)
    if row.missing:
        return "–"
    if not evidence:
        return "too few trainings or runs stored"
    if len(evidence) <= SHOWN:
        return "; ".join(f"{e.what}: {value(e)}" if e.what else value(e) for e in evidence)
    values = sorted(e.value.value for e in evidence if np.isfinite(e.value.value))
    text = f"{len(evidence)} numbers, {number(values[0])} to {number(values[-1])}" if values else "none"
    against = [e for e in evidence if e.verdict is Verdict.NOT_REPRODUCED]
    if against:
        farthest = max(against, key=_distance)
        text += f"; against it: {farthest.what}: {value(farthest)}"
    return text


def _distance(e: Evidence) -> float:
    """Return how far a number lies outside its region, as a factor where that has a meaning."""
    low, high = e.region
    v = e.value.value
    if v > high:
        return v / high if high > 0 else v - high
    return low / v if v > 0 and np.isfinite(low) else low - v


def wanted(row: Row) -> str:
    """Write where ours must lie for the record to be reproduced."""
    regions = list(dict.fromkeys(e.region for e in row.evidence))
    return "; ".join(_region(*r) for r in regions) if len(regions) <= 2 else "each its own"


def _region(low: float, high: float) -> str:
    if high - low <= 1e-6 * abs(high):
        return number((low + high) / 2)
    if not np.isfinite(high) or high > 1e12:
        return f"above {number(low)}"
    if not np.isfinite(low) or low == 0.0:
        return f"below {number(high)}"
    return f"{number(low)} to {number(high)}"


def theirs(row: Row) -> str:
    """Write theirs with its unit."""
    unit = row.record.unit
    return f"{row.record.theirs}{'' if unit in ('', '°') else ' '}{unit}"


def verdict(row: Row) -> str:
    """Write the verdict, marked where the stored result is older than the code."""
    return row.outcome.value + (" †" if row.old else "")


def source(row: Row) -> str:
    """Return the command that ours comes from."""
    commands = [LONG[name].command if name in LONG else f"make study-{name}" for name in row.record.needs.split()]
    return "make reproduce" if row.record.needs == HERE else ", ".join(commands)


def why(row: Row) -> str:
    """Return the reason, where there is something to explain, or what is missing."""
    if row.missing:
        return row.missing
    agreed = row.outcome in (Outcome.REPRODUCED, Outcome.TAKEN_OVER)
    sentences = [] if agreed or not row.record.reason else [row.record.reason]
    if row.box is not None:
        shares = [f"{100 * s:.0f}" for s in row.box]
        sentences.append(f"Holds in {shares[0]} % ({shares[1]} to {shares[2]}) of the box of what is not published.")
    return " ".join(sentences)


def sentence(rows: Sequence[Row]) -> str:
    """Return how many of the records are reproduced, in a sentence or two; settings are counted apart."""
    settings = [r for r in rows if r.record.kind is Kind.SETTING]
    counts = count(r for r in rows if r.record.kind is not Kind.SETTING)
    total = sum(counts.values())
    compared = [f"{counts[o]} {words}" for o, words in COMPARED.items() if o in counts]
    barred = [f"{counts[o]} {words}" for o, words in BECAUSE.items() if o in counts]
    parts = [listed(compared)] if compared else []
    if barred:
        parts.append(f"{sum(counts[o] for o in BECAUSE if o in counts)} cannot be compared: {listed(barred)}")
    text = f"Of {total} numbers and statements {'; '.join(parts)}."
    if settings:
        text += f" Of {len(settings)} settings {count(settings).get(Outcome.TAKEN_OVER, 0)} are taken over as printed."
    return text
