"""Measured data that are in memory already: a pandas DataFrame or an xarray Dataset in place of a file."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.units import scale
from harness.models.signals import SIGNALS, TRUTH
from harness.recordings.readers import Table

CLOCK = "time"


def name_of(source: pd.DataFrame | xr.Dataset) -> str:
    """Return the name of a frame or dataset in errors and reports: its attribute ``name``, else its type."""
    return str(source.attrs.get("name") or type(source).__name__)


def tables_of(source: pd.DataFrame | xr.Dataset, mapped: bool) -> list[Table]:
    """Return the numeric columns of a frame or dataset as a reader returns those of a file.

    Args:
        source: A frame of one row per sample, with ``time`` in s as column or index, or an index of times; units by
            column in ``attrs["units"]``. Or a dataset whose variables have one dimension, of which the coordinate is
            the time, with units in the attribute ``units`` of each.
        mapped: Whether a channel map names the columns. Without one a column with the name of a signal is
            converted from its stated unit.

    Returns:
        One table per clock, the one with most columns first.

    Raises:
        UserError: If it is neither, there is no numeric column with a row, or a stated unit does not fit.
    """
    if not isinstance(source, pd.DataFrame | xr.Dataset):
        raise UserError(f"a recording is a path, a pandas DataFrame or an xarray Dataset, not {type(source).__name__}")
    parts = _of_frame(source) if isinstance(source, pd.DataFrame) else _of_dataset(source)
    tables = [t for t in parts if len(t.columns) > (t.clock is not None) and len(next(iter(t.columns.values())))]
    if not tables:
        raise UserError(f"{type(source).__name__}: holds no numeric column with a row of data")
    tables.sort(key=lambda t: -len(t.columns))
    return tables if mapped else [_signals_in_si(t, type(source).__name__) for t in tables]


def _of_frame(frame: pd.DataFrame) -> list[Table]:
    columns = {str(name): v for name in frame.columns if (v := _numbers(frame[name].to_numpy())) is not None}
    clock = None
    index = frame.index
    if isinstance(index, pd.DatetimeIndex | pd.TimedeltaIndex) or (index.name == CLOCK and CLOCK not in columns):
        clock, columns = CLOCK, {CLOCK: _seconds(index.to_numpy()), **columns}
    stated = frame.attrs.get("units", {})
    units = {str(k): str(v) for k, v in stated.items()} if isinstance(stated, Mapping) else {}
    return [Table(columns, units, clock)]


def _of_dataset(dataset: xr.Dataset) -> list[Table]:
    tables = []
    for dim in dict.fromkeys(str(d) for v in dataset.data_vars.values() for d in v.dims if v.ndim == 1):
        columns, units, clock = {}, {}, None
        if dim in dataset.coords:
            clock, columns[dim] = dim, _seconds(dataset[dim].to_numpy())
        for name, variable in dataset.data_vars.items():
            if variable.dims == (dim,) and (values := _numbers(variable.to_numpy())) is not None:
                columns[str(name)] = values
                units[str(name)] = str(variable.attrs.get("units", ""))
        tables.append(Table(columns, units, clock))
    return tables


def _numbers(values: Any) -> Floats | None:
    """Return numbers and truth values as floats, missing ones as NaN; ``None`` for anything else."""
    if np.issubdtype(values.dtype, np.timedelta64) or np.issubdtype(values.dtype, np.datetime64):
        return None
    try:
        return None if values.dtype.kind in "US" else np.array(pd.Series(values).astype(float))
    except (TypeError, ValueError):
        return None


def _seconds(stamps: Any) -> Floats:
    """Return time stamps in s: dates and durations since the first one, numbers as they are."""
    if stamps.dtype.kind in "mM":
        return np.asarray((stamps - stamps[0]) / np.timedelta64(1, "ns") * 1e-9, dtype=float)
    return np.array(stamps, dtype=float)


def _signals_in_si(table: Table, what: str) -> Table:
    """Return a table with every column that is named after a signal in SI units."""
    columns, units = dict(table.columns), dict(table.units)
    for name, unit in table.units.items():
        signal = SIGNALS.get(name.removeprefix(TRUTH))
        if signal is None or not unit or unit == signal.unit:
            continue
        columns[name] = columns[name] * scale(unit, signal.unit, f"{what}: units of '{name}'")
        units[name] = signal.unit
    return Table(columns, units, table.clock)
