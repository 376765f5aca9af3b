"""ASC text logs of CAN tools by Vector."""

from __future__ import annotations

import re
from collections.abc import Sequence

from harness.common.files import refuse_damaged
from harness.recordings.readers._decode import decoded
from harness.recordings.readers._frames import Frames
from harness.recordings.readers._table import Table, Wanted
from harness.recordings.readers._text_frames import HEX, Grammar, text_frames

SUFFIXES = (".asc",)

_HEAD = 2**16
"""Bytes in which the base of the numbers is stated; hexadecimal without it."""
_BASE = re.compile(rb"^\s*base\s+(hex|dec)(?:\s+timestamps\s+(absolute|relative))?", re.I | re.M)
_TIME = rb"\s*(?P<time>\d+\.\d+)\s+"
_FLAGS = rb"(?:\S*[^\s\d]\S*\s+)?\d\s+\d"
"""Of CAN FD, behind a symbolic name that may be absent."""
_OTHER = re.compile(
    rb"(?!%(time)b(?:\d+\s+\w+\s+[RT]x|CANFD))"  # no frame
    rb"|%(time)b\d+\s+\w+\s+[RT]x\w*\s+r"  # a remote frame
    rb"|%(time)bCANFD\s+\d+\s+[RT]x\w*\s+(?:ErrorFrame|\S+\s+%(flags)b\s+\w+\s+0(?!\S))"
    % {b"time": rb"\s*\d+\.\d+\s+", b"flags": _FLAGS},
    re.I,
)


def read(path: str, wanted: Wanted | None = None, databases: Sequence[str] = ()) -> list[Table]:
    """Return the signals of the messages that the databases describe, in s since the measurement began.

    Raises:
        UserError: If the file is damaged, a database cannot be read, or none fits.
    """
    with refuse_damaged(path, "ASC log"):
        read_frames = frames(path)
    return decoded(path, read_frames, databases, wanted)


def frames(path: str) -> Frames:
    """Return the data frames of a log.

    Raises:
        UserError: If there is none, or more than any recording holds.
        ValueError: If a line is damaged.
    """
    with open(path, "rb") as stream:
        stated = _BASE.search(stream.read(_HEAD))
    base, clock = (b"hex", b"absolute") if stated is None else (stated[1].lower(), (stated[2] or b"").lower())
    return text_frames(path, "ASC log", _grammar(10 if base == b"dec" else 16, clock == b"relative"))


def _grammar(base: int, relative: bool) -> Grammar:
    digit = HEX if base == 16 else rb"\d"
    octets = rb"(?P<data>(?:\s+%b(?!\S)){0,%%d})" % (HEX * 2 if base == 16 else rb"\d{1,3}")
    identifier = rb"(?P<id>%b{1,%d})(?P<x>x)?\s+" % (digit, 8 if base == 16 else 10)
    classic = rb"(?P<bus>\d+)\s+%b[RT]x\w*\s+d\s+(?P<dlc>%b+)(?!\S)" % (identifier, digit)
    fd = rb"CANFD\s+(?P<bus>\d+)\s+[RT]x\w*\s+%b%b\s+%b+\s+(?P<length>[1-9]\d*)(?!\S)" % (identifier, _FLAGS, digit)
    patterns = (re.compile(_TIME + head + octets % most, re.I) for head, most in ((classic, 8), (fd, 64)))
    return Grammar(tuple(patterns), _OTHER, base, relative)
