"""Files that the options of drives and the settings of estimators name."""

from __future__ import annotations

from pathlib import Path
from typing import Any


def folder_of(options: dict[str, Any], candidates: tuple[Path, ...]) -> Path:
    """Return the first folder in which a file named by an option exists (the first folder if none does)."""
    return next((c for c in candidates if any(names_file(c, v) for v in options.values())), candidates[0])


def names_file(folder: Path, value: Any) -> bool:
    """Whether an option's value names a file: text with a suffix, so that column names are none."""
    if not isinstance(value, str) or not Path(value).suffix:
        return False
    try:
        return (folder / value).is_file()
    except (OSError, ValueError):  # text that cannot be a file name
        return False
