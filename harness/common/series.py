"""Time series beside a result, small enough to keep: every extreme, at the resolution of a screen."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import refuse_special
from harness.common.thinning import kept

BINS = 1500
"""Parts of the time axis of which the extremes are kept."""


def packed(series: Mapping[str, Mapping[str, Floats]]) -> bytes:
    """Return time series as the content of an ``.npz`` file.

    Args:
        series: By name, such as that of a drive: columns ``(samples,)`` by name, one of them ``time``. All of a series
            are thinned to the same samples (``harness.common.thinning``) and kept with single precision, ``time``
            with double.
    """
    found: dict[str, Any] = {}
    for i, (name, columns) in enumerate(series.items()):
        lines = [v for k, v in columns.items() if k != "time"]
        rows = kept(lines, 0, len(columns["time"]), max(50, BINS // max(1, len(lines) // 4)))
        found[f"{i}/name"] = np.array(name)
        for k, values in columns.items():
            found[f"{i}/{k}"] = values[rows] if k == "time" else values[rows].astype(np.float32)
    file = io.BytesIO()
    np.savez_compressed(file, **found)
    return file.getvalue()


def unpacked(path: Path) -> dict[str, dict[str, Floats]]:
    """Return what ``packed`` wrote.

    Raises:
        UserError: If the file cannot be read.
    """
    found: dict[str, dict[str, Floats]] = {}
    refuse_special(path)
    try:
        with np.load(path, allow_pickle=False) as file:
            names = {key.partition("/")[0]: str(file[key]) for key in file.files if key.endswith("/name")}
            for number, name in names.items():
                own = [key for key in file.files if key.startswith(f"{number}/") and key != f"{number}/name"]
                found[name] = {key.partition("/")[2]: file[key] for key in own}
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise UserError(f"{path}: no time series that the harness wrote ({type(error).__name__}: {error})") from error
    return found
