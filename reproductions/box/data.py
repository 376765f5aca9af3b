"""Plain data of the box: ``box.json``."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from harness.study.provenance import commit
from reproductions.box.analysis import Hinge
from reproductions.box.evidence import IN_BOX, PUBLISHED
from reproductions.box.factors import FACTORS
from reproductions.box.report import BoxResult


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
                **_hinge(survival.hinge),
            }
        )
    numbers = [
        {"number": p.words, "place": p.place, "theirs": p.theirs, "ours": list(n)}
        for p, n in zip(PUBLISHED, result.nearest_evidence.numbers, strict=True)
    ]
    first, trained = result.nearest_as_printed.says
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
                name: {"holds": says.holds(), "distance": says.off(), "numbers": [list(n) for n in says.numbers]}
                for name, says in (("network", first), ("trained", trained))
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


def _hinge(hinge: Hinge | None) -> dict[str, Any]:
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
