"""Long form: rows of time, name and value, a column for each name.

A row of the table that results holds what came at one stamp, NaN where a signal did not; a name that comes twice at a
stamp begins a further row.
"""

from __future__ import annotations

import csv
import re
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
import pandas as pd

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import refuse_beyond
from harness.recordings.readers._layout import MISSING, Layout, cells_of, is_data, is_number
from harness.recordings.readers._table import MOST_BYTES, MOST_COLUMNS, Table

_NAMES = re.compile(
    r".*name|signal|channel|variable|parameter|topic|key|field|measurement|metric|label|tag|series|sensor"
)
_VALUES = re.compile(r"(signal|phys(ical)?)?(value|val|reading|wert|messwert)")
_TIMES = re.compile(r"t|.*(time|stamp|zeit).*|seconds?|secs?")
_UNITS = re.compile(r"units?|einheit")


@dataclass(frozen=True)
class LongForm:
    """Which column of a table in long form is what."""

    time: str
    name: str
    value: str
    unit: str = ""

    @property
    def texts(self) -> list[str]:
        """Columns of text that it takes."""
        return [self.name, self.unit] if self.unit else [self.name]


def long_form(layout: Layout, head: list[str]) -> LongForm | None:
    """Return the columns of a table in long form by their names; None if it is none."""
    places: dict[str, str] = {}
    for kind, pattern in (("value", _VALUES), ("time", _TIMES), ("unit", _UNITS), ("name", _NAMES)):
        for name in layout.names:
            if name not in places.values() and pattern.fullmatch(re.sub(r"[^a-z]", "", name.lower())):
                places.setdefault(kind, name)
    try:
        rows = [cells_of(line, layout.separator) for line in head[layout.before :] if is_data(line)]
    except csv.Error:
        return None
    if "time" in places and "name" not in places and len(layout.names) == 3:
        places = {"time": places["time"]} | _by_rows(places["time"], layout, rows)
    if not {"time", "name", "value"} <= set(places):
        return None
    for kind, text in (("name", True), ("value", False)):
        place = layout.names.index(places[kind])
        cells = [row[place] for row in rows if len(row) > place and row[place] not in MISSING]
        if not cells or text == any(is_number(c, layout.decimal) for c in cells):
            return None
    return LongForm(**places)


def _by_rows(time: str, layout: Layout, rows: list[list[str]]) -> dict[str, str]:
    """Return name and value of three columns, where stamps repeat for several names; else nothing."""
    stamps = [row[layout.names.index(time)] for row in rows if len(row) == 3]
    again = sum(a == b for a, b in pairwise(stamps))
    first, second = (name for name in layout.names if name != time)
    columns = ([row[layout.names.index(n)] for row in rows if len(row) == 3] for n in (first, second))
    texts = [not any(is_number(cell, layout.decimal) for cell in column) for column in columns]
    if 3 * again < len(stamps) or len(stamps) < len(rows) or texts[0] == texts[1]:
        return {}
    return {"name": first, "value": second} if texts[0] else {"name": second, "value": first}


def pivoted(path: str, form: LongForm, numbers: dict[str, Floats], texts: pd.DataFrame) -> Table:
    """Return a column for each name, in addition to the time.

    Args:
        path: The file, for errors.
        form: Its columns.
        numbers: Time and value ``(rows,)``.
        texts: Names, and units where there are any, of the same rows.

    Raises:
        UserError: If there are no times or values, or more names than a recording has.
    """
    for column in (form.time, form.value):
        if column not in numbers:
            raise UserError(f"{path}: column '{column}' holds no number; write it as one")
    frame = pd.DataFrame({"time": numbers[form.time], "value": numbers[form.value], "name": texts[form.name]})
    frame = frame[frame["time"].notna() & frame["name"].notna()].sort_values("time", kind="stable")
    names = list(pd.unique(frame["name"]))
    refuse_beyond(path, "the table", len(names), MOST_COLUMNS, "names")
    again = frame.groupby(["time", "name"], observed=True).cumcount().to_numpy()
    rows = pd.MultiIndex.from_arrays([frame["time"], again])
    keys = rows.unique().sort_values()
    refuse_beyond(path, "the table, a column for each name,", 8 * len(keys) * len(names), MOST_BYTES, "bytes")
    place = keys.get_indexer(rows)
    columns = {form.time: np.asarray(keys.get_level_values(0), dtype=float)}
    units: dict[str, str] = {}
    for name in names:
        own = (frame["name"] == name).to_numpy()
        columns[str(name)] = np.full(len(keys), np.nan)
        columns[str(name)][place[own]] = frame["value"].to_numpy()[own]
        if form.unit:
            stated = texts[form.unit][frame.index[own]].dropna()
            units |= {str(name): str(stated.iloc[0])} if len(stated) else {}
    return Table(columns, units)
