"""Report of the box: which findings survive, on what they hinge, and the point nearest to the dissertation."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

import numpy as np

from harness.models.quantities import listed
from harness.reporting.document import (
    Block,
    Bullets,
    Drawing,
    Listing,
    Prose,
    Report,
    Section,
    Sheet,
    plain,
    strong,
)
from harness.reporting.style import number, percent
from harness.study.provenance import commit
from reproductions.box import figures, nearest
from reproductions.box.analysis import Hinge, Survival
from reproductions.box.evidence import BILD_56, IN_BOX, PUBLISHED, PointEvidence
from reproductions.box.factors import FACTORS
from reproductions.box.nearest import Nearest
from reproductions.box.points import Point
from reproductions.box.search import score
from reproductions.box.tables import NUMBER_HEADER, number_rows
from reproductions.published.page import table


@dataclass(frozen=True)
class BoxResult:
    """What the box gave.

    Attributes:
        points: Of the sequence.
        evidence: Of the points, in their order.
        survivals: By finding.
        searched: How many points the search added.
        nearest: The point nearest to the dissertation.
        nearest_evidence: Of that point.
        richest: The point with most findings, see ``analysis.most_findings``.
        richest_evidence: Of that point.
        exclusions: See ``analysis.exclusions``.
        nearest_as_printed: The nearest point with its factors as printed, with the project's network and one
            trained there.
        command: That made it.
    """

    points: Sequence[Point]
    evidence: Sequence[PointEvidence]
    survivals: Sequence[Survival]
    searched: int
    nearest: Point
    nearest_evidence: PointEvidence
    richest: Point
    richest_evidence: PointEvidence
    exclusions: Sequence[tuple[int, int, float]]
    nearest_as_printed: Nearest
    command: str


def report(result: BoxResult) -> Report:
    """Return the report."""
    return Report(
        "Which findings of the dissertation survive what it does not publish?",
        [
            Section(lambda: _answer(result), "Answer"),
            Section(lambda: _findings(result), "Where each finding holds, and on what it hinges"),
            Section(lambda: nearest.blocks(result.nearest_as_printed), "The point nearest to the dissertation"),
            Section(lambda: _richest(result), "Where most findings hold"),
            Section(lambda: _steering(result), "Which steering noise?"),
            Section(lambda: _box(result), "The box"),
        ],
    )


def _answer(result: BoxResult) -> list[Block]:
    by_verdict = {
        verdict: [str(k) for k, s in enumerate(result.survivals, 1) if s.verdict == verdict]
        for verdict in ("nearly everywhere", "in part", "nearly nowhere")
    }
    texts = [
        f"{len(numbers)} hold {verdict} (number {listed(numbers)})" if numbers else f"none holds {verdict}"
        for verdict, numbers in by_verdict.items()
    ]
    holds = sum(result.nearest_evidence.holds())
    distances = result.nearest_evidence.distances()
    within = sum(d <= 1.0 for d in distances)
    items = [
        ("Which findings survive?", f"Of the {len(IN_BOX)} findings of chapter 5, in the box {'; '.join(texts)}."),
        (
            "How near can one come?",
            f"At the nearest point {holds} of {len(IN_BOX)} findings hold, and {within} of {len(PUBLISHED)} published "
            f"numbers are within a factor of two; root mean square distance: a factor of "
            f"{number(2 ** result.nearest_evidence.off(), 2)}.",
        ),
        ("Where do most findings hold?", richest_in_words(result)),
    ]
    return [
        Bullets([f"{strong(question)} {plain(text)}" for question, text in items]),
        Drawing(
            lambda: figures.shares(result.survivals),
            f"Share of {len(result.points)} points of a Sobol sequence over {len(FACTORS)} factors at which all "
            "numbers behind a finding lie where it puts them; exact binomial intervals.",
            "share of the box per finding",
        ),
    ]


def hinges(survival: Survival) -> str:
    """Say what a finding hinges on: factors with their first-order index."""
    if survival.hinge is None:
        return "the same everywhere"
    strongest = survival.hinge.strongest()
    named = [f"{FACTORS[k].words} {number(survival.hinge.first[k], 2)}" for k in strongest]
    return listed(named) if named else "no single factor"


def hinges_in_total(survival: Survival) -> str:
    """Say which factors have most part in a finding: those of the largest total index, with its interval."""
    if survival.hinge is None:
        return "the same everywhere"
    total = survival.hinge.total
    named = [
        f"{FACTORS[k].words} {number(total.value[k], 2)} ({number(total.lower[k], 2)} to {number(total.upper[k], 2)})"
        for k in survival.hinge.strongest_in_total()
    ]
    return f"{listed(named) if named else 'no single factor'}; {percent(max(total.explained, 0.0))} explained"


def finding_rows(result: BoxResult) -> list[list[str]]:
    """Return the rows of the table of findings."""
    rows = []
    for k, (claim, survival, holds) in enumerate(
        zip(IN_BOX, result.survivals, result.nearest_evidence.holds(), strict=True), 1
    ):
        shares = [
            f"{percent(s.value)} ({percent(s.lower)} to {percent(s.upper)})" for s in (survival.share, survival.filters)
        ]
        rows.append([str(k), claim.text, claim.place, *shares, hinges(survival), hinges_in_total(survival),
                     "yes" if holds else "no"])  # fmt: skip
    return rows


FINDING_HEADER = (
    "",
    "finding",
    "place",
    "share",
    "without the network",
    "hinges on (first-order index)",
    "together with others (total index)",
    "at the nearest",
)


def _findings(result: BoxResult) -> list[Block]:
    caption = (
        "Share of the box with its 95 % interval. Hinges on: factors whose first-order index, from the same points "
        "(given data), is above zero with its 95 % interval; the output is how far the worst of a finding's numbers, "
        "the network's left out, lies inside its region. Together with others: factors with the largest total "
        "index of a Gaussian process fitted to the same points, with what that explains of points left out."
    )
    return [
        Sheet(FINDING_HEADER, finding_rows(result), caption, left=7),
    ]


def _richest(result: BoxResult) -> list[Block]:
    return [
        Prose(plain(richest_in_words(result))),
        Sheet(NUMBER_HEADER, number_rows(result.richest_evidence), "Numbers of chapter 5 and ours there.", left=2),
    ]


def richest_in_words(result: BoxResult) -> str:
    """Say where most findings hold, which fail there, and which findings hardly hold together."""
    holds, distances = result.richest_evidence.holds(), result.richest_evidence.distances()
    failing = [str(k) for k, held in enumerate(holds, 1) if not held]
    medians = [d for p, d in zip(PUBLISHED, distances, strict=True) if p.place == BILD_56]
    text = (
        f"At point {result.richest.number}, {sum(holds)} of {len(IN_BOX)} findings hold"
        f"{' (not ' + listed(failing) + ')' if failing else ''}; the medians of Bild 5.6 are within a factor of "
        f"{number(2 ** max(medians), 2)} there, all numbers within {number(2 ** max(distances), 2)}."
    )
    if not result.exclusions:
        return text
    pairs = listed([f"{a + 1} with {b + 1} ({number(ratio, 2)})" for a, b, ratio in result.exclusions[:4]])
    return f"{text} Findings that hold together more rarely than their shares alone would give, as a ratio: {pairs}."


def markdown(result: BoxResult) -> str:
    """Return the tables of the page, those of the nearest point apart."""
    return "\n\n".join(
        [
            f"Written by `{result.command}`: {len(result.points)} points of the sequence and {result.searched} of the "
            "search.",
            "## Where each finding holds",
            table(FINDING_HEADER, finding_rows(result)),
            "## Where most findings hold",
            richest_in_words(result),
            table(NUMBER_HEADER, number_rows(result.richest_evidence)),
            "## Which steering noise",
            steering_in_words(result),
        ]
    )


def _steering(result: BoxResult) -> list[Block]:
    return [
        Prose(plain(steering_in_words(result))),
        Drawing(
            lambda: figures.steering(result.points, result.evidence),
            "Each point of the sequence: lag of the EKF's steering-wheel angle on two ramps (largest correlation), and "
            "root mean square distance of the published numbers in powers of two.",
            "delay of the input estimate and distance over the variance of the steering wheel",
        ),
    ]


def steering_in_words(result: BoxResult) -> str:
    """Say what the box tells of the last variance of (5.3)."""
    delay = np.array([p.delay for p in result.points])
    near = np.argsort([score(p, s) for p, s in zip(result.points, result.evidence, strict=True)])[
        : max(len(result.evidence) // 10, 1)
    ]
    column = [f.name for f in FACTORS].index("steering_variance")
    nearest = np.array([FACTORS[column].value(result.points[k].place[column]) for k in near])
    low, median, high = np.quantile(nearest, [0.1, 0.5, 0.9])
    return (
        "Of (5.3) the last variance, 1e-5 without a unit, may be of the steering wheel or of the road wheels, which is "
        "5.3e-3 rad² at the wheel. The text says that the input estimate lags by up to 0.7 s and would lag more with a "
        f"smaller variance. Over the box the lag on two ramps goes from {number(np.nanmin(delay))} to "
        f"{number(np.nanmax(delay))} s. The tenth of the points nearest to the published numbers has variances of "
        f"{number(low)} to {number(high)} rad² per step (10 and 90 % quantile), median {number(median)}."
    )


def _box(result: BoxResult) -> list[Block]:
    rows = [
        [f.words, f.unit, " or ".join(number(c) for c in f.choices) if f.choices else
         f"{number(f.lower)} to {number(f.upper)}{', log' if f.log else ''}", f.published]
        for f in FACTORS
    ]  # fmt: skip
    return [
        Sheet(["factor", "unit", "range", "what is published"], rows, "What the dissertation leaves open.", left=4),
        Listing(result.command),
    ]


def as_json(result: BoxResult, state: str) -> dict[str, Any]:
    """Return shares, hinges, numbers and the nearest point; ``state`` is that of the code."""
    findings = []
    for claim, survival, holds in zip(IN_BOX, result.survivals, result.nearest_evidence.holds(), strict=True):
        findings.append(
            {
                "finding": claim.text,
                "place": claim.place,
                "share": list(survival.share),
                "share_without_network": list(survival.filters),
                "holds_at_nearest": holds,
                **_hinge_record(survival.hinge),
            }
        )
    numbers = [
        {"number": p.words, "place": p.place, "theirs": p.theirs, "ours": list(n)}
        for p, n in zip(PUBLISHED, result.nearest_evidence.numbers, strict=True)
    ]
    first, trained = result.nearest_as_printed.evidence
    return {
        "made": datetime.now(UTC).date().isoformat(),
        "commit": commit(),
        "code": state,
        "points": len(result.points),
        "searched": result.searched,
        "findings": findings,
        "nearest": {
            "number": result.nearest.number,
            "at": result.nearest_as_printed.at,
            "distance": result.nearest_evidence.off(),
            "numbers": numbers,
            "printed": {
                name: {"holds": e.holds(), "distance": e.off(), "numbers": [list(n) for n in e.numbers]}
                for name, e in (("network", first), ("trained", trained))
            },
        },
        "most_findings": {
            "number": result.richest.number,
            "at": result.richest.at,
            "holds": result.richest_evidence.holds(),
            "distance": result.richest_evidence.off(),
            "numbers": [list(n) for n in result.richest_evidence.numbers],
        },
        "command": result.command,
    }


def _hinge_record(hinge: Hinge | None) -> dict[str, Any]:
    if hinge is None:
        return {"first_order": None, "total": None, "explained": None}
    names = [f.name for f in FACTORS]
    return {
        "first_order": dict(zip(names, hinge.first, strict=True)),
        "first_order_error": dict(zip(names, hinge.error, strict=True)),
        "total": dict(zip(names, hinge.total.value, strict=True)),
        "total_lower": dict(zip(names, hinge.total.lower, strict=True)),
        "total_upper": dict(zip(names, hinge.total.upper, strict=True)),
        "explained": hinge.total.explained,
    }
