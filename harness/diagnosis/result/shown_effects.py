"""Planned drives once they are driven: from which size on they were to show effects, and what they showed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.result.answer import Value
from harness.diagnosis.selection.acceptance import Round
from harness.identification.expectation import NOT_COMPARED, TOLD, ReachedError, verdict_of
from harness.identification.uncertainty import NORMAL
from harness.models.quantities import listed, print_unit, words
from harness.reporting.style import number, probability, span

_IN_DOUBT = 0.05
"""Probability from which something is said to be there perhaps that the final model has not."""


@dataclass(frozen=True)
class SoughtAmplitude:
    """An amplitude that planned drives were to show.

    Attributes:
        limit: Its detection limit.
        value: As found, SI; NaN where the final model has none of it.
        std: Standard error of that.
        probability: That there is something of it; NaN without probabilities.
    """

    limit: ReachedError
    value: float
    std: float
    probability: float

    @property
    def interval(self) -> tuple[float, float]:
        """At 95 %."""
        return self.value - NORMAL * self.std, self.value + NORMAL * self.std

    @property
    def words(self) -> str:
        """What was seen of it."""
        name, unit = words(self.limit.name), print_unit(self.limit.unit)
        if math.isnan(self.value):
            doubt = f", though there with probability {probability(self.probability)},"
            unseen = f"{name} was not seen{doubt if self.probability >= _IN_DOUBT else ''}"
            return f"{unseen} and would be shown from {self.limit.words} on"
        size = f"{number(self.value)} {unit}".rstrip()
        size += f", 95 % interval {span(*self.interval)}," if math.isfinite(self.std) else ""
        sure = "" if math.isnan(self.probability) else f" with probability {probability(self.probability)}"
        return f"{name} was seen{sure}: {size} three standard errors {self.limit.words}"


@dataclass(frozen=True)
class EffectsShown:
    """What planned drives showed of what could not be seen before them.

    Attributes:
        amplitudes: That they were planned for.
        otherwise: Why what came is not compared, in a sentence; empty where it is.
    """

    amplitudes: tuple[SoughtAmplitude, ...]
    otherwise: str = ""

    @property
    def verdict(self) -> str:
        """``as expected``, ``larger``, ``smaller``, ``not stated`` or ``not compared``, of the detection limits."""
        return verdict_of([a.limit for a in self.amplitudes], self.otherwise)

    @property
    def words(self) -> str:
        """The same in sentences."""
        head = f"{NOT_COMPARED}, as {self.otherwise}" if self.otherwise else TOLD[self.verdict]
        return f"{head}: {listed([a.words for a in self.amplitudes])}."

    @property
    def record(self) -> dict[str, Any]:
        """Content of ``after`` in ``trace.json``."""
        return {
            "verdict": self.verdict,
            "words": self.words,
            "amplitudes": [
                {
                    "name": a.limit.name,
                    "unit": a.limit.unit,
                    "value": None if math.isnan(a.value) else a.value,
                    "standard_error": a.std if math.isfinite(a.std) else None,
                    "probability": None if math.isnan(a.probability) else a.probability,
                    "limit": a.limit.record,
                }
                for a in self.amplitudes
            ],
        }


def effects_shown(
    plan: Mapping[str, Any],
    rounds: Iterable[Round],
    found: Iterable[Value],
    inclusion: Mapping[Hypothesis, float] | None,
    otherwise: str = "",
) -> EffectsShown:
    """Return what planned drives showed; of what was found the detection limit is three of its standard errors.

    Args:
        plan: ``next_drive.json`` behind a trace, of detection limits.
        rounds: Of the trace with the drives.
        found: What the additions of its final model hold.
        inclusion: How likely each hypothesis is, if that is known.
        otherwise: Why what came is not compared, as where other drives were driven.
    """
    tried = [(c.hypothesis.name, c.hypothesis.kind, c.detectable) for r in rounds for c in r.candidates]
    limits, values = detection_limits(tried), {v.name: v for v in found}
    amplitudes = []
    for name, entry in plan["expected"]["limits"].items():
        before, expected = (math.inf if entry[key] is None else float(entry[key]) for key in ("before", "after"))
        value = values.get(name, Value(name, entry["unit"], math.nan, math.nan))
        limit = limits.get(entry.get("hypothesis", name), {}).get(name, math.nan)
        reached = limit if math.isnan(value.value) else 3.0 * value.std
        likely = math.nan if inclusion is None else sum(p for h, p in inclusion.items() if name in h.amplitudes)
        error = ReachedError(name, entry["unit"], before, expected, reached)
        amplitudes.append(SoughtAmplitude(error, value.value, value.std, likely))
    return EffectsShown(tuple(amplitudes), otherwise)


def detection_limits(tried: Iterable[tuple[str, str, Mapping[str, float]]]) -> dict[str, dict[str, float]]:
    """Return the last detection limits by hypothesis, and by amplitude where no hypothesis has that name.

    Args:
        tried: Name, kind and detection limits of hypotheses, round by round.
    """
    limits: dict[str, dict[str, float]] = {}
    for name, _, sizes in sorted(tried, key=lambda t: t[1] == "effect"):  # which has the name where both have it
        limits[name] = dict(sizes)
    for sizes in list(limits.values()):
        for name, size in sizes.items():
            limits.setdefault(name, {name: size})
    return limits
