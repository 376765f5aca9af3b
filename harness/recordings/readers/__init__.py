"""Readers of measured data: one format per file, chosen by the suffix of the recording.

A reader exports ``SUFFIXES`` (lower case, with dot; ``/`` for a folder) and ``read(path)``, which returns the
numeric columns as a list of ``Table``, one per clock, the one with most columns first. One that takes ``wanted``
besides is told which columns are used, and may leave out others that are never blank; one that takes ``databases`` gets
those of the bus that it reads the log of. Our own stand in this folder.
"""

from __future__ import annotations

import inspect
import os
import sys
from collections.abc import Sequence
from types import ModuleType

from harness.common.arrays import Floats
from harness.common.components import OURS, place_of
from harness.common.errors import MissingFileError, UserError
from harness.common.registry import Role
from harness.recordings.readers._database import bus_and_file
from harness.recordings.readers._table import NO_MEASUREMENT, TEXT_CLOCKS, Table, Wanted, by_length

READERS = Role(
    sys.modules[__name__], "reader", ("SUFFIXES", "read"), "harness/recordings/readers/__init__.py", "readers"
)

__all__ = [
    "NO_MEASUREMENT",
    "READERS",
    "TEXT_CLOCKS",
    "Table",
    "Wanted",
    "bus_and_file",
    "by_length",
    "read",
    "read_tables",
    "reader_of",
    "suffixes",
    "takes_databases",
]


def suffixes() -> dict[str, str]:
    """Return every known suffix and the reader's name, the longest suffix first.

    A reader of the user's own is taken before one of the package for the same suffix.

    Raises:
        UserError: If two readers of one origin claim one suffix.
    """
    reader_names: dict[str, str] = {}
    from_package: dict[str, str] = {}
    for name, component in READERS.components().items():
        by_suffix = from_package if component.origin == OURS else reader_names
        for suffix in READERS.load(name).SUFFIXES:
            first = by_suffix.setdefault(suffix, name)
            if first != name:
                places = " and ".join(place_of(READERS.load(n)) for n in (first, name))
                raise UserError(f"two readers are for files '*{suffix}': {places}; change SUFFIXES of one of the two")
    every_suffix = from_package | reader_names
    return dict(sorted(every_suffix.items(), key=lambda item: (-len(item[0]), item[0])))


def reader_of(path: str | os.PathLike[str]) -> ModuleType | None:
    """Return the reader that the suffix of a recording names; ``None`` if there is none."""
    path = os.fspath(path)
    name = path.lower() if not os.path.isdir(path) else path.rstrip("/") + "/"
    reader = next((reader for suffix, reader in suffixes().items() if name.endswith(suffix)), None)
    return None if reader is None else READERS.load(reader)


def takes_databases(path: str | os.PathLike[str]) -> bool:
    """Return whether a recording may be a bus log by its suffix."""
    module = reader_of(path)
    return module is not None and "databases" in inspect.signature(module.read).parameters


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


def read_tables(
    path: str | os.PathLike[str], wanted: Wanted | None = None, databases: Sequence[str] = ()
) -> list[Table]:
    """Read a recording with the reader that its suffix names.

    Args:
        path: File or folder, absolute or relative to the working directory.
        wanted: Tells by its name whether a column is used; all are by default.
        databases: What the frames of a bus log hold, each as ``[BUS=]FILE``.

    Returns:
        One table per clock, the one with most columns first; at least one, none of them without rows.

    Raises:
        UserError: If the file is absent, of no known format, or cannot be read, or is no bus log for the databases.
    """
    path = os.fspath(path)
    module = reader_of(path)
    if module is None:
        files = ", ".join(sorted(suffix for suffix in suffixes() if suffix != "/"))
        raise UserError(f"{path}: no reader for this suffix; known are {files}")
    if not os.path.exists(path):
        raise MissingFileError(f"{path}: the recording does not exist; give the path of a file or folder")
    if not (os.path.isfile(path) or os.path.isdir(path)):  # a pipe gives nothing, some devices give without end
        raise UserError(f"{path}: the recording is no file but a pipe or a device; write what it gives to a file")
    try:
        takes = inspect.signature(module.read).parameters
        if databases and not takes_databases(path):
            raise UserError(f"{path}: is no bus log, so that a database (--database) says nothing of it; leave it out")
        asked = {"wanted": wanted, "databases": tuple(databases)}
        tables: list[Table] = module.read(path, **{name: value for name, value in asked.items() if name in takes})
    except OSError as error:
        raise UserError(f"{path}: cannot be read: {error.strerror or error}") from None
    if not any(table.columns for table in tables):
        raise UserError(f"{path}: holds no numeric column")
    tables = [table for table in tables if table.columns and len(next(iter(table.columns.values())))]
    if not tables:
        raise UserError(f"{path}: has columns but no row of data")
    return tables
