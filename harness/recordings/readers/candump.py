"""Logs of candump, of the SocketCAN utilities: ``(1436509052.249713) can0 123#2A366C2B``, and what it prints."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from harness.common.errors import UserError
from harness.common.files import refuse_damaged
from harness.recordings.readers._decode import decoded
from harness.recordings.readers._frames import Frames
from harness.recordings.readers._table import Table, Wanted
from harness.recordings.readers._text_frames import HEX, Grammar, text_frames

SUFFIXES = (".log",)

_GRAMMAR = Grammar(
    (
        re.compile(
            rb"\((?P<time>\d+\.\d+)\) +(?P<bus>\S+) +(?P<x>(?=%b{8}#))?(?P<id>%b{3}|%b{8})#(?:#%b)?"
            rb"(?P<data>(?:%b%b){0,64})(?: +[RT])?\s*$" % ((HEX,) * 6)
        ),
        re.compile(
            rb"\s*\((?P<time>\d+\.\d+)\)\s+(?P<bus>\S+)\s+(?:[RT]X [-B] [-E]\s+)?(?P<x>(?=%b{8}\s))?"
            rb"(?P<id>%b{3}|%b{8})\s+\[(?P<length>\d+)\](?!\S)(?P<data>(?:\s+%b%b(?!\S)){0,64})" % ((HEX,) * 5)
        ),
    ),
    other=re.compile(
        rb"\s*$|\(\d+\.\d+\) +\S+ +(?:%b{3}|%b{8})#R\d?(?: +[RT])?\s*$|.*\]\s+remote request\s*$" % (HEX, HEX)
    ),
)
"""As ``-l`` and ``-L`` write it (CAN FD has flags behind a second `#`, `R` asks for a frame), and as on a screen."""

_HEAD = 2**20
"""Bytes from which is seen what short stamps count from."""
_SHORT = re.compile(rb"^\s*\((\d{3,9}\.\d+)\)", re.M)
"""Stamp of ``-t z`` and ``-t d``, which has three digits or more before the point; one since 1970 has ten."""


def read(path: str, wanted: Wanted | None = None, databases: Sequence[str] = ()) -> list[Table]:
    """Return the signals of the messages that the databases describe, at the stamps of the file.

    Raises:
        UserError: If the file is damaged, a database cannot be read, or none fits.
    """
    with refuse_damaged(path, "candump log"):
        read_frames = frames(path)
    return decoded(path, read_frames, databases, wanted)


def frames(path: str) -> Frames:
    """Return the data frames of a log.

    Raises:
        UserError: If there is none, or more than any recording holds.
        ValueError: If a line is damaged.
    """
    return text_frames(path, "candump log", replace(_GRAMMAR, relative=_since_the_line_before(path)))


def _since_the_line_before(path: str) -> bool:
    """Return whether stamps are those of ``candump -t d``: they rise and fall, where others rise alone.

    Raises:
        UserError: If they are few, or do neither.
    """
    with open(path, "rb") as stream:
        stamps = np.array(_SHORT.findall(head := stream.read(_HEAD)), dtype=float)
    if not _SHORT.match(head):
        return False
    steps = np.diff(stamps[1:])
    rises, falls = steps[steps > 0], -steps[steps < 0]
    if 2 * falls.sum() > rises.sum():
        return True
    if 10 <= len(rises) >= len(steps) / 10 and max(falls.sum() / rises.sum(), len(falls) / len(rises)) < 0.1:
        return False
    raise UserError(
        f"{path}: its stamps may be those of 'candump -t z', since the first frame, or of '-t d', since the frame "
        f"before, which {len(stamps)} of them do not tell; log with -l or -t a"
    )
