"""ASC text logs of CAN tools by Vector, through python-can (extra ``can``)."""

from __future__ import annotations

from collections.abc import Sequence

from harness.common.errors import UserError
from harness.common.files import refuse_damaged
from harness.recordings.readers._decode import decoded
from harness.recordings.readers._frames import of_library, python_can
from harness.recordings.readers._table import Table, Wanted

SUFFIXES = (".asc",)


def read(path: str, wanted: Wanted | None = None, databases: Sequence[str] = ()) -> list[Table]:
    """Return the signals of the messages that the databases describe, in s since the measurement began.

    Raises:
        UserError: If python-can is not installed, the file is damaged, or no database fits.
    """
    reader = python_can(path).ASCReader
    with refuse_damaged(path, "ASC log"), reader(path) as messages:
        frames = of_library(messages, path, "ASC log", first_bus=1)
        if messages.timestamps_format == "relative":
            raise UserError(f"{path}: each stamp is the time since the line before; export it with absolute stamps")
    return decoded(path, frames, databases, wanted)
