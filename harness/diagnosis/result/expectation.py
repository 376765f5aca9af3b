"""Planned drives once they are driven: what was expected of the models that they were to tell apart, and what came."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import zip_longest
from typing import Any

from harness.diagnosis.selection.posterior import ComparedModel, Posterior
from harness.identification.expectation import NOT_COMPARED
from harness.models.quantities import listed, words
from harness.reporting.style import number, probability

STANDS = 0.95
"""Probability from which a name stands."""

_USUAL = 2.0
"""Standard deviations within which a ratio is as expected."""


@dataclass(frozen=True)
class LogRatio:
    """Log likelihood ratio of the leading model to a rival, by the drives since the plan.

    Attributes:
        rival: Its name.
        expected: Mean, if the leading model is right.
        deviation: Standard deviation then.
        realised: What came; infinite where the rival is out of the question, minus infinity where the leading one is,
            NaN where one of the two was not fitted or both are out of the question.
        unknown: Why that is not known, in words; empty where it is.
    """

    rival: str
    expected: float
    deviation: float
    realised: float
    unknown: str = ""

    @property
    def slight(self) -> bool:
        """Whether so little was expected that no growth at all is within the usual deviations."""
        return self.expected <= _USUAL * self.deviation

    @property
    def words(self) -> str:
        """What came, in words."""
        if self.unknown:
            return self.unknown
        if math.isfinite(self.realised):
            return f"grew by {number(self.realised)} against {self.rival}"
        if self.realised > 0.0:
            return f"grew so much that {self.rival} is out of the question"
        return f"fell so much against {self.rival} that it is out of the question itself"

    @property
    def z(self) -> float:
        """How many standard deviations it is above its expectation; NaN where nothing was expected."""
        return (self.realised - self.expected) / self.deviation if self.deviation > 0.0 else math.nan


@dataclass(frozen=True)
class ExpectationMet:
    """What was expected against what came.

    Attributes:
        leading: Of the models that were to be told apart the one that is now the likeliest.
        before: Its probability within the set when the drives were planned.
        expected: Its probability behind them, if it is right.
        realised: Its probability now.
        expected_to_stand: Probability that one name stands with 95 %.
        ratios: Of it to each other.
        likeliest: Name of the likeliest model of all, where it is not in the set.
        none: Probability that none is right, before and now.
        otherwise: Why what came is not compared, in a sentence; empty where it is.
    """

    leading: str
    before: float
    expected: float
    realised: float
    expected_to_stand: float
    ratios: tuple[LogRatio, ...]
    likeliest: str | None
    none: tuple[float, float]
    otherwise: str = ""

    @property
    def stands(self) -> bool:
        """Whether its name stands."""
        return self.realised >= STANDS and self.likeliest is None

    @property
    def verdict(self) -> str:
        """``as expected``, ``less`` or ``more`` than that, ``undecided``, ``another model`` or ``not compared``."""
        ratios = [r for r in self.ratios if not math.isnan(r.realised)]
        if self.otherwise:
            return "not compared"
        if self.likeliest is not None:
            return "another model"
        if not ratios:
            return "not compared"
        z = [r.z for r in ratios if math.isfinite(r.realised)]
        if any(value < -_USUAL for value in z) or any(r.realised == -math.inf for r in ratios):
            return "less"
        if any(r.slight and r.realised < 0.5 * r.expected for r in ratios):
            return "undecided"
        return "more" if any(value > _USUAL for value in z) else "as expected"

    @property
    def words(self) -> str:
        """The same in sentences."""
        if self.otherwise:
            return f"{NOT_COMPARED}: {self.otherwise}."
        verdict = {
            "as expected": "The planned drives were as informative as expected",
            "less": "The planned drives were less informative than expected",
            "more": "The planned drives were more informative than expected",
            "undecided": "Whether the planned drives were as informative as expected cannot be said",
            "not compared": "What was expected of the planned drives cannot be compared",
            "another model": f"The planned drives were to tell others apart than {self.likeliest}, the likeliest now",
        }[self.verdict]
        ratios = listed([f"{r.words} (expected {number(r.expected)} ± {number(r.deviation)})" for r in self.ratios])
        open_ = self.verdict in ("as expected", "undecided")
        slight = [r.rival for r in self.ratios if open_ and r.slight and math.isfinite(r.realised)]
        shows = f" No growth at all would be within two deviations too, against {listed(slight)}." if slight else ""
        return (
            f"{verdict}: {self.leading} has a probability of {probability(self.realised)} within the set (expected "
            f"{probability(self.expected)}, before {probability(self.before)}); its log likelihood ratio {ratios}."
            f"{shows}"
        )

    @property
    def record(self) -> dict[str, Any]:
        """Content of ``after`` in ``trace.json``."""
        return {
            "verdict": self.verdict,
            "words": self.words,
            "leading": self.leading,
            "probability": {"before": self.before, "expected": self.expected, "realised": self.realised},
            "stands": {"expected": self.expected_to_stand, "realised": self.stands},
            "likeliest": self.leading if self.likeliest is None else self.likeliest,
            "none_of_these": dict(zip(("before", "now"), self.none, strict=True)),
            "log_likelihood_ratios": [
                {
                    "rival": r.rival,
                    "expected": r.expected,
                    "deviation": r.deviation,
                    "realised": r.realised,
                    "z": r.z,
                    "words": r.words,
                }
                for r in self.ratios
            ],
        }


def expectation_met(
    earlier: Mapping[str, Any], plan: Mapping[str, Any], posterior: Posterior | None, otherwise: str = ""
) -> ExpectationMet | None:
    """Return what was expected of planned drives against what came; nothing without probabilities.

    Args:
        earlier: ``trace.json`` behind which they were planned.
        plan: ``next_drive.json``.
        posterior: Of the trace with them.
        otherwise: Why what came is not compared, as where other drives were driven.
    """
    if posterior is None:
        return None
    expected = plan["expected"]["models"]
    names, rows = list(expected), list(expected.values())
    old = sorted(earlier["confusable"]["models"], key=lambda m: -m["share"])[: len(names)]
    # Of what was alike every one is a model of the plan; plans of earlier versions have the models of the trace.
    sought = [[[h] for h in r["added"]] if "added" in r else m["added"] for r, m in zip_longest(rows, old)]
    before = [_density(earlier["posterior"]["models"], added) for added in sought]
    models = [_matching(posterior.models, added) for added in sought]
    shares = [0.0 if m is None else m.share for m in models]
    leading = max(range(len(names)), key=shares.__getitem__)
    first = posterior.models[0]
    ratios = [
        _ratio(names, leading, j, math.sqrt(rows[leading]["d2"][j]), models, before)
        for j in range(len(names))
        if j != leading and not otherwise
    ]
    return ExpectationMet(
        names[leading],
        float(rows[leading]["share"]),
        float(rows[leading]["expected"]),
        shares[leading] / sum(shares) if sum(shares) > 0.0 else 0.0,
        float(plan["expected"]["stands"]),
        tuple(ratios),
        None if any(m is first for m in models) else named(first),
        (float(earlier["posterior"]["none_of_these"]), posterior.none),
        otherwise,
    )


_Added = Sequence[Sequence[Mapping[str, str]]]
"""What a model has beyond the nominal one, by ``name`` and ``kind``: of each addition all that are alike."""


def _ratio(
    names: Sequence[str],
    leading: int,
    rival: int,
    d: float,
    models: Sequence[ComparedModel | None],
    before: Sequence[float],
) -> LogRatio:
    """Return how the log likelihood ratio of two models grew, with what was expected of that."""
    expected = names[rival], 0.5 * d**2, d
    missing = [names[k] for k in (leading, rival) if models[k] is None]
    if missing:
        return LogRatio(*expected, math.nan, f"is not known, as {listed(missing)} was not fitted")
    first, second = (m.difference.value for m in (models[leading], models[rival]) if m is not None)
    grown = (first - second) - (before[leading] - before[rival])
    why = f"against {names[rival]} is not known, as the equations of one of the two do not hold on a drive that judged"
    return LogRatio(*expected, grown, why if math.isnan(grown) else "")


def _density(models: Sequence[Mapping[str, Any]], added: _Added) -> float:
    """Return the log density of the held-out drives of a model of ``trace.json``, less that of the likeliest."""
    value = next(m["difference"]["value"] for m in models if _same(_keys(m["added"]), _keys(added)))
    return -math.inf if value is None else float(value)


def _matching(models: Sequence[ComparedModel], added: _Added) -> ComparedModel | None:
    """Return the likeliest model that has what one of ``trace.json`` has; what was alike then may be told apart now."""
    wanted = _keys(added)

    def matches(model: ComparedModel) -> bool:
        return _same([{(h.name, str(h.kind)) for h in alike.hypotheses} for alike in model.added], wanted)

    return max((m for m in models if matches(m)), key=lambda m: m.share, default=None)


def _keys(added: _Added) -> list[set[tuple[str, str]]]:
    return [{(h["name"], h["kind"]) for h in alike} for alike in added]


def _same(there: Sequence[set[tuple[str, str]]], wanted: Sequence[set[tuple[str, str]]]) -> bool:
    """Whether each addition that is wanted is there, or something that is alike."""
    return len(there) == len(wanted) and all(any(w & t for t in there) for w in wanted)


def named(model: ComparedModel) -> str:
    """Return what a model has beyond the nominal one, in words."""
    names = [words(alike.hypotheses[0].name.replace("@", " ")) for alike in model.added]
    return " and ".join(names) or "nothing added"
