"""What a run was like, as it stands next to the scores of a study: duration, workers, memory."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import UserError
from harness.common.files import json_table
from harness.study import bound_file, rare_file, trust_file

FILE = "run.json"

LOST = "lost_by_foreign_code"
"""Which runs plants and estimators of somebody else lost, and why, in words."""


def read(folder: Path) -> dict[str, Any]:
    """Return what the file of a result folder says: texts and finite numbers by name; nothing if there is none.

    Raises:
        UserError: If it says anything else.
    """
    return json_table(folder / FILE, "delete it: the report is made without", _wrong)


def _wrong(content: dict[str, Any]) -> str | None:
    for name, value in content.items():
        if not (isinstance(value, str) or (isinstance(value, int | float) and np.isfinite(value))):
            return f"'{name}' is no text and no number"
    return None


def faults(folder: Path) -> list[str]:
    """Return what is wrong with the files next to a store, in words with the remedy; they have no checksums."""
    errors = []
    for look in (read, bound_file.content_of, rare_file.content_of, trust_file.content_of):
        try:
            look(folder)
        except UserError as error:
            errors.append(str(error))
    return errors
