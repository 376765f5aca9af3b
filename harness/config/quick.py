"""A study made short: every level and estimator, but few drives, repeats and Sobol points."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from harness.config.schema import DriveTable, HistoryTable, StudyFile
from harness.config.specs import DriveSpec

RUNS = 8
"""Runs of each level on a drive that are kept: as many as are computed side by side; fewer would take as long."""

SUFFIX = "-quick"


def shortened(study: StudyFile, drives: Sequence[DriveSpec]) -> StudyFile:
    """Return a study that is over soon, for a look at whether it runs and what its report shows.

    It keeps the drives that the report draws over time, or else the first, and of each design at most ``RUNS`` points
    or repeats. The name, and with it the folder of the result, ends in ``SUFFIX``, and the title says what was cut:
    nobody shall take the result for that of the whole study.

    Args:
        study: What the file states.
        drives: All drives of the study, of its own tables and of the files it names.
    """
    over_time = study.report.sensitivity_over_time
    drawn = {table.drive for table in study.histories.values()} | ({over_time.drive} if over_time else set())
    kept = [d for d in drives if d.name in drawn] or list(drives[:1])
    designs = []
    for design in study.design:
        samples = min(design.samples, RUNS)
        designs.append(design.model_copy(update={"samples": samples, "repeats": min(design.repeats, RUNS // samples)}))
    changes: dict[str, Any] = {
        "name": study.name + SUFFIX,
        "title": f"{study.title or study.name} (quick look: {len(kept)} of {len(drives)} drives, few runs)",
        "drives": [],
        "drive": [DriveTable(name=d.name, kind=d.kind, **d.options) for d in kept],
        "design": designs,
    }
    first = [table.model_copy(update={"sample": 0, "repeat": 0}) for table in study.histories.values()]
    if first:
        changes["history"] = first[0] if isinstance(study.history, HistoryTable) else first
    return study.model_copy(update=changes)
