"""Origin of a recording: how it was read, as text, so that it can be read again, and whether it holds the same."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr

ORIGIN = "origin"
"""Attribute of a recording that was read from a file: arguments of ``load_recording`` as JSON text."""


def origin_of(
    source: str | os.PathLike[str], file: Path, channels: Any, step: float | None, databases: Sequence[str]
) -> dict[str, str]:
    """Return the attribute of a recording, its paths absolute; none where its channel map is no file.

    Args:
        source: As it was named, with its part and its map.
        file: The file in it.
        channels: Channel map of all recordings.
        step: Of the common time base in s.
        databases: Of the messages of a bus log, each as ``[BUS=]FILE``.
    """
    if isinstance(channels, Mapping):
        return {}
    buses = [text.rpartition("=") for text in databases]
    stated = {
        "source": f"{file.resolve()}{os.fspath(source).removeprefix(os.fspath(file))}",
        "channels": None if channels is None else _absolute(os.fspath(channels)),
        "step": step,
        "databases": [f"{bus}{equals}{_absolute(path)}" for bus, equals, path in buses],
    }
    return {ORIGIN: json.dumps(stated)}


def _absolute(path: str) -> str:
    """Return a path as it holds in any folder; the name of a map of the package stays a name."""
    return str(Path(path).resolve()) if Path(path).exists() else path


def digest(recording: xr.Dataset) -> str:
    """Return what tells the numbers of a recording from those of others."""
    total = hashlib.sha256()
    for name in ["time", *sorted(map(str, recording.data_vars))]:
        values = recording[name].to_numpy()
        if values.dtype.kind in "fiub":
            total.update(name.encode() + np.ascontiguousarray(values, dtype=float).tobytes())
    return total.hexdigest()
