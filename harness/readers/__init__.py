"""Readers of measured data: one format per file, chosen by the suffix of the recording.

A reader exports ``SUFFIXES`` (lower case, with dot) and ``read(path)``, which returns the numeric columns by
name as float64 arrays of equal length; missing samples are NaN. The folder is the registry.
"""

from __future__ import annotations

import os

import numpy as np
from numpy.typing import NDArray

from harness.errors import UserError
from models import registry


def suffixes() -> dict[str, str]:
    """Return every known suffix and the reader's name, the longest suffix first."""
    package = "harness.readers"
    known = {
        suffix: name
        for name in registry.names(package)
        for suffix in registry.load(package, name, ("SUFFIXES", "read")).SUFFIXES
    }
    return dict(sorted(known.items(), key=lambda item: (-len(item[0]), item[0])))


def read(path: str | os.PathLike[str]) -> dict[str, NDArray[np.float64]]:
    """Read a recording with the reader that its suffix names.

    Args:
        path: File, absolute or relative to the working directory.

    Returns:
        Columns by name, each float64 of shape ``(samples,)``.

    Raises:
        UserError: If the file is absent, of no known format, or cannot be read.
    """
    path = os.fspath(path)
    known = suffixes()
    reader = next((name for suffix, name in known.items() if path.lower().endswith(suffix)), None)
    if reader is None:
        raise UserError(f"{path}: no reader for this suffix; known are {', '.join(sorted(known))}")
    if not os.path.isfile(path):
        what = "is a folder" if os.path.isdir(path) else "does not exist"
        raise UserError(f"{path}: the recording {what}; give the path of a file, relative to the study")
    module = registry.load("harness.readers", reader, ("SUFFIXES", "read"))
    try:
        columns: dict[str, NDArray[np.float64]] = module.read(path)
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror or error}") from None
    if not columns:
        raise UserError(f"{path}: holds no numeric column")
    if not len(next(iter(columns.values()))):
        raise UserError(f"{path}: has columns but no row of data")
    return columns
