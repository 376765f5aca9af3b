"""TRC text logs of CAN tools by PEAK, through python-can (extra ``can``)."""

from __future__ import annotations

from collections.abc import Sequence

from harness.common.files import refuse_damaged
from harness.recordings.readers._decode import decoded
from harness.recordings.readers._frames import of_library, python_can
from harness.recordings.readers._table import Table, Wanted

SUFFIXES = (".trc",)


def read(path: str, wanted: Wanted | None = None, databases: Sequence[str] = ()) -> list[Table]:
    """Return the signals of the messages that the databases describe, at the stamps of the file.

    Raises:
        UserError: If python-can is not installed, the file is damaged, or no database fits.
    """
    reader = python_can(path).TRCReader
    with refuse_damaged(path, "TRC log"), reader(path) as messages:
        frames = of_library(messages, path, "TRC log")
    return decoded(path, frames, databases, wanted)
