"""Contract of what an experiment is designed for: what drives tell add up, and a criterion weighs the sum."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Protocol

from harness.common.arrays import Floats
from harness.experiment.rehearsal import Rehearsed
from harness.identification.filtered_model import FilteredModel

Evidence = tuple[Floats, ...]
"""What drives tell: arrays that add up from drive to drive."""


def total(parts: Sequence[tuple[Evidence, int]]) -> Evidence:
    """Return what several drives tell together, each driven so many times."""
    arrays = zip(*([times * a for a in evidence] for evidence, times in parts), strict=True)
    return tuple(sum(columns[1:], start=columns[0]) for columns in arrays)


@dataclass(frozen=True)
class ExpectedOutcome:
    """What is expected behind drives.

    Attributes:
        words: In a sentence.
        open: What stays open, in sentences.
        record: For ``next_drive.json``.
        header: Of the table ``rows``.
        rows: Quantity by quantity, before and behind the drives, as text.
    """

    words: str
    open: tuple[str, ...]
    record: Mapping[str, Any]
    header: Sequence[str]
    rows: Sequence[Sequence[str]]


class Goal(Protocol):
    """What is to be found out."""

    @property
    def model(self) -> FilteredModel:
        """The filter, compiled."""

    @property
    def versions(self) -> tuple[Floats, ...]:
        """Parameters of every version of the vehicle that is still possible, see ``Rehearsal``."""

    @property
    def recorded(self) -> int:
        """How many of them leave recordings."""

    @property
    def criterion(self) -> str:
        """Name of the criterion."""

    @property
    def turns(self) -> int:
        """How often a drive is driven at least: once to fit and once to judge."""

    @property
    def shortest(self) -> float:
        """Duration of the shortest recording that is taken, in s."""

    @property
    def lead_in(self) -> float:
        """How long a manoeuvre of one steering motion is straight ahead before it, in s."""

    @property
    def enough(self) -> float:
        """Value at which nothing is left to be driven for."""

    @property
    def measure(self) -> str:
        """What the exponential of its value is, in words."""

    def measured_by(self, sensors: str, /) -> Goal:
        """Return the same goal before drives with other sensors.

        Raises:
            UserError: If that cannot be expected.
        """

    def evidence(self, drive: Rehearsed, /) -> Evidence:
        """Return what a drive tells."""

    @property
    def surrogate(self) -> Callable[[Rehearsed], Evidence] | None:
        """Returns about what a drive tells, at a fraction of the cost; ``None`` where the evidence itself is cheap."""

    def value(self, evidence: Evidence | None, /) -> float:
        """Return the criterion behind drives, the smaller the better; before any with ``None``."""

    def preference(self, evidence: Evidence | None, /) -> float:
        """Return what decides between drives that settle as much, or not all: the smaller the better."""

    def expectation(self, evidence: Evidence | None, /) -> ExpectedOutcome:
        """Return what is expected behind drives; before any with ``None``."""
