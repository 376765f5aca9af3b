"""Finished parts of a long computation, as arrays in files of their own: what is interrupted goes on from there."""

from __future__ import annotations

import shutil
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.common import places
from harness.common.errors import UserError
from harness.common.files import refuse_damaged


class KeptArrays:
    """Arrays by key.

    Args:
        folder: Where they are; nothing is kept without one.
    """

    def __init__(self, folder: Path | None = None) -> None:
        self.folder = folder

    def read(self, key: str) -> list[NDArray[Any]] | None:
        """Return the arrays of a key, as they were written; ``None`` if they are not there or were cut off."""
        if self.folder is None:
            return None
        file = self.folder / f"{key}.npz"
        try:
            with refuse_damaged(file, "kept part"), np.load(file) as kept:
                return [kept[f"arr_{i}"] for i in range(len(kept.files))]
        except (OSError, UserError):
            return None

    def write(self, key: str, arrays: Sequence[NDArray[Any]]) -> None:
        """Keep arrays, whole or not at all.

        Raises:
            UserError: If the folder cannot be written to.
        """
        if self.folder is None:
            return
        try:
            self.folder.mkdir(parents=True, exist_ok=True)
            with places.unfinished(self.folder / f"{key}.npz") as stream:
                np.savez(stream, *arrays)
        except OSError as error:
            raise UserError(f"{self.folder}: cannot be written: {error.strerror or error}") from None

    def remove(self) -> None:
        """Remove what is kept: all is finished."""
        if self.folder is not None:
            shutil.rmtree(self.folder, ignore_errors=True)
