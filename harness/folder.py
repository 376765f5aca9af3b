"""Writing results into a folder."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path

from harness.errors import UserError


def write_files(folder: Path, contents: Mapping[str, str | bytes]) -> list[Path]:
    """Write files into a folder, made if absent, each whole or not at all; return their paths.

    Args:
        folder: Where to.
        contents: Text or bytes by file name.

    Raises:
        UserError: If the folder cannot be written to.
    """
    written = []
    try:
        folder.mkdir(parents=True, exist_ok=True)
        for name, content in contents.items():
            unfinished = folder / f"{name}.part"
            unfinished.write_bytes(content.encode("utf-8") if isinstance(content, str) else content)
            written.append(unfinished.replace(folder / name))
    except OSError as error:
        raise UserError(f"{folder}: cannot be written: {error.strerror or error}") from None
    return written
