"""Logs of candump, of the SocketCAN utilities: ``(1436509052.249713) can0 123#2A366C2B``, a block of lines at once."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence

import numpy as np

from harness.common.files import refuse_damaged
from harness.recordings.readers._decode import decoded
from harness.recordings.readers._frames import EXTENDED, Part, joined
from harness.recordings.readers._table import Table, Wanted

SUFFIXES = (".log",)

_HEX = rb"[0-9A-Fa-f]"
_LINE = re.compile(
    rb"^\((\d+\.\d+)\) +(\S+) +(%b{3}|%b{8})#(R?)(?:(?<=R)\d?|#%b)?((?:%b{2})*)(?: +[RT])?[ \r]*$" % ((_HEX,) * 4),
    re.M,
)
"""Stamp, bus, identifier, whether it asks for a frame, data; CAN FD has flags behind a second ``#``."""
_BLOCK = 2**22
_ERROR = 1 << 29
"""Bit of an identifier that marks an error frame."""


def read(path: str, wanted: Wanted | None = None, databases: Sequence[str] = ()) -> list[Table]:
    """Return the signals of the messages that the databases describe, at the stamps of the file.

    Raises:
        UserError: If the file is damaged, a database cannot be read, or none fits.
    """
    buses: dict[bytes, int] = {}
    with refuse_damaged(path, "candump log"):
        frames = joined(
            _parts(path, buses), path, "candump log", lambda number: list(buses)[number].decode(errors="replace")
        )
    return decoded(path, frames, databases, wanted)


def _parts(path: str, buses: dict[bytes, int]) -> Iterator[Part]:
    """Yield the frames of each block of lines, and number the buses.

    Raises:
        ValueError: If a line is no frame; the last one may have been cut.
    """
    with open(path, "rb") as stream:
        rest = b""
        while block := stream.read(_BLOCK):
            whole, _, rest = (rest + block).rpartition(b"\n")
            lines = _LINE.findall(whole)
            if len(lines) <= whole.count(b"\n"):  # blank lines, or what is no frame
                for line in whole.split(b"\n"):
                    if line.strip() and not _LINE.match(line):
                        raise ValueError(f"is no frame: {line[:60]!r}")
            if len(rest) > _BLOCK:
                raise ValueError(f"a line of more than {_BLOCK} bytes")
            if lines:
                yield _frames(lines, buses)
        if lines := _LINE.findall(rest):
            yield _frames(lines, buses)


def _frames(lines: list[tuple[bytes, ...]], buses: dict[bytes, int]) -> Part:
    stamps, names, hexadecimal, remote, data = zip(*lines, strict=True)
    digits = b"".join([text.rjust(8, b"0") for text in hexadecimal]).decode()
    identifier = np.frombuffer(bytes.fromhex(digits), dtype=">u4") & np.uint32(_ERROR | 0x1FFFFFFF)
    extended = np.fromiter(map(len, hexadecimal), dtype=np.uint8, count=len(lines)) > 3
    length = np.fromiter(map(len, data), dtype=np.int64, count=len(lines)) // 2
    width = max(int(length.max()), 1)
    octets = np.frombuffer(bytes.fromhex(b"".join([d.ljust(2 * width, b"0") for d in data]).decode()), dtype=np.uint8)
    bus = np.array([buses.setdefault(name, len(buses)) for name in names])
    kept = (np.array(remote) == b"") & ~(extended & (identifier & _ERROR > 0))
    identifier = identifier | np.where(extended, np.uint32(EXTENDED), np.uint32(0))
    return (
        np.array(stamps).astype(float)[kept],
        identifier[kept],
        bus[kept],
        length[kept],
        octets.reshape(-1, width)[kept],
    )
