"""In which settings the files of several studies differ."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

from harness.common.files import parse_toml
from harness.study.report.analysis import Analysis
from harness.view.frame import said
from harness.view.tables import table

_THERE = "there"


def differing(analyses: Sequence[Analysis], names: Sequence[str]) -> Any:
    """Return in which settings the study files differ; of what one of them lacks, only that it does.

    Args:
        analyses: Of the studies.
        names: Of the studies, no two alike.
    """
    texts = zip(analyses, names, strict=True)
    sides = [settings(parse_toml(str(a.store.attributes["study"]), name)) for a, name in texts]
    every = list(dict.fromkeys(name for side in sides for name in side))
    partly = {n for n in every if any(n not in side for side in sides)}
    rows = [n for n in every if n in partly or any(side[n] != sides[0][n] for side in sides)]
    rows = [n for n in rows if not any(n.startswith(f"{above}.") for above in partly)]
    if not rows:
        return said("Their study files say the same; code, packages or files that they name may differ.")
    columns = {"setting": rows}
    for name, side in zip(names, sides, strict=True):
        columns[f"in {name}"] = ["–" if n not in side else _THERE if side[n] is None else str(side[n]) for n in rows]
    return table(columns)


def settings(of: Any, above: str = "") -> dict[str, Any]:
    """Return the settings of a study file by what leads to them, tables as ``None``, entries of lists by name."""
    if isinstance(of, list) and of and all(isinstance(entry, dict) for entry in of):
        of = {str(entry.get("name", entry.get("parameter", i))): entry for i, entry in enumerate(of)}
    if not isinstance(of, dict):
        return {above: of}
    found: dict[str, Any] = {above: None} if above else {}
    for name, value in of.items():
        found |= settings(value, f"{above}.{name}" if above else name)
    return found
