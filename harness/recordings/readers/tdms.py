"""National Instruments TDMS, through npTDMS (extra ``racing``)."""

from __future__ import annotations

import logging
import os
from collections import Counter

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import refuse_beyond, refuse_damaged
from harness.recordings.readers._table import MOST_BYTES, MOST_COLUMNS, Table

SUFFIXES = (".tdms",)

_MOST_OF_A_BYTE = 8
"""Values that a byte holds at most, those of digital lines."""


def read(path: str) -> list[Table]:
    """Return the numeric channels, one table for those of a group with one length and step.

    A name that several groups hold becomes ``group.channel``. Where a channel states its step, ``group.time`` is the
    clock in s.

    Raises:
        UserError: If npTDMS is not installed, the file is damaged, or larger than any recording's.
    """
    try:
        from nptdms import TdmsFile
        from nptdms.log import log_manager
    except ImportError:
        raise UserError(
            f'{path}: TDMS files are read with npTDMS, which is not installed: pip install "robustness-harness[racing]"'
        ) from None
    log_manager.set_level(logging.CRITICAL)  # which prints by itself
    tables: dict[tuple[str, int, float, float], Table] = {}
    with refuse_damaged(path, "TDMS file"), TdmsFile.open(path) as file:
        channels = [channel for group in file.groups() for channel in group.channels()]
        refuse_beyond(path, "the file", len(channels), MOST_COLUMNS, "channels")
        claimed = sum(map(len, channels))
        if claimed > _MOST_OF_A_BYTE * os.path.getsize(path):
            raise ValueError(f"it claims {claimed} values in {os.path.getsize(path)} bytes")
        refuse_beyond(path, "the file, unpacked,", 8 * claimed, MOST_BYTES, "bytes")
        names = Counter(channel.name for channel in channels)
        for channel in channels:
            if channel.dtype.kind not in "bfiu" or len(channel) < 2:
                continue
            about = channel.properties
            start, step = (float(about.get(key, 0.0)) for key in ("wf_start_offset", "wf_increment"))
            table = tables.setdefault((channel.group_name, len(channel), start, step), Table({}))
            if step > 0 and not table.columns:
                clock = f"{channel.group_name}.time" if _is_new(channel.group_name, tables) else f"{channel.name}.time"
                table.columns[clock] = start + step * np.arange(len(channel), dtype=float)
                table = tables[channel.group_name, len(channel), start, step] = Table(table.columns, table.units, clock)
            name = channel.name if names[channel.name] == 1 else f"{channel.group_name}.{channel.name}"
            table.columns[name] = _numbers(channel[:])
            if unit := str(about.get("unit_string") or about.get("NI_UnitDescription") or ""):
                table.units[name] = unit
    return sorted(tables.values(), key=lambda table: -len(table.columns))


def _is_new(group: str, tables: dict[tuple[str, int, float, float], Table]) -> bool:
    """Return whether no table has the clock that is named after a group."""
    return all(f"{group}.time" not in table.columns for table in tables.values())


def _numbers(values: object) -> Floats:
    return np.asarray(values, dtype=float)
