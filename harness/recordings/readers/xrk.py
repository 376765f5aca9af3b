"""AiM XRK and XRZ, through libxrk (extra ``racing``)."""

from __future__ import annotations

import contextlib
import io
import zlib
from pathlib import Path

import numpy as np
import pyarrow as pa

from harness.common.errors import UserError
from harness.common.files import refuse_beyond, refuse_damaged
from harness.recordings.readers._table import MOST_BYTES, MOST_COLUMNS, Table

SUFFIXES = (".xrk", ".xrz")

_MOST_UNPACKED = 100
"""Bytes that a byte of an XRZ file may be unpacked into on average."""


def read(path: str) -> list[Table]:
    """Return the numeric channels, one table for those that share their stamps.

    Raises:
        UserError: If libxrk is not installed, the file is damaged, or larger than any recording's.
    """
    try:
        from libxrk import ChannelMetadata, aim_xrk
    except ImportError:
        raise UserError(
            f'{path}: XRK files are read with libxrk, which is not installed: pip install "robustness-harness[racing]"'
        ) from None
    content = Path(path).read_bytes()
    tables: dict[bytes, Table] = {}
    with refuse_damaged(path, "XRK file"):
        if content[:1] == b"\x78":  # XRZ; libxrk would unpack it without a bound
            most = min(max(_MOST_UNPACKED * len(content), 64 * 2**20), MOST_BYTES)
            content = zlib.decompressobj().decompress(content, most + 1)
            refuse_beyond(path, "the file, unpacked,", len(content), most, "bytes")
        with contextlib.redirect_stdout(io.StringIO()):
            channels = aim_xrk(content).channels  # prints by itself
        refuse_beyond(path, "the file", len(channels), MOST_COLUMNS, "channels")
        for name, channel in channels.items():
            values = channel.column(name)
            if not (pa.types.is_integer(values.type) or pa.types.is_floating(values.type)) or len(values) < 2:
                continue
            stamps = channel.column("timecodes").to_numpy()
            key = stamps.tobytes()
            if key not in tables:
                tables[key] = Table({f"{name}.time": np.asarray(stamps * 1e-3, dtype=float)}, clock=f"{name}.time")
            tables[key].columns[name] = np.asarray(values.cast(pa.float64()).to_numpy(), dtype=float)
            if unit := ChannelMetadata.from_field(channel.schema.field(name)).units:
                tables[key].units[name] = unit
    return sorted(tables.values(), key=lambda table: -len(table.columns))
