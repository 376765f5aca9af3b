"""Racelogic VBO: text in sections; time as hhmmss.ss, latitude in minutes, longitude in minutes to the west."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import pandas as pd

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import refuse_beyond, refuse_damaged
from harness.recordings.readers._table import MOST_BYTES, MOST_COLUMNS, Table

SUFFIXES = (".vbo",)

_UNITS = {
    "velocity": "km/h",
    "heading": "deg",
    "height": "m",
    "vert-vel": "m/s",
    "lat": "deg",
    "long": "deg",
    "time": "s",
}
"""Units of the columns that every VBOX writes."""
_DAY = 86400.0
_LONGEST_HEAD = 100_000
"""Lines."""


def is_vbo(lines: Sequence[str]) -> bool:
    """Return whether lines of a text are those of a VBO file, whatever its suffix."""
    titles = {line.strip().lower() for line in lines if line.startswith("[")}
    return {"[column names]", "[data]"} <= titles


def read(path: str) -> list[Table]:
    """Return the columns, the time in s since midnight, latitude and longitude in degrees, positive to the east.

    Channels beyond those of the GPS have the units of ``[channel units]``.

    Raises:
        UserError: If a section is missing, or rows are no numbers.
    """
    sections: dict[str, list[str]] = {}
    title = ""
    with refuse_damaged(path, "VBO file"), open(path, encoding="latin-1", newline=None) as file:
        for before, line in enumerate(file, 1):
            refuse_beyond(path, "the head of the file", before, _LONGEST_HEAD, "lines")
            refuse_beyond(path, "a line", len(line), 2**20, "bytes")
            line = line.strip()
            if line.startswith("["):
                title = line.strip("[]").lower()
                sections.setdefault(title, [])
            elif line:
                sections.setdefault(title, []).append(line)
            if title == "data":
                break
        names = " ".join(sections.get("column names", [])).split()
        if title != "data" or not names:
            raise UserError(f"{path}: lacks [column names] or [data], as a VBO file has them; export it again")
        refuse_beyond(path, "the table", len(names), MOST_COLUMNS, "columns")
        rows = pd.read_csv(file, sep=r"\s+", header=None, names=names, index_col=False, dtype=str, on_bad_lines="error")
        refuse_beyond(path, "the table", 8 * rows.size, MOST_BYTES, "bytes")
    columns: dict[str, Floats] = {}
    for name in names:
        text = rows[name].str.replace(",", ".", regex=False)
        values = pd.to_numeric(text, errors="coerce").to_numpy(dtype=float, na_value=np.nan)
        odd = np.flatnonzero(np.isnan(values) & rows[name].notna().to_numpy())
        if odd.size:
            raise UserError(
                f"{path}: column '{name}', row {odd[0] + 1} of the data: {rows[name][odd[0]]!r} is no number"
            )
        columns[name] = _converted(path, name, values)
    units = {name: _UNITS[name] for name in names if name in _UNITS}
    for line in sections.get("header", []):
        if line.lower().startswith("velocity "):
            units["velocity"] = line.split(maxsplit=1)[1]
    stated = sections.get("channel units", [])
    units |= dict(zip(names[len(names) - len(stated) :], stated, strict=True)) if len(stated) < len(names) else {}
    return [Table(columns, {n: u for n, u in units.items() if n in columns}, "time" if "time" in columns else None)]


def _converted(path: str, name: str, values: Floats) -> Floats:
    """Return time in s and places in degrees; other columns as they are.

    Raises:
        UserError: If a time has 60 or more minutes or seconds.
    """
    if name == "time":
        minutes, seconds = values // 100 % 100, values % 100
        if (minutes >= 60).any() or (seconds >= 60).any():
            raise UserError(f"{path}: column 'time' is no time of day, hhmmss.ss; export the file again")
        time = 3600.0 * (values // 10000) + 60.0 * minutes + seconds
        with np.errstate(invalid="ignore"):
            return time + _DAY * np.concatenate([[0.0], np.cumsum(np.diff(time) < -_DAY / 2)])[: len(time)]
    return values / {"lat": 60.0, "long": -60.0}[name] if name in ("lat", "long") else values
