"""ASAM MDF version 3 and 4, the format of CAN and calibration tools, through asammdf (extra ``mdf``).

Raw frames of CAN buses (ASAM bus logging) are decoded by the databases that the user names.
"""

from __future__ import annotations

import contextlib
import logging
import mmap
import os
import re
import struct
import tempfile
import zlib
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import refuse_beyond, refuse_damaged
from harness.recordings.readers._decode import decoded
from harness.recordings.readers._frames import EXTENDED, Frames, Part, joined
from harness.recordings.readers._table import LEAST_PACKED, MOST_BYTES, MOST_COLUMNS, MOST_PACKED, Table, Wanted

_DEFLATE = 1100
"""Bytes that a byte can be unpacked into at most (deflate)."""

_OF_A_BUS = re.compile(r"(CAN|LIN|FlexRay|FLX|Ethernet|ETH|K_LINE|MOST|USB)_[A-Z]\w*(\.\w+)?$")
_DATA = "CAN_DataFrame."
_OF_DLC = np.array([0, 1, 2, 3, 4, 5, 6, 7, 8, 12, 16, 20, 24, 32, 48, 64], dtype=np.uint8)
"""Bytes by the code for the length of a frame (ISO 11898-1)."""

_VIRTUAL = (3, 6)
"""Types of channels whose values follow from the number of a sample, so that no record holds them."""

_PACKED = struct.Struct("<26xB5xQQ")
"""Head of a packed block: how it is packed, bytes unpacked, bytes packed."""
_DEFLATED = (0, 1)

SUFFIXES = (".mf4", ".mdf", ".dat")


def read(path: str, wanted: Wanted | None = None, databases: Sequence[str] = ()) -> list[Table]:
    """Return the numeric channels in physical values, one table per channel group with its master as clock.

    A channel name that several groups hold becomes ``group.channel``, the group by the name of its acquisition (its
    number where it has none). Samples that the file marks as invalid are NaN; texts and arrays are left out. Signals of
    raw frames are named as in other bus logs; without a database frames are an error where there is nothing else.

    Raises:
        UserError: If asammdf is not installed, the file is damaged, or larger than any recording's.
    """
    try:
        from asammdf import MDF
    except ImportError:
        raise UserError(
            f'{path}: MDF files are read with asammdf, which is not installed: pip install "robustness-harness[mdf]"'
        ) from None
    log = logging.getLogger("asammdf")  # which it prints by itself
    log.handlers.clear()
    log.propagate = True
    with (
        tempfile.TemporaryDirectory(prefix="mdf-", ignore_cleanup_errors=True) as folder,  # asammdf leaves files behind
        refuse_damaged(path, "MDF file"),
    ):
        _refuse_circles(path)
        _refuse_packed(path)
        with MDF(path, temporary_folder=folder, process_bus_logging=False) as file:
            _refuse_sizes(file, path)
            tables, frames = _tables(file), _frames(file, path)
            begun = file.header.start_time.timestamp()
    if frames is not None and (databases or not tables):
        tables += decoded(path, frames, databases, wanted)
    elif databases and tables:
        note = "the file holds no raw frames, so that the database says nothing of it"
        tables[0] = replace(tables[0], notes=(*tables[0].notes, note))
    return [replace(table, begun=begun) for table in tables]


def _refuse_circles(path: str) -> None:
    """Refuse a file whose lists of groups lead back to themselves, which asammdf would follow for ever.

    Raises:
        ValueError: If one does.
    """
    with open(path, "rb") as stream:
        stream.seek(64)
        old = stream.read(2) == b"HD"  # version 3: 4-byte links, else 8-byte ones behind a head of 24 bytes
        width, first, behind, below = (4, 68, 4, 8) if old else (8, 88, 24, 32)

        def link(at: int) -> int:
            stream.seek(at)
            return int.from_bytes(stream.read(width), "little")

        def chain(at: int) -> Iterator[int]:
            seen = set()
            while at and at < 2**63:
                if at in seen:
                    raise ValueError(f"the list of its groups leads back to byte {at}")
                seen.add(at)
                yield at
                at = link(at + behind)

        for group in chain(link(first)):
            for _ in chain(link(group + below)):
                pass


def _refuse_packed(path: str) -> None:
    """Refuse a file whose packed blocks (``DZ``) hold more than they state, or more than any recording.

    Raises:
        UserError: If they hold more than any recording.
        ValueError: If one holds more than it states.
    """
    size, unpacked = os.path.getsize(path), 0
    with open(path, "rb") as stream, mmap.mmap(stream.fileno(), 0, access=mmap.ACCESS_READ) as content:
        at = content.find(b"##DZ")
        while 0 <= at <= size - _PACKED.size:
            kind, stated, packed = _PACKED.unpack_from(content, at)
            unpacked += stated
            refuse_beyond(path, "the file, unpacked,", unpacked, max(LEAST_PACKED, MOST_PACKED * size), "bytes")
            if kind in _DEFLATED:
                begin = at + _PACKED.size
                with contextlib.suppress(zlib.error):  # which asammdf says, if it is a block at all
                    part = zlib.decompressobj().decompress(content[begin : begin + packed], stated + 1)
                    if len(part) > stated:
                        raise ValueError(f"the packed block at byte {at} holds more than the {stated} that it states")
            at = content.find(b"##DZ", at + 1)


def _refuse_sizes(file: Any, path: str) -> None:
    """Refuse a file before room is made for its samples.

    Raises:
        UserError: If it is larger than any recording.
        ValueError: If a group claims more samples than the file can hold, or a channel bytes beyond the records, which
            asammdf would read from whatever memory lies there.
    """
    size, channels, values = os.path.getsize(path), 0, 0
    for index, group in enumerate(file.groups):
        about = group.channel_group
        claimed = about.cycles_nr * (about.samples_byte_nr + getattr(about, "invalidation_bytes_nr", 0))
        if claimed > _DEFLATE * size:
            raise ValueError(f"channel group {index} claims {claimed} bytes of samples in a file of {size}")
        for channel in group.channels:
            if _end(channel) > 8 * about.samples_byte_nr:
                raise ValueError(f"channel '{channel.name}' lies beyond the records of its group")
        channels += len(group.channels)
        values += len(group.channels) * about.cycles_nr
    refuse_beyond(path, "the file", channels, MOST_COLUMNS, "channels")
    refuse_beyond(path, "the file, unpacked,", 8 * values, MOST_BYTES, "bytes")


def _end(channel: Any) -> int:
    """Return the first bit of a record behind a channel of version 4 or 3; 0 of one that records do not hold."""
    if getattr(channel, "channel_type", 0) in _VIRTUAL:
        return 0
    if hasattr(channel, "start_offset"):
        begin = channel.start_offset + 8 * getattr(channel, "additional_byte_offset", 0)
    else:
        begin = 8 * channel.byte_offset + channel.bit_offset
    return int(begin + channel.bit_count)


def _tables(file: Any) -> list[Table]:
    """Return a table for each group with samples, the group with most channels first."""
    groups = [
        (index, [(place, channel.name) for place, channel in enumerate(group.channels)])
        for index, group in enumerate(file.groups)
    ]
    masters: dict[int, int] = file.masters_db
    counts = Counter(name for index, channels in groups for place, name in channels if place != masters.get(index))
    tables: list[Table] = []
    for index, channels in groups:
        if not file.groups[index].channel_group.cycles_nr or _is_bus(channels):  # of no samples asammdf reads for ever
            continue
        columns: dict[str, Floats] = {}
        units: dict[str, str] = {}
        label = str(getattr(file.groups[index].channel_group, "acq_name", "") or index)
        clock = f"{label}.time"
        for place, name in channels:
            if place == masters.get(index):
                continue
            signal = file.get(group=index, index=place, ignore_invalidation_bits=True)
            if signal.samples.ndim != 1 or signal.samples.dtype.kind not in "bfiu" or not len(signal.samples):
                continue
            values = signal.samples.astype(float)
            if signal.invalidation_bits is not None:
                values[np.asarray(signal.invalidation_bits, dtype=bool)] = np.nan
            full = name if counts[name] == 1 else f"{label}.{name}"
            full = full if full not in columns else f"{full}.{place}"
            columns[clock] = np.asarray(signal.timestamps, dtype=float)
            columns[full] = values
            units[full] = signal.unit or ""
        if columns:
            tables.append(Table(columns, {n: u for n, u in units.items() if u}, clock))
    return sorted(tables, key=lambda table: -len(table.columns))


def _is_bus(channels: Sequence[tuple[int, str]]) -> bool:
    """Return whether a group holds what came over a bus: ``CAN_DataFrame``, ``LIN_Frame``, errors of either."""
    return any(_OF_A_BUS.match(name) for _, name in channels)


def _frames(file: Any, path: str) -> Frames | None:
    """Return the data frames of all CAN buses, in the order of their stamps; ``None`` if there is none."""
    groups = [
        index
        for index, group in enumerate(file.groups)
        if group.channel_group.cycles_nr and any(c.name.startswith(_DATA) for c in group.channels)
    ]
    if not groups:
        return None
    frames = joined((_part(file, index) for index in groups), path, "MDF file")
    if len(groups) == 1:
        return frames
    order = np.argsort(frames.time, kind="stable")
    by_frame = ("time", "identifier", "bus", "length", "start")
    return replace(frames, **{name: getattr(frames, name)[order] for name in by_frame})


def _part(file: Any, index: int) -> Part:
    """Return the frames of a group (ASAM MDF 4.1, bus logging)."""
    places = {c.name.rpartition(".")[2]: i for i, c in enumerate(file.groups[index].channels)}
    wanted = [n for n in ("ID", "IDE", "DataBytes", "DataLength", "DLC", "BusChannel") if n in places]
    # All at once: asking for one by one unpacks the group each time.
    signals = file.select([(None, index, places[n]) for n in wanted], raw=True, copy_master=False)
    field = {n: signal.samples for n, signal in zip(wanted, signals, strict=True)}
    identifier = field["ID"].astype(np.uint32)
    extended = field["IDE"].astype(bool) if "IDE" in field else identifier & EXTENDED > 0
    identifier = (identifier & 0x1FFFFFFF) | np.where(extended, np.uint32(EXTENDED), np.uint32(0))
    octets = field["DataBytes"].reshape(len(identifier), -1)
    length = field["DataLength"] if "DataLength" in field else _OF_DLC[field["DLC"] & 15]
    bus = field["BusChannel"].astype(int) if "BusChannel" in field else np.ones(len(identifier), dtype=int)
    return signals[0].timestamps.astype(float), identifier, bus, length, octets
