"""What the box gave as plain data: ``box.json``."""

from __future__ import annotations

from datetime import UTC, datetime
from typing import Any

from harness.study.provenance import commit
from reproductions.box.analysis import Hinge
from reproductions.box.evidence import IN_BOX, PUBLISHED
from reproductions.box.factors import FACTORS
from reproductions.box.report import Found


def as_json(found: Found, state: str) -> dict[str, Any]:
    """Return shares, hinges, numbers and the nearest point; ``state`` is that of the code."""
    findings = []
    for claim, survival, holds in zip(IN_BOX, found.survivals, found.told.holds(), strict=True):
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
        for p, n in zip(PUBLISHED, found.told.numbers, strict=True)
    ]
    first, trained = found.nearest_told.says
    return {
        "made": datetime.now(UTC).date().isoformat(),
        "commit": commit(),
        "code": state,
        "points": len(found.points),
        "searched": found.searched,
        "findings": findings,
        "nearest": {
            "number": found.nearest.number,
            "at": found.nearest_told.at,
            "distance": found.told.off(),
            "numbers": numbers,
            "printed": {
                name: {"holds": says.holds(), "distance": says.off(), "numbers": [list(n) for n in says.numbers]}
                for name, says in (("network", first), ("trained", trained))
            },
        },
        "most_findings": {
            "number": found.richest.number,
            "at": found.richest.at,
            "holds": found.richest_told.holds(),
            "distance": found.richest_told.off(),
            "numbers": [list(n) for n in found.richest_told.numbers],
        },
        "command": found.command,
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
