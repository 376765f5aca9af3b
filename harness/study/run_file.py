"""What a run was like, as it stands beside the scores of a study: duration, workers, memory."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import UserError
from harness.common.files import refuse_damaged
from harness.study import bound_file

FILE = "run.json"

LOST = "lost_by_foreign_code"
"""Which runs plants and estimators of somebody else lost, and why, in words."""


def read(folder: Path) -> dict[str, Any]:
    """Return what the file of a result folder says: texts and finite numbers by name; nothing if there is none.

    Raises:
        UserError: If it says anything else.
    """
    path = folder / FILE
    if not path.is_file():
        return {}
    with refuse_damaged(path, "JSON text", "delete it: the report is made without"):
        content = json.loads(path.read_text(encoding="utf-8"))
        if not isinstance(content, dict):
            raise ValueError(f"holds a {type(content).__name__} in place of a table")
        for name, value in content.items():
            if not (isinstance(value, str) or (isinstance(value, int | float) and np.isfinite(value))):
                raise ValueError(f"'{name}' is no text and no number")
    return content


def faults(folder: Path) -> list[str]:
    """Return what is wrong with the files beside a store, in words with the remedy; they have no checksums."""
    errors = []
    for look in (read, bound_file.content_of):
        try:
            look(folder)
        except UserError as error:
            errors.append(str(error))
    return errors
