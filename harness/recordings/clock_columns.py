"""Which columns of a table are its clock, in which unit, and the rows of a part of it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.units import scale
from harness.recordings import readers
from harness.recordings.channels import is_measured
from harness.recordings.column_names import TIME, read_name
from harness.recordings.span import Span


def seconds_of(table: readers.Table, clocks: Sequence[tuple[str, str, str]]) -> Floats | None:
    """Return the instants of a table in s; None where it has no clock."""
    return table.columns[clocks[0][0]] * scale(clocks[0][1], "s", "time") if clocks else None


def filled(table: readers.Table) -> readers.Table:
    """Return a table with values joined over the rows of other messages, so that columns can be compared row by row."""
    columns, rows = {}, np.arange(len(next(iter(table.columns.values()))))
    for name, values in table.columns.items():
        known = np.flatnonzero(is_measured(values))
        columns[name] = np.where(is_measured(values), values, np.nan)
        if 1 < len(known) < len(rows):
            columns[name] = np.interp(rows, known, values[known], left=np.nan, right=np.nan)
    return replace(table, columns=columns)


def clocks_of(table: readers.Table) -> list[tuple[str, str, str]]:
    """Return the clock of a table; where its vectors are those of several structures, that of each which has one.

    Clocks of one recording run at the same time; a time of day beside it is none.
    """
    native = None if table.clock not in table.columns else _clock(table, [str(table.clock)])
    if native is not None:
        return [native]
    of_structures: dict[str, list[str]] = {}
    for column in table.columns:
        if TIME.search(read_name(column).words):
            of_structures.setdefault(column.rpartition(".")[0], []).append(column)
    found = [c for c in (_clock(table, columns) for columns in of_structures.values()) if c is not None]
    spans = [np.nanquantile(table.columns[column], [0.0, 1.0]) * scale(unit, "s", "time") for column, unit, _ in found]
    return [c for c, (begin, end) in zip(found, spans, strict=True) if begin <= spans[0][1] and end >= spans[0][0]]


def _clock(table: readers.Table, columns: Sequence[str]) -> tuple[str, str, str] | None:
    """Return the first of some columns that rises as a clock does, its unit and why."""
    for column in columns:
        steps = np.diff(table.columns[column])
        steps = steps[np.isfinite(steps)]
        if len(steps) < 2 or (steps < 0).mean() > 0.01:
            continue
        if column == table.clock:
            return column, "s", "the format says so"
        stated, step = read_name(column, table.units.get(column, "")).unit, float(np.median(steps))
        if stated is not None and stated.si == "s":
            return column, stated.text, f"unit by the {stated.by}"
        for unit, largest in (("s", 1.0), ("ms", 500.0), ("us", 5e5), ("ns", 5e8)):
            if step <= largest:
                return column, unit, f"rises by {step:g} from row to row, unit by that: {_rate(step, unit)}"
    return None


def _rate(step: float, unit: str) -> str:
    seconds = step * {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[unit]
    return f"{1 / seconds:.4g} Hz" if seconds > 0 else "several rows at a time"


def cut(table: readers.Table, seconds: Floats | None, span: Span, said: Path) -> readers.Table:
    """Return the rows of a table in a span, counted from its first stamp."""
    if seconds is None:
        raise UserError(f"{said}: there is no clock, so no part of it can be told; propose a map of the whole file")
    since = seconds - seconds[np.isfinite(seconds)][0]
    rows = (since >= span[0]) & (since < span[1])
    if rows.sum() < 2:
        raise UserError(f"{said}: the recording runs from 0 to {np.nanmax(since):.2f} s; there is nothing in that span")
    return replace(table, columns={name: values[rows] for name, values in table.columns.items()})
