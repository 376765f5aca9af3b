"""CarMaker ERG: records of numbers, and next to them the file ``.erg.info`` with names, types and units."""

from __future__ import annotations

import os
import re

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import refuse_beyond, refuse_damaged
from harness.recordings.readers._table import MOST_BYTES, MOST_COLUMNS, Table

SUFFIXES = (".erg",)

_HEAD = 16
"""Bytes: CM-ERG and two zeros, version, byte order, size of a record in two bytes, four that are reserved."""
_TYPES = {
    "double": "f8", "float": "f4", "longlong": "i8", "ulonglong": "u8", "long": "i4", "ulong": "u4", "int": "i4",
    "uint": "u4", "short": "i2", "ushort": "u2", "char": "i1", "uchar": "u1",
}  # fmt: skip
_LARGEST_INFO = 64 * 2**20
"""Bytes."""


def read(path: str) -> list[Table]:
    """Return the quantities of an ERG file, ``Time`` as the clock.

    Raises:
        UserError: If the info file is absent, does not fit the records, or the file is damaged.
    """
    info = f"{path}.info"
    if not os.path.isfile(info):
        raise UserError(
            f"{path}: {os.path.basename(info)} is not next to it, which has names, types and units; copy both"
        )
    refuse_beyond(info, "the file", os.path.getsize(info), _LARGEST_INFO, "bytes")
    with open(info, encoding="utf-8", errors="replace") as file:
        pairs = dict(re.findall(r"^([^\s#=][^=\n]*?)[ \t]*=[ \t]*(.*?)[ \t]*$", file.read(), re.MULTILINE))
    count = sum(re.fullmatch(r"File\.At\.\d+\.Name", key) is not None for key in pairs)
    refuse_beyond(path, "the file", count, MOST_COLUMNS, "quantities")
    order = ">" if pairs.get("File.ByteOrder", "").lower().startswith("big") else "<"
    fields: list[tuple[str, str]] = []
    for n in range(1, count + 1):
        name, kind = pairs.get(f"File.At.{n}.Name"), pairs.get(f"File.At.{n}.Type", "")
        padding = re.fullmatch(r"(\d{1,4}) [Bb]ytes?", kind)
        if name is None or not (padding or kind.lower() in _TYPES):
            raise UserError(f"{info}: File.At.{n} lacks a name, or a type that is known ('{kind}'); export it again")
        fields.append((f"{n} {name}", f"V{padding[1]}" if padding else order + _TYPES[kind.lower()]))
    record = np.dtype(fields)
    with refuse_damaged(path, "ERG file"), open(path, "rb") as file:
        head = file.read(_HEAD)
        size = int.from_bytes(head[10:12], "big" if head[9:10] == b"\1" else "little")
        if head[:6] != b"CM-ERG" or size != record.itemsize:
            raise UserError(
                f"{path}: is no ERG file of records of {record.itemsize} bytes, as {os.path.basename(info)} has them; "
                "copy both files of one run"
            )
        refuse_beyond(path, "the file", os.path.getsize(path) * len(fields) * 8 // size, MOST_BYTES, "bytes in columns")
        records = np.frombuffer(file.read((os.path.getsize(path) - _HEAD) // size * size), record)
    columns: dict[str, Floats] = {}
    units: dict[str, str] = {}
    for key, kind in fields:
        name = key.split(" ", 1)[1]
        if not kind.startswith("V"):
            columns[name] = records[key].astype(float)
            units[name] = pairs.get(f"Quantity.{name}.Unit", "")
    return [Table(columns, {n: u for n, u in units.items() if u}, "Time" if "Time" in columns else None)]
