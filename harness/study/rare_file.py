"""The rare event as it stands next to the scores of a study; ``harness.study.rare_event`` computes it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from harness.common.files import json_table

FILE = "rare_event.json"


def read(folder: Path, study_hash: str) -> dict[str, Any]:
    """Return what stands in the file of a result folder; nothing if none was written of this study.

    Raises:
        UserError: If the file is damaged.
    """
    content = content_of(folder)
    return content if content.get("study_hash") == study_hash else {}


def content_of(folder: Path) -> dict[str, Any]:
    """Return all that stands in the file of a result folder; nothing if there is none.

    Raises:
        UserError: If the file is damaged.
    """
    return json_table(folder / FILE, "delete it: 'harness run' computes it again", _wrong)


def _wrong(content: dict[str, Any]) -> str | None:
    answered = isinstance(content.get("probability"), float) or isinstance(content.get("not_reached"), str)
    return None if answered else "holds no number 'probability'"
