"""Files: results written into a folder, JSON written, TOML read."""

from __future__ import annotations

import json
import math
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import UserError


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


def json_text(content: Any) -> str:
    """Return JSON text of dictionaries, sequences and plain or NumPy scalars; what is not finite becomes ``null``."""
    return json.dumps(_plain(content), indent=2) + "\n"


def _plain(value: Any) -> Any:
    if isinstance(value, Mapping):
        return {k: _plain(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(v) for v in value]
    if isinstance(value, np.generic):
        value = value.item()
    return None if isinstance(value, float) and not math.isfinite(value) else value


def read_toml(path: Path) -> dict[str, Any]:
    """Return the content of a TOML file.

    Raises:
        UserError: If it cannot be read or is no TOML.
    """
    try:
        return tomllib.loads(path.read_text(encoding="utf-8"))
    except (OSError, UnicodeDecodeError) as error:
        raise UserError(f"{path}: cannot be read: {getattr(error, 'strerror', None) or error}") from None
    except tomllib.TOMLDecodeError as error:
        raise UserError(f"{path}: cannot be read as TOML: {error}") from None
