"""The rare event as it stands beside the scores of a study; ``harness.study.rare_event`` computes it."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from harness.common.files import refuse_damaged

FILE = "rare_event.json"


def read(folder: Path, study_hash: str) -> dict[str, Any]:
    """Return what stands in the file of a result folder; nothing if none was written of this study.

    Raises:
        UserError: If the file is damaged.
    """
    path = folder / FILE
    if not path.is_file():
        return {}
    with refuse_damaged(path, "JSON text", "delete it: 'harness run' computes it again"):
        content: dict[str, Any] = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict) or not isinstance(content.get("probability", 0.0), float):
            raise ValueError("holds no number 'probability'")
        if "probability" not in content and not isinstance(content.get("not_reached"), str):
            raise ValueError("holds no number 'probability'")
    return content if content.get("study_hash") == study_hash else {}
