"""Readers of measured data: one format per file, chosen by the suffix of the recording.

A reader exports ``SUFFIXES`` (lower case, with dot; ``/`` for a folder) and ``read(path)``, which returns the
numeric columns as a list of ``Table``, one per clock, the one with most columns first. The folder is the registry.
"""

from __future__ import annotations

import os
import sys
from types import ModuleType

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.registry import Role
from harness.recordings.readers._table import Table, by_length

READERS = Role(sys.modules[__name__], "reader", ("SUFFIXES", "read"), "harness/recordings/readers/__init__.py")

__all__ = ["READERS", "Table", "by_length", "modules", "read", "read_tables", "suffixes"]


def modules() -> list[ModuleType]:
    """Return every reader."""
    return [READERS.load(name) for name in READERS.names()]


def suffixes() -> dict[str, str]:
    """Return every known suffix and the reader's name, the longest suffix first."""
    known = {suffix: module.__name__.rpartition(".")[2] for module in modules() for suffix in module.SUFFIXES}
    return dict(sorted(known.items(), key=lambda item: (-len(item[0]), item[0])))


def read(path: str | os.PathLike[str]) -> dict[str, Floats]:
    """Read the columns that share the main clock of a recording.

    Args:
        path: File or folder, absolute or relative to the working directory.

    Returns:
        Columns of the first table by name, each float64 of shape ``(samples,)``.

    Raises:
        UserError: As ``read_tables``.
    """
    return read_tables(path)[0].columns


def read_tables(path: str | os.PathLike[str]) -> list[Table]:
    """Read a recording with the reader that its suffix names.

    Args:
        path: File or folder, absolute or relative to the working directory.

    Returns:
        One table per clock, the one with most columns first; at least one, none of them without rows.

    Raises:
        UserError: If the file is absent, of no known format, or cannot be read.
    """
    path = os.fspath(path)
    known = suffixes()
    name = path.lower() if not os.path.isdir(path) else path.rstrip("/") + "/"
    reader = next((reader for suffix, reader in known.items() if name.endswith(suffix)), None)
    if reader is None:
        files = ", ".join(sorted(suffix for suffix in known if suffix != "/"))
        raise UserError(f"{path}: no reader for this suffix; known are {files}")
    if not os.path.exists(path):
        raise UserError(f"{path}: the recording does not exist; give the path of a file or folder")
    module = READERS.load(reader)
    try:
        tables: list[Table] = module.read(path)
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror or error}") from None
    if not any(table.columns for table in tables):
        raise UserError(f"{path}: holds no numeric column")
    tables = [table for table in tables if table.columns and len(next(iter(table.columns.values())))]
    if not tables:
        raise UserError(f"{path}: has columns but no row of data")
    return tables
