"""Finished parts of a long reproduction, each in a file of its own, so that it goes on where it was stopped."""

from __future__ import annotations

import hashlib
import io
import json
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.common.errors import UserError
from harness.common.files import refuse_damaged, write_files

_STATE = "state"


def state_of(*decides: Any) -> str:
    """Return a digest of what decides a part: of code as its digest, of settings as plain values, of files as bytes."""
    total = hashlib.sha256()
    for part in decides:
        content = part if isinstance(part, bytes) else json.dumps(part, sort_keys=True).encode()
        total.update(hashlib.sha256(content).digest())
    return total.hexdigest()


class Parts:
    """The parts kept in a folder.

    Args:
        path: The folder; made when the first part is written.
    """

    def __init__(self, path: Path) -> None:
        self.path = path

    def get(self, name: str, state: str) -> dict[str, NDArray[Any]] | None:
        """Return the arrays of a part that is there already.

        Args:
            name: Of the part.
            state: From ``state_of``: of what decides it today.

        Raises:
            UserError: If the file is damaged, or was made by other code or with other settings.
        """
        path = self._file(name)
        if not path.is_file():
            return None
        with refuse_damaged(path, "part of a result", "delete it, it is computed again"):
            with np.load(path, allow_pickle=False) as kept:
                content = {key: kept[key] for key in kept.files}
            made = str(content.pop(_STATE))
        if made != state:
            raise UserError(
                f"{path}: made by other code or with other settings; give another folder, or delete {self.path}"
            )
        return content

    def put(self, name: str, state: str, arrays: Mapping[str, Any]) -> None:
        """Write a part, whole or not at all.

        Raises:
            UserError: If the folder cannot be written to.
        """
        buffer = io.BytesIO()
        np.savez_compressed(buffer, allow_pickle=False, **{_STATE: np.array(state)}, **arrays)
        write_files(self.path, {self._file(name).name: buffer.getvalue()})

    def made(
        self, name: str, state: str, compute: Callable[[], Mapping[str, Any]]
    ) -> tuple[dict[str, NDArray[Any]], bool]:
        """Return the arrays of a part, computed and kept where it is not there yet, and whether it was."""
        there = self.get(name, state)
        if there is not None:
            return there, True
        arrays = {key: np.asarray(value) for key, value in compute().items()}
        self.put(name, state, arrays)
        return arrays, False

    def _file(self, name: str) -> Path:
        return self.path / f"{name}.npz"
