"""Apache Parquet, through pyarrow."""

from __future__ import annotations

import pyarrow as pa
import pyarrow.parquet as pq

from harness.common.arrays import Floats
from harness.common.files import refuse_beyond, refuse_damaged
from harness.recordings.readers._table import MOST_BYTES, MOST_COLUMNS, Table

SUFFIXES = (".parquet", ".pq")


def read(path: str) -> list[Table]:
    """Return the numeric and boolean columns of a Parquet file; nulls are NaN, other columns are left out.

    A unit is the entry ``unit`` of the metadata of a column.

    Raises:
        UserError: If the file is no Parquet file.
    """
    with refuse_damaged(path, "Parquet file"):
        # One file is meant: pq.read_table would read "speed=3" in the path as a partition.
        file = pq.ParquetFile(path)
        about = file.metadata
        refuse_beyond(path, "the table", about.num_columns, MOST_COLUMNS, "columns")
        refuse_beyond(path, "the table", 8 * about.num_columns * about.num_rows, MOST_BYTES, "bytes")
        table = file.read()
    columns: dict[str, Floats] = {}
    units: dict[str, str] = {}
    for field, column in zip(table.schema, table.columns, strict=True):
        kind = field.type
        if pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_boolean(kind):
            columns[field.name] = column.cast(pa.float64()).to_numpy().copy()
            if unit := (field.metadata or {}).get(b"unit", b"").decode(errors="replace"):
                units[field.name] = unit
    return [Table(columns, units)]
