"""TRC text logs of CAN tools by PEAK, in versions 1.0 to 2.1."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import replace
from datetime import UTC, datetime, timedelta

from harness.common.files import refuse_damaged
from harness.recordings.readers._decode import decoded
from harness.recordings.readers._frames import Frames
from harness.recordings.readers._table import Table, Wanted
from harness.recordings.readers._text_frames import HEX, Grammar, text_frames

SUFFIXES = (".trc",)

_HEAD = 2**16
"""Bytes in which version, beginning and columns are stated."""
_COLUMNS = {"1.0": "NOIlD", "1.1": "NOTIlD", "1.3": "NOBTIRlD"}
"""Of versions that do not state them, in the letters of those that do."""
_FIELDS = {
    "N": rb"(?P<number>\d+)\)?",
    "O": rb"(?P<time>\d+(?:\.\d+)?)",
    "T": rb"(?:Rx|Tx|DT|FD|FB|FE|BI)",
    "B": rb"(?P<bus>\d+)",
    "I": rb"(?P<x>(?=%b{5}))?(?P<id>%b{1,8})" % (HEX, HEX),
    "d": rb"[RT]x",
    "R": rb"-",
    "l": rb"(?P<length>\d+)",
    "L": rb"(?P<dlc>\d+)",
}
_DATA = rb"(?!\S)(?P<data>(?:\s+%b%b(?!\S)){0,64})\s*$" % (HEX, HEX)
_BEGINNING = datetime(1899, 12, 30, tzinfo=UTC)
"""From which days are counted."""


def read(path: str, wanted: Wanted | None = None, databases: Sequence[str] = ()) -> list[Table]:
    """Return the signals of the messages that the databases describe, at the stamps of the file.

    Raises:
        UserError: If the file is damaged, a database cannot be read, or none fits.
    """
    with refuse_damaged(path, "TRC log"):
        read_frames = frames(path)
    return decoded(path, read_frames, databases, wanted)


def frames(path: str) -> Frames:
    """Return the data frames of a log.

    Raises:
        UserError: If there is none, or more than any recording holds.
        ValueError: If a line is damaged, or the head does not say where the fields are.
    """
    with open(path, "rb") as stream:
        stated = dict(re.findall(rb"^;\$(\w+)=([^\r\n]*)", stream.read(_HEAD), re.M))
    version = stated.get(b"FILEVERSION", b"1.0").decode().strip()
    columns = stated.get(b"COLUMNS", b"").decode().replace(",", "").strip() or _COLUMNS.get(version, "")
    if not {"O", "I", "D"} <= set(columns) or not {"l", "L"} & set(columns):
        raise ValueError(f"names no columns that can be read, of version {version}")
    begun = 0.0
    if version != "1.0":
        if b"STARTTIME" not in stated:
            raise ValueError("has no start time")
        begun = (_BEGINNING + timedelta(days=float(stated[b"STARTTIME"]))).timestamp()
    undated = text_frames(path, "TRC log", _grammar(columns))
    return replace(undated, time=undated.time / 1000 + begun)


def _grammar(columns: str) -> Grammar:
    fields = rb"\s+".join(_FIELDS.get(column, rb"\S+") for column in columns.partition("D")[0])
    other = rb"\s*(?:;|$)|.*\sRTR\s*$"
    if "T" in columns:
        other += rb"|\s*(?:\S+\s+){%d}(?!%b(?!\S))\S" % (columns.index("T"), _FIELDS["T"])
    return Grammar((re.compile(rb"\s*" + fields + _DATA),), re.compile(other))
