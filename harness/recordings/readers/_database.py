"""Databases of bus messages, DBC, ARXML, KCD and SYM, through cantools (extra ``can``)."""

from __future__ import annotations

import logging
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.errors import UserError
from harness.common.files import refuse_beyond, refuse_damaged, refuse_special
from harness.recordings.readers._frames import EXTENDED

FORMATS = {".dbc": "dbc", ".arxml": "arxml", ".kcd": "kcd", ".sym": "sym"}
_LARGEST = 64 * 2**20
"""Bytes."""
_FURTHEST = 8 * 2048
"""Bits; of J1939 messages of several frames some signals begin behind the first one."""
_OF_A_BUS = re.compile(r"(?P<bus>[\w.-]+)=(?P<file>.+)")


@dataclass(frozen=True)
class Message:
    """A message of a database.

    Attributes:
        name: Its name.
        signals: Its signals, as cantools describes them.
        is_j1939: Whether it stands for a parameter group, whatever address sends it.
        database: File.
    """

    name: str
    signals: tuple[Any, ...]
    is_j1939: bool
    database: str

    def layout(self) -> set[tuple[object, ...]]:
        """Return what makes numbers of a frame: place, form, scale and unit of every signal."""
        keys = ("name", "start", "length", "byte_order", "is_signed", "is_float", "scale", "offset", "unit")
        return {tuple(getattr(s, key) for key in keys) for s in self.signals}


@dataclass(frozen=True)
class Database:
    """Messages by identifier, and those of J1939 by parameter group.

    Attributes:
        file: As the user named it.
        bus: The only bus that it is for; empty for all.
    """

    file: str
    bus: str
    by_identifier: dict[int, Message] = field(repr=False)
    by_group: dict[int, Message] = field(repr=False)

    def message(self, identifier: int) -> Message | None:
        """Return the message of an identifier with its ``EXTENDED`` bit, ``None`` if there is none."""
        exact = self.by_identifier.get(identifier)
        if exact is not None or not identifier & EXTENDED:
            return exact
        return self.by_group.get(parameter_group(identifier))


def parameter_group(identifier: int) -> int:
    """Return the parameter group number of an identifier of 29 bits (SAE J1939-21, 5.1.2).

    The lower byte of groups below 0xF000 is the address that they are sent to and no part of the number.
    """
    group = identifier >> 8 & 0x3FFFF
    return group if group >> 8 & 0xFF >= 0xF0 else group & 0x3FF00


def bus_and_file(stated: str, folder: Path) -> tuple[str, str]:
    """Return bus (empty for all) and file of a database that is stated as ``[BUS=]FILE``, relative to a folder."""
    match = None if (folder / stated).exists() else _OF_A_BUS.fullmatch(stated)
    return ("", stated) if match is None else (match["bus"], match["file"])


def load_databases(stated: Sequence[str]) -> list[Database]:
    """Read databases.

    Args:
        stated: Each as ``[BUS=]FILE``.

    Raises:
        UserError: If one cannot be read, or cantools is not installed.
    """
    return [_load(*bus_and_file(each, Path())) for each in stated]


def _load(bus: str, file: str) -> Database:
    path = Path(file)
    kind = FORMATS.get(path.suffix.lower())
    if kind is None:
        raise UserError(f"{file}: is no database of a bus; known are {', '.join(FORMATS)}")
    try:
        import cantools

        logging.getLogger("cantools").setLevel(logging.ERROR)  # warns of equal names, which are told apart here
    except ImportError:
        raise UserError(
            f'{file}: databases are read with cantools, which is not installed: pip install "robustness-harness[can]"'
        ) from None
    refuse_special(path)
    try:
        refuse_beyond(file, "the database", path.stat().st_size, _LARGEST, "bytes")
        content = path.read_bytes()
    except FileNotFoundError:
        raise UserError(f"{file}: the database does not exist") from None
    except OSError as error:
        raise UserError(f"{file}: cannot be read: {error.strerror or error}") from None
    with refuse_damaged(file, f"{path.suffix[1:].upper()} database"):
        try:
            text = content.decode("utf-8-sig")
        except UnicodeDecodeError:
            text = content.decode("cp1252", errors="replace")
        # strict would refuse a file with one signal that ends behind its message: such a signal is never in a frame
        loaded = cantools.database.load_string(text, database_format=kind, strict=False)
        messages = list(_messages(loaded, file))
    if not messages:
        raise UserError(f"{file}: describes no message with signals")
    return Database(
        file,
        bus,
        dict(reversed(messages)),
        {parameter_group(i): message for i, message in reversed(messages) if message.is_j1939},
    )


def _messages(loaded: Any, file: str) -> Iterator[tuple[int, Message]]:
    about = getattr(loaded.dbc, "attributes", None) if getattr(loaded, "dbc", None) is not None else None
    protocol = str(about["ProtocolType"].value) if about and "ProtocolType" in about else ""
    for message in loaded.messages:
        signals = tuple(s for s in message.signals if _is_number(s))
        if not signals:
            continue
        extended = bool(message.is_extended_frame)
        is_j1939 = extended and (message.protocol == "j1939" or protocol.upper() == "J1939")
        yield message.frame_id | EXTENDED * extended, Message(message.name, signals, is_j1939, file)


def _is_number(signal: Any) -> bool:
    """Return whether a signal is a number of a frame: no text, and in its place."""
    fits = signal.length in (16, 32, 64) if signal.conversion.is_float else 0 < signal.length <= 64
    return fits and 0 <= signal.start < _FURTHEST and bool(np.isfinite([signal.scale, signal.offset]).all())
