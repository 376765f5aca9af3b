"""Frames of CAN buses as loggers store them: stamps, identifiers and bytes, undecoded."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import refuse_beyond
from harness.recordings.readers._table import MOST_BYTES

EXTENDED = 1 << 31
"""Bit that marks an identifier of 29 bits."""

_LISTED = 12
"""Identifiers that a sentence names, the most frequent first."""
_BYTES = 40
"""That a frame takes in memory in addition to its payload."""


@dataclass(frozen=True)
class Frames:
    """Data frames in the order of the file.

    Attributes:
        time: s, stamps ``(frames,)``.
        identifier: Of 11 bits, or of 29 bits with ``EXTENDED``, ``(frames,)``.
        bus: Number of the bus in ``buses`` ``(frames,)``.
        buses: Names of the buses as the file has them.
        length: Bytes of data ``(frames,)``.
        start: Place of the first of them in ``payload`` ``(frames,)``.
        payload: Bytes of all frames.
    """

    time: Floats
    identifier: NDArray[np.uint32]
    bus: NDArray[np.int16]
    buses: tuple[str, ...]
    length: NDArray[np.uint8] | NDArray[np.uint16]
    start: NDArray[np.int64]
    payload: NDArray[np.uint8]


Part = tuple[Floats, NDArray[Any], NDArray[Any], NDArray[Any], NDArray[Any]]
"""Some frames: stamps, identifiers, numbers of their bus, lengths, and bytes ``(frames, longest)``."""


def joined(parts: Iterable[Part], path: str, what: str, name: Callable[[int], str] = str) -> Frames:
    """Return the frames of the parts of a file.

    Args:
        parts: In the order of the file.
        path: File, for errors.
        what: Format, such as ``BLF file``.
        name: Gives the name of a bus by its number, once all parts are read.

    Raises:
        UserError: If there is no frame, or more than any recording holds.
    """
    columns: list[list[Any]] = [[] for _ in range(6)]
    places: dict[int, int] = {}
    held = 0
    for time, identifier, bus, length, octets in parts:
        own, inverse = np.unique(bus, return_inverse=True)
        numbers = np.array([places.setdefault(number, len(places)) for number in own.tolist()], dtype=np.int16)
        width = octets.shape[1]
        start = held + np.arange(len(time), dtype=np.int64) * width
        used = np.minimum(length, width).astype(np.uint8)
        arrays = (time, identifier.astype(np.uint32), numbers[inverse], used, start, octets.astype(np.uint8).ravel())
        for column, values in zip(columns, arrays, strict=True):
            column.append(values)
        held += octets.size
        refuse_beyond(path, "the bus log", held + _BYTES * sum(map(len, columns[0])), MOST_BYTES, "bytes")
    if not held and not any(map(len, columns[0])):
        raise UserError(f"{path}: holds no CAN frame with data; is this the {what} of a CAN bus?")
    time, identifier, bus, length, start, payload = (np.concatenate(column) for column in columns)
    return Frames(time, identifier, bus, tuple(map(name, places)), length, start, payload)


def in_hex(identifier: int) -> str:
    """Return an identifier as loggers print it: three digits of 11 bits, eight of 29."""
    return f"0x{identifier ^ EXTENDED:08X}" if identifier & EXTENDED else f"0x{identifier:03X}"


def identifiers_in_words(frames: Frames, chosen: NDArray[np.bool_] | None = None) -> str:
    """Return the identifiers of some frames, all by default, with their rates in frames per s."""
    rows = np.arange(len(frames.time)) if chosen is None else np.flatnonzero(chosen)
    key = frames.bus[rows].astype(np.int64) << 32 | frames.identifier[rows]
    keys, counts = np.unique(key, return_counts=True)
    lasts = float(np.ptp(frames.time)) if len(frames.time) else 0.0
    words = []
    for at in np.argsort(-counts, kind="stable")[:_LISTED]:
        bus = f"{frames.buses[keys[at] >> 32]}: " if len(frames.buses) > 1 else ""
        rate = f"{counts[at] / lasts:.3g}/s" if lasts > 0 else f"{counts[at]}"
        words.append(f"{bus}{in_hex(int(keys[at]) & 0xFFFFFFFF)} ({rate})")
    return ", ".join(words) + (f" and {len(keys) - _LISTED} more" if len(keys) > _LISTED else "")


def named_database(path: str, frames: Frames) -> UserError:
    """Return the error of a bus log without a database: which file is needed, and what is in the log."""
    return UserError(
        f"{os.fspath(path)}: is a bus log of {len(frames.time):,} raw frames; name the database that says what they "
        "hold (DBC, ARXML, KCD or SYM, of the maker of the vehicle or sensor): --database FILE, or "
        f'database = "FILE" in the channel map. Identifiers on the bus: {identifiers_in_words(frames)}'
    )
