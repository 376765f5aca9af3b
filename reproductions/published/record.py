"""A record of what a document publishes, and the verdict of our numbers on it.

The verdict is that of the campaign (``reproductions.campaign.evidence``): reproduced where the whole interval of ours
lies in the region that the record states, not reproduced where it lies wholly outside, undecided in between.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field
from enum import Enum

import numpy as np

from harness.common.errors import UserError
from harness.common.statistics import Interval
from reproductions.campaign.evidence import Evidence, Verdict, judge
from reproductions.published.results import Stored

HERE = ""
"""Where a record is computed by ``make reproduce`` itself."""

Test = Callable[[Stored], list[Evidence]]


class Kind(Enum):
    """What a document publishes."""

    SETTING = "setting"
    NUMBER = "number"
    STATEMENT = "statement"


class Outcome(Enum):
    """What becomes of a record; the words are those of the page."""

    REPRODUCED = "reproduced"
    NOT_REPRODUCED = "not reproduced"
    UNDECIDED = "undecided"
    MISSING = "result missing"
    IMAGE = "only in an image"
    MEASURED = "measured data not published"
    FOREIGN = "not computed here"
    TAKEN_OVER = "taken over"
    OURS_DIFFERS = "ours differs"


OF_SETTINGS = {Verdict.REPRODUCED: Outcome.TAKEN_OVER, Verdict.NOT_REPRODUCED: Outcome.OURS_DIFFERS}
OF_RESULTS = {
    Verdict.REPRODUCED: Outcome.REPRODUCED,
    Verdict.NOT_REPRODUCED: Outcome.NOT_REPRODUCED,
    Verdict.UNDECIDED: Outcome.UNDECIDED,
}
INCOMPARABLE = (Outcome.IMAGE, Outcome.MEASURED, Outcome.FOREIGN)
"""Why a record has no number of ours."""


@dataclass(frozen=True)
class Record:
    """A number or a checkable statement of a document.

    Attributes:
        place: Section, equation, table or figure.
        quantity: What it is about, in our words.
        theirs: As printed, without the unit; empty for a statement.
        unit: As printed.
        kind: Setting, number or statement.
        test: Returns ours; ``None`` where there is nothing to compare.
        needs: Names of the stored results that ours is read from, with spaces between; ``HERE`` for what is computed
            on the spot.
        reason: Why ours differs or may, or why it cannot be compared.
        bar: Why there is nothing to compare.
    """

    place: str
    quantity: str
    theirs: str = ""
    unit: str = ""
    kind: Kind = Kind.NUMBER
    test: Test | None = None
    needs: str = HERE
    reason: str = ""
    bar: Outcome | None = None


@dataclass(frozen=True)
class Row:
    """A record with ours.

    Attributes:
        record: The record.
        evidence: Ours.
        missing: What is missing of the result that it needs, and how to make it; empty if nothing is.
        old: Whether the stored result is older than the code that decides it.
        box: Share of the box of what is not published in which a finding holds.
    """

    record: Record
    evidence: Sequence[Evidence] = field(default_factory=list)
    missing: str = ""
    old: bool = False
    box: Interval | None = None

    @property
    def outcome(self) -> Outcome:
        """What becomes of the record."""
        if self.record.bar is not None:
            return self.record.bar
        if self.missing:
            return Outcome.MISSING
        verdict = judge(self.evidence)
        return (OF_SETTINGS if self.record.kind is Kind.SETTING else OF_RESULTS).get(verdict, Outcome.UNDECIDED)


def answer(record: Record, stored: Stored) -> Row:
    """Return a record with ours; a result that is not there or cannot be read is named in the row."""
    if record.test is None:
        return Row(record)
    try:
        evidence, box = record.test(stored), stored.box.share(record.quantity)
    except UserError as error:
        return Row(record, missing=str(error))
    old = not all(stored.origin(name).current for name in record.needs.split())
    return Row(record, evidence, old=old, box=box)


def printed(text: str) -> tuple[float, float]:
    """Return the numbers that are printed so: half a unit of the last digit to either side.

    Args:
        text: A decimal number, with an exponent if need be.
    """
    mantissa, _, exponent = text.lower().replace("−", "-").partition("e")
    decimals = len(mantissa.partition(".")[2])
    half = 0.5 * 10.0 ** (int(exponent or 0) - decimals)
    value = float(f"{mantissa}e{exponent or 0}")
    slack = 1e-9 * max(abs(value), half)  # a number on the edge belongs to both
    return value - half - slack, value + half + slack


def exactly(value: float) -> Interval:
    """Return a number without uncertainty as an interval of no width."""
    return Interval(value, value, value)


def between(half_to_twice: float) -> tuple[float, float]:
    """Return half and twice a number: the region where drives and tyres that are not published decide as well."""
    return half_to_twice / 2, 2 * half_to_twice


def setting(place: str, quantity: str, theirs: str, ours: float, unit: str = "", reason: str = "") -> Record:
    """Return the record of a setting of theirs and the value that ours has, taken over if they are equal."""

    def test(_: Stored) -> list[Evidence]:
        value = float(theirs)
        slack = 1e-9 * abs(value)  # units are converted
        return [Evidence("", exactly(float(ours)), (value - slack, value + slack), value, 1)]

    return Record(place, quantity, theirs, unit, Kind.SETTING, test, reason=reason)


def computed(
    place: str, quantity: str, theirs: str, ours: Callable[[], float], unit: str = "", reason: str = ""
) -> Record:
    """Return the record of a number that follows from theirs alone; reproduced if equal as printed."""

    def test(_: Stored) -> list[Evidence]:
        return [Evidence("", exactly(float(ours())), printed(theirs), float(theirs), 1)]

    return Record(place, quantity, theirs, unit, Kind.NUMBER, test, reason=reason)


def image(place: str, quantity: str, reason: str = "") -> Record:
    """Return the record of what only an image shows."""
    return Record(place, quantity, reason=reason, bar=Outcome.IMAGE)


def measured(place: str, quantity: str, theirs: str = "", unit: str = "", reason: str = "") -> Record:
    """Return the record of a number that rests on measured data which are not published."""
    return Record(place, quantity, theirs, unit, reason=reason, bar=Outcome.MEASURED)


def statement(place: str, quantity: str, test: Test, needs: str = HERE, reason: str = "") -> Record:
    """Return the record of a statement without a number."""
    return Record(place, quantity, kind=Kind.STATEMENT, test=test, needs=needs, reason=reason)


def foreign(place: str, quantity: str, theirs: str = "", unit: str = "", reason: str = "") -> Record:
    """Return the record of what this project does not compute, and why."""
    return Record(place, quantity, theirs, unit, reason=reason, bar=Outcome.FOREIGN)


def point(what: str, value: float, region: tuple[float, float], theirs: float = np.nan, n: int = 1) -> Evidence:
    """Return a number of ours that has no interval."""
    return Evidence(what, exactly(float(value)), region, theirs, n)


def count(rows: Iterable[Row]) -> dict[Outcome, int]:
    """Return how many rows have which outcome, in the order of ``Outcome``."""
    outcomes = [row.outcome for row in rows]
    return {outcome: outcomes.count(outcome) for outcome in Outcome if outcome in outcomes}
