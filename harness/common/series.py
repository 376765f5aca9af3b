"""Time series thinned to the resolution of a screen with every extreme, and kept next to a result."""

from __future__ import annotations

import io
import zipfile
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import refuse_special

SCREEN_BINS = 400
"""Parts of the time axis of which each figure shows the extremes: about one for three pixels of a wide screen."""


def thinned(columns: Sequence[Floats], first: int, stop: int, bins: int = SCREEN_BINS) -> NDArray[np.int64]:
    """Return the samples from ``first`` to before ``stop`` that stand for all of them in a line over time.

    Of each part of the axis these are its first sample and, of every column, that with the smallest and that with the
    largest value; of few samples all.

    Args:
        columns: Over all samples, each ``(samples,)``; a line through what is kept has their extremes.
        first: First sample that is shown.
        stop: One past the last.
        bins: Parts.
    """
    count = stop - first
    width = -(-count // bins)
    if width <= 2 * (1 + len(columns)):
        return np.arange(first, stop)
    begins = np.arange(first, stop, width)
    rows = [begins, np.array([stop - 1])]
    for column in columns:
        padded = np.full(len(begins) * width, np.nan)
        padded[:count] = column[first:stop]
        parts = padded.reshape(len(begins), width)
        for end, pick in ((np.inf, np.argmin), (-np.inf, np.argmax)):
            rows.append(begins + pick(np.where(np.isnan(parts), end, parts), axis=1))
    return np.unique(np.concatenate(rows))


def largest(column: Floats, begins: NDArray[np.int64]) -> Floats:
    """Return the largest value of each part of a column; NaN where it has none.

    Args:
        column: ``(samples,)``.
        begins: First sample of each part, ascending from 0.
    """
    maxima: Floats = np.maximum.reduceat(np.where(np.isnan(column), -np.inf, column), begins)
    return np.where(np.isfinite(maxima), maxima, np.nan)


STORED_BINS = 1500
"""Parts of the time axis of which the extremes are stored."""


def packed(series: Mapping[str, Mapping[str, Floats]]) -> bytes:
    """Return time series as the content of an ``.npz`` file.

    Args:
        series: By name, such as that of a drive: columns ``(samples,)`` by name, one of them ``time``. All of a series
            are thinned to the same samples (``thinned``) and kept with single precision, ``time`` with double.
    """
    arrays: dict[str, Any] = {}
    for i, (name, columns) in enumerate(series.items()):
        lines = [v for k, v in columns.items() if k != "time"]
        rows = thinned(lines, 0, len(columns["time"]), max(50, STORED_BINS // max(1, len(lines) // 4)))
        arrays[f"{i}/name"] = np.array(name)
        for k, values in columns.items():
            arrays[f"{i}/{k}"] = values[rows] if k == "time" else values[rows].astype(np.float32)
    file = io.BytesIO()
    np.savez_compressed(file, **arrays)
    return file.getvalue()


def unpacked(path: Path) -> dict[str, dict[str, Floats]]:
    """Return what ``packed`` wrote.

    Raises:
        UserError: If the file cannot be read.
    """
    series: dict[str, dict[str, Floats]] = {}
    refuse_special(path)
    try:
        with np.load(path, allow_pickle=False) as file:
            names = {key.partition("/")[0]: str(file[key]) for key in file.files if key.endswith("/name")}
            for number, name in names.items():
                own = [key for key in file.files if key.startswith(f"{number}/") and key != f"{number}/name"]
                series[name] = {key.partition("/")[2]: file[key] for key in own}
    except (OSError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise UserError(f"{path}: no time series that the harness wrote ({type(error).__name__}: {error})") from error
    return series
