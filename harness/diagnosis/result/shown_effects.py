"""Planned drives once they are driven: from which size on they were to show effects, and what they showed."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from harness.diagnosis.model.hypotheses import Hypothesis, called
from harness.diagnosis.result.answer import Value
from harness.diagnosis.selection.acceptance import Round
from harness.identification.expectation import INFORMATIVE, NOT_COMPARED, ReachedError, verdict_of
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
    def seen(self) -> bool:
        """Whether the final model has it."""
        return not math.isnan(self.value)

    @property
    def interval(self) -> tuple[float, float]:
        """At 95 %."""
        return self.value - NORMAL * self.std, self.value + NORMAL * self.std

    @property
    def words(self) -> str:
        """What was seen of it."""
        name, unit = words(self.limit.name), print_unit(self.limit.unit)
        if not self.seen:
            doubt = f", though there with probability {probability(self.probability)},"
            if math.isnan(self.limit.reached):
                return f"{name} was not tried"
            unseen = f"{name} was not seen{doubt if self.probability >= _IN_DOUBT else ''}"
            return f"{unseen} and would be shown from {self.limit.words} on"
        size = f"{number(self.value)} {unit}".rstrip()
        size += f", 95 % interval {span(*self.interval)}" if math.isfinite(self.std) else ""
        sure = "" if math.isnan(self.probability) else f" with probability {probability(self.probability)}"
        limits = f"from {number(self.limit.expected)} on, before from {number(self.limit.before)}"
        return f"{name} was seen{sure}: {size} (to be shown {limits})"


@dataclass(frozen=True)
class EffectsShown:
    """What planned drives showed of what could not be seen before them.

    Attributes:
        amplitudes: That they were planned for.
        beside: What the final model has and the one that they were planned with had not, in words.
        otherwise: Why what came is not compared, in a sentence; empty where it is.
    """

    amplitudes: tuple[SoughtAmplitude, ...]
    beside: tuple[str, ...] = ()
    otherwise: str = ""

    @property
    def verdict(self) -> str:
        """``as expected``, or ``larger``, ``smaller`` or ``not stated`` of the detection limits of what was not seen.

        ``not compared`` where it is said why something else was driven.
        """
        unseen = [a.limit for a in self.amplitudes if not a.seen]
        return verdict_of(unseen, self.otherwise) if unseen or self.otherwise else "as expected"

    @property
    def words(self) -> str:
        """The same in sentences."""
        head = f"{NOT_COMPARED}, as {self.otherwise}" if self.otherwise else INFORMATIVE[self.verdict]
        said = f"{head}: {listed([a.words for a in self.amplitudes])}."
        if not self.beside or all(a.seen for a in self.amplitudes):
            return said
        more = listed(self.beside)
        return f"{said} What was not seen was sought in addition to {more}, which the model of the plan had not."

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
    earlier: Mapping[str, Any],
    plan: Mapping[str, Any],
    rounds: Iterable[Round],
    found: Mapping[Hypothesis, Iterable[Value]],
    inclusion: Mapping[Hypothesis, float] | None,
    otherwise: str = "",
) -> EffectsShown:
    """Return what planned drives showed.

    Args:
        earlier: ``trace.json`` behind which they were planned.
        plan: ``next_drive.json`` behind a trace, of detection limits.
        rounds: Of the trace with the drives.
        found: What each addition of its final model holds.
        inclusion: How likely each hypothesis is, if that is known.
        otherwise: Why what came is not compared, as where other drives were driven.
    """
    tried = [(c.hypothesis.name, c.hypothesis.kind, c.detectable) for r in rounds for c in r.candidates]
    limits, values = detection_limits(tried), {v.name: v for parts in found.values() for v in parts}
    planned_with = max(earlier["confusable"]["models"], key=lambda m: m["share"])["added"]
    had = {h["name"] for alike in planned_with for h in alike}
    amplitudes = []
    for name, entry in plan["expected"]["limits"].items():
        before, expected = (math.inf if entry[key] is None else float(entry[key]) for key in ("before", "after"))
        value = values.get(name, Value(name, entry["unit"], math.nan, math.nan))
        reached = limits.get(entry.get("hypothesis", name), {}).get(name, math.nan)
        likely = math.nan if inclusion is None else sum(p for h, p in inclusion.items() if name in h.amplitudes)
        error = ReachedError(name, entry["unit"], before, expected, reached)
        amplitudes.append(SoughtAmplitude(error, value.value, value.std, likely))
    return EffectsShown(tuple(amplitudes), tuple(called(h.name, " ") for h in found if h.name not in had), otherwise)


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
