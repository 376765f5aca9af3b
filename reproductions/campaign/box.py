"""In how much of what the dissertation leaves open each of its findings holds, as ``make reproduce-box`` found it.

The long job keeps what it found in ``results/reproduce-box/box.json``. Its shares and its nearest point are in
``box.json`` beside this file too, so that every report can show them without the hour that the job takes.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from harness.common.errors import UserError
from harness.common.statistics import Interval

COMMITTED = Path(__file__).with_name("box.json")
RESULT = Path("reproduce-box") / "box.json"
"""The file of the long job below a folder of results."""


@dataclass(frozen=True)
class NearestPoint:
    """The point of the box nearest to the published numbers: its number, and its values by factor."""

    number: int
    at: dict[str, float]


@dataclass(frozen=True)
class Box:
    """What the box says of the findings.

    Attributes:
        made: Day on which it was computed.
        points: Of the sequence; the shares are of them.
        shares: Share of the points at which a finding holds, by its text without the full stop.
        nearest: The nearest point.
        report: Report of the long job where that is there.
    """

    made: str
    points: int
    shares: dict[str, Interval]
    nearest: NearestPoint
    report: Path | None = None

    def share(self, finding: str) -> Interval | None:
        """Return the share of a finding by its text, with or without its full stop."""
        return self.shares.get(finding.rstrip("."))


def read(results: Path) -> Box:
    """Return the box of a folder of results, or the committed one where there is none.

    Raises:
        UserError: If the file there is not that of a box.
    """
    path = results / RESULT
    return _read(path, path.with_name("report.html")) if path.is_file() else committed()


def committed() -> Box:
    """Return the box that the project comes with."""
    return _read(COMMITTED, None)


def summary(content: dict[str, Any]) -> dict[str, Any]:
    """Return the part of ``box.json`` that the project comes with."""
    kept = ("finding", "place", "share", "share_without_network")
    whole = {key: content[key] for key in ("made", "commit", "command", "points", "searched")}
    nearest = {key: content["nearest"][key] for key in ("number", "at")}
    return {**whole, "findings": [{k: f[k] for k in kept} for f in content["findings"]], "nearest": nearest}


def _read(path: Path, report: Path | None) -> Box:
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        shares = {f["finding"].rstrip("."): Interval(*map(float, f["share"])) for f in content["findings"]}
        nearest = NearestPoint(
            int(content["nearest"]["number"]), {k: float(v) for k, v in content["nearest"]["at"].items()}
        )
        return Box(
            str(content["made"]),
            int(content["points"]),
            shares,
            nearest,
            report if report is not None and report.is_file() else None,
        )
    except (OSError, ValueError, KeyError, TypeError, AttributeError) as error:
        raise UserError(f"{path}: not the result of a box ({error}); make it again with 'make reproduce-box'") from None
