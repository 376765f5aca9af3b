"""Binary logs (BLF) of CAN tools by Vector, all frames of a block at once.

The layout is that of python-can's ``BLFReader``, which takes each frame by itself.
"""

from __future__ import annotations

import os
import re
import struct
import zlib
from collections.abc import Iterator, Sequence
from typing import Any, BinaryIO, NamedTuple

import numpy as np
from numpy.typing import NDArray

from harness.common.files import refuse_beyond, refuse_damaged
from harness.recordings.readers._decode import decoded
from harness.recordings.readers._frames import EXTENDED, Part, joined
from harness.recordings.readers._table import LEAST_PACKED, MOST_PACKED, Table, Wanted

SUFFIXES = (".blf",)

_LARGEST = 256 * 2**20
"""Bytes of one block; 128 KiB is usual."""
_LONGEST = 16 * 2**20
"""Bytes of one object."""
_GAP = 4
"""Bytes that may lie between two objects."""
_CONTAINER, _CLASSIC, _FD, _FD_64 = 10, (1, 86), (100,), (101,)
_HEADER = np.dtype("S4, <u2, <u2, <u4, <u4, <u4, <u4, <u8")
_HEADER.names = ("mark", "head", "version", "size", "kind", "flags", "client", "ticks")
_TEN_MICROSECONDS = 1


class _Layout(NamedTuple):
    """A frame within an object: where its fields are, how many bytes follow them, and the bit of a remote frame."""

    fields: np.dtype[Any]
    data: int
    remote: int


def _layout(remote: int, data: int, **places: tuple[int, str]) -> _Layout:
    names, offsets = list(places), [at for at, _ in places.values()]
    formats = [form for _, form in places.values()]
    return _Layout(np.dtype({"names": names, "formats": formats, "offsets": offsets}), data, remote)


_FRAMES = {
    _CLASSIC: _layout(0x80, 8, bus=(0, "<u2"), flags=(2, "u1"), length=(3, "u1"), id=(4, "<u4")),
    _FD: _layout(0x80, 20, bus=(0, "<u2"), flags=(2, "u1"), length=(14, "u1"), id=(4, "<u4")),
    _FD_64: _layout(0x10, 40, bus=(0, "u1"), flags=(12, "<u4"), length=(2, "u1"), id=(4, "<u4")),
}


def read(path: str, wanted: Wanted | None = None, databases: Sequence[str] = ()) -> list[Table]:
    """Return the signals of the messages that the databases describe, in s since the measurement began.

    Error and remote frames are left out, and so is what is no CAN.

    Raises:
        UserError: If the file is damaged, a database cannot be read, or none fits.
    """
    with refuse_damaged(path, "BLF file"), open(path, "rb") as stream:
        frames = joined(_parts(_blocks(stream, path)), path, "BLF file")
    return decoded(path, frames, databases, wanted)


def _blocks(stream: BinaryIO, path: str) -> Iterator[bytes]:
    """Yield the unpacked blocks of a file.

    Raises:
        UserError: If they are larger than any recording's.
        ValueError: If it is no BLF file.
    """
    size = os.path.getsize(path)
    head = stream.read(8)
    if head[:4] != b"LOGG":
        raise ValueError("does not begin with LOGG")
    stream.seek(struct.unpack("<4xL", head)[0])
    unpacked = 0
    while len(head := stream.read(16)) == 16:
        mark, _, _, length, kind = struct.unpack("<4sHHLL", head)
        if mark != b"LOBJ" or length < 16:
            raise ValueError(f"no object at byte {stream.tell() - 16}")
        content = stream.read(length - 16)
        stream.read(length % 4)
        if kind != _CONTAINER or len(content) < 16:  # a logger without power leaves part of a block
            continue
        method, stated = struct.unpack_from("<H6xL4x", content)
        block = content[16:]
        if method:
            unpacker = zlib.decompressobj()
            block = unpacker.decompress(block, max(1, min(stated, _LARGEST)))
            if unpacker.unconsumed_tail and not unpacker.eof and unpacker.decompress(unpacker.unconsumed_tail, 1):
                raise ValueError(f"a block unpacks into more than the {stated} bytes that it states")
        unpacked += len(block)
        refuse_beyond(path, "the file, unpacked,", unpacked, max(LEAST_PACKED, MOST_PACKED * size), "bytes")
        yield block


def _parts(blocks: Iterator[bytes]) -> Iterator[Part]:
    """Yield the frames of each block; an object may end in the next one.

    Raises:
        ValueError: If objects do not follow each other.
    """
    rest = b""
    for block in blocks:
        data = rest + block
        places, end = _objects(data)
        rest = data[end:]
        if len(rest) > _LONGEST:
            raise ValueError(f"an object of more than {_LONGEST} bytes")
        octets = np.frombuffer(data, dtype=np.uint8)
        head = _records(octets, places, _HEADER)
        for kinds, layout in _FRAMES.items():
            chosen = np.isin(head["kind"], kinds) & np.isin(head["version"], (1, 2))
            if chosen.any():
                yield _frames(octets, places[chosen], head[chosen], layout)


def _objects(data: bytes) -> tuple[NDArray[np.int64], int]:
    """Return where the whole objects of some bytes begin, and where the last of them ends."""
    marks = np.fromiter((m.start() for m in re.finditer(b"LOBJ", data)), dtype=np.int64)
    marks = marks[marks + _HEADER.itemsize <= len(data)]
    if not marks.size or marks[0] > _GAP:
        if len(data) > _GAP + _HEADER.itemsize:
            raise ValueError("a block does not begin with an object")
        return marks[:0], 0
    sizes = _records(np.frombuffer(data, dtype=np.uint8), marks, _HEADER)["size"].astype(np.int64)
    ends = marks + np.maximum(sizes, _HEADER.itemsize)
    gaps = marks[1:] - ends[:-1]
    if ((gaps < 0) | (gaps > _GAP)).any():  # some bytes of data look like the mark
        follow = np.searchsorted(marks, ends).tolist()
        chain = [0]
        while (after := follow[chain[-1]]) < len(marks):
            if marks[after] - ends[chain[-1]] > _GAP:
                raise ValueError("an object does not follow the one before it")
            chain.append(after)
        marks, ends = marks[chain], ends[chain]
    whole = ends <= len(data)
    return marks[whole], int(ends[-1]) if whole.all() else int(marks[-1])


def _records(octets: NDArray[np.uint8], places: NDArray[np.int64], kind: np.dtype[Any]) -> NDArray[Any]:
    """Return the records that begin at some places."""
    rows = np.lib.stride_tricks.sliding_window_view(octets, kind.itemsize)[places]
    return np.ascontiguousarray(rows).view(kind)[:, 0]


def _frames(octets: NDArray[np.uint8], places: NDArray[np.int64], head: NDArray[Any], layout: _Layout) -> Part:
    """Return the data frames of objects of one kind."""
    begin = np.where(head["version"] == 2, 40, 32)
    room = head["size"].astype(np.int64) - begin - layout.data
    if (room < 0).any():
        raise ValueError("an object is too short for its frame")
    frame = _records(octets, places + begin, layout.fields)
    length = np.minimum(np.minimum(frame["length"], room), 8 if layout is _FRAMES[_CLASSIC] else 64)
    kept = np.flatnonzero((frame["flags"] & layout.remote) == 0)
    width = max(int(length.max()), 1)
    at = (places + begin + layout.data)[kept, None] + np.arange(width)
    ticks = head["ticks"] / np.where(head["flags"] == _TEN_MICROSECONDS, 1e5, 1e9)
    identifier = frame["id"] & (EXTENDED | 0x1FFFFFFF)
    payload = octets[np.minimum(at, len(octets) - 1)]
    return ticks[kept], identifier[kept], frame["bus"][kept], length[kept], payload
