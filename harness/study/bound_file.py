"""The smallest errors possible as they stand next to the scores of a study; ``harness.study.bound`` computes them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, Literal

from harness.common.files import json_table

FILE = "bound.json"

Bounds = dict[str, dict[str, list[float | None]]]
"""Smallest RMSE in SI units by design, target and band; ``None`` where there is none."""


def read(folder: Path, study_hash: str, what: Literal["rmse", "smoothed"] = "rmse") -> Bounds:
    """Return the bounds in a result folder, or what the smoother reaches; none if nothing was written of this study.

    Raises:
        UserError: If the file is damaged.
    """
    kept = content_of(folder)
    bounds: Bounds = kept.get(what, {}) if kept.get("study_hash") == study_hash else {}
    return bounds


def content_of(folder: Path) -> dict[str, Any]:
    """Return all that stands in the file of a result folder; nothing if there is none.

    Raises:
        UserError: If the file is damaged.
    """
    return json_table(
        folder / FILE,
        "delete it: 'harness run' computes it again",
        lambda content: None if isinstance(content.get("rmse"), dict) else "holds no table 'rmse'",
    )
