"""TYDEX 1.3: a measurement of a tyre, as text in sections that begin with two stars."""

from __future__ import annotations

import math

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import refuse_beyond, refuse_damaged
from harness.recordings.readers._table import MOST_BYTES, MOST_COLUMNS, Table

SUFFIXES = (".tdx",)

_FIELDS = ((40, 50), (50, 60), (60, 70), (70, 80))
"""Columns of a line of MEASURCHANNELS: unit, factor, offsets of the measured and the physical value; the name has the
first ten."""
_MISSING = "NOTAVAIL"


def read(path: str) -> list[Table]:
    """Return the channels of a measurement times their factors, ``RUNTIME`` as the clock.

    Raises:
        UserError: If the file is of another format, states an offset, or a row is not as long as the list of channels.
    """
    factors: dict[str, float] = {}
    units: dict[str, str] = {}
    rows: list[list[float]] = []
    section = ""
    with refuse_damaged(path, "TYDEX file"), open(path, encoding="latin-1") as file:
        for number, line in enumerate(file, 1):
            refuse_beyond(path, "a line", len(line), 2**20, "bytes")
            line = line.rstrip().expandtabs()
            if line.startswith("**"):
                section = line.strip("* ").upper()
            elif number == 1 or not section:
                break
            elif not line.strip() or line.startswith("!"):
                continue
            elif section == "MEASURCHANNELS":
                name = line[:10].strip()
                factors[name], units[name] = _channel(path, number, name, line)
                refuse_beyond(path, "the table", len(factors), MOST_COLUMNS, "channels")
            elif section.startswith("MEASURDATA"):
                rows.append(_row(path, number, line, len(factors)))
                refuse_beyond(path, "the table", 8 * len(rows) * len(factors), MOST_BYTES, "bytes")
    if not section:
        raise UserError(f"{path}: is no TYDEX file, which begins with **HEADER; export that of DIAdem as TDMS")
    if not rows:
        raise UserError(f"{path}: has no rows behind **MEASURCHANNELS and **MEASURDATA; export the measurement again")
    table: Floats = np.array(rows)
    columns = {name: factor * table[:, i] for i, (name, factor) in enumerate(factors.items())}
    return [Table(columns, {n: u for n, u in units.items() if u}, "RUNTIME" if units.get("RUNTIME") == "s" else None)]


def _channel(path: str, number: int, name: str, line: str) -> tuple[float, str]:
    """Return the factor of a channel, 1 where none is stated, and its unit."""
    unit, *numbers = (line[begin:end].strip() for begin, end in _FIELDS)
    factor, *offsets = (_number(path, number, text or default) for text, default in zip(numbers, "100", strict=True))
    if any(offsets) or not factor:
        raise UserError(
            f"{path}: line {number}: {name} has the factor {factor:g} and the offsets {offsets[0]:g}, {offsets[1]:g}; "
            "only a factor is read: export physical values"
        )
    return factor, unit


def _row(path: str, number: int, line: str, channels: int) -> list[float]:
    words = line.split()
    if len(words) != channels:
        raise UserError(f"{path}: line {number} has {len(words)} values for {channels} channels; export the file again")
    return [math.nan if word == _MISSING else _number(path, number, word) for word in words]


def _number(path: str, number: int, text: str) -> float:
    try:
        return float(text.replace("_", "?"))  # Python takes an underscore between digits
    except ValueError:
        raise UserError(f"{path}: line {number}: '{text}' is no number; export the file again") from None
