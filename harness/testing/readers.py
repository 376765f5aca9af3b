"""What holds for every reader of recordings."""

from __future__ import annotations

import os
from types import ModuleType

import numpy as np

from harness.recordings.readers import READERS, read_tables, suffixes
from harness.testing.parts import named, require


def check_reader(reader: str | ModuleType, example: str | os.PathLike[str] | None = None) -> None:
    """Check a reader: that its suffixes are its own, and that it reads an example.

    Args:
        reader: Its name, or a module.
        example: A recording of its format.

    Raises:
        AssertionError: If something does not hold; the message says what.
        UserError: If the example cannot be read.
    """
    with named(READERS, reader) as name:
        file = READERS.load(name)
        require(file.__doc__, f"{name}: write a docstring: its first line is what 'harness list' shows")
        require(file.SUFFIXES, f"{name}: SUFFIXES is empty")
        for suffix in file.SUFFIXES:
            right = suffix == "/" or (suffix.startswith(".") and suffix == suffix.lower())
            require(right, f"{name}: suffix '{suffix}' must be lower case with a dot, or '/' for a folder")
            require(suffixes()[suffix] == name, f"{name}: suffix '{suffix}' is that of another reader")
        if example is None:
            return
        for table in read_tables(example):
            lengths = {len(column) for column in table.columns.values()}
            require(len(lengths) == 1, f"{name}: columns of one table have lengths {sorted(lengths)}")
            wrong = [n for n, c in table.columns.items() if np.asarray(c).dtype != np.float64 or np.ndim(c) != 1]
            require(not wrong, f"{name}: no float64 vectors: {', '.join(wrong)}")
