"""Comma-separated values, plain or gzipped, with or without comment lines and a header.

Separator, decimal sign (a comma where columns are not separated by it), preamble, header and units are recognised
(``_layout.py``); a file whose commas may as well separate thousands is refused. Comment lines (``#``, ``%``, ``//``)
before the data are passed over; if the last of them names as many columns as there are, it is the header, as
``numpy.savetxt`` writes it. Without a header the columns are ``column_1``, ``column_2``, ... Times as text become
seconds (``_text_clock.py``), rows of time, name and value columns (``_long_form.py``). A line of units
below the header is returned as the units. The header tells the encoding: UTF-8, or else that of Windows in the west
of Europe, in which loggers write ``°/s`` and ``m/s²``.
"""

from __future__ import annotations

import csv
import gzip
import io
import itertools
import os
import warnings
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import refuse_beyond, wide_text
from harness.common.units import plain_number, separators_in_cell
from harness.recordings.readers import vbo
from harness.recordings.readers._layout import MISSING, Layout, is_data, layout_of
from harness.recordings.readers._long_form import long_form, pivoted
from harness.recordings.readers._table import MOST_BYTES, NO_MEASUREMENT, Table, Wanted
from harness.recordings.readers._text_clock import TextClock, is_stamp

_LONGEST_LINE = 2**20
"""Bytes of a line, and of what is read at once."""
_MOST_UNPACKED = 100
"""Bytes that a byte of a packed table may be unpacked into on average; tables have 3 to 30."""
_MOST_OF_PREAMBLE = 400
"""Lines of a preamble and first rows that are looked at."""
_AT_ONCE = 2**18
"""Rows that are held as text at a time."""

SUFFIXES = (".csv", ".csv.gz", ".txt", ".txt.gz", ".tsv", ".lvm")

_UTF_8, _WINDOWS = "utf-8-sig", "cp1252"
_BYTES = "latin-1"
"""Takes every byte for one character: to look at lines before their encoding is known."""


def read(path: str, wanted: Wanted | None = None) -> list[Table]:
    """Return the numeric columns of a CSV file; columns of text are left out, empty cells are NaN.

    Args:
        path: The file.
        wanted: Tells by its name whether a column's values are used; all are by default. Of others it is kept at most
            in which rows they stand, as 1.

    Raises:
        UserError: If the file is empty, its rows differ in length, a numeric column holds text, or lines, columns or
            the whole are larger than any recording's, unless limits are lifted.
    """
    try:
        encoding, head = _head(path)
        if vbo.is_vbo(head) and not path.lower().endswith(".gz"):
            return vbo.read(path)
        layout = layout_of(path, head, lambda: _lines(path, encoding))
        long = long_form(layout, head)
        if long is not None or (wanted is not None and not any(map(wanted, layout.names))):
            wanted = None  # for a pivot, or for an error that lists them
        columns = [_Column(path, name, layout.decimal, wanted is None or wanted(name)) for name in layout.names]
        texts: list[pd.DataFrame] = []
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            with _chunks(path, encoding, layout) as chunks:
                for chunk in chunks:
                    for column in columns:
                        column.add(chunk[column.name])
                    if long is not None:
                        texts.append(chunk[long.texts].astype("category"))
    except pd.errors.EmptyDataError:
        raise UserError(f"{path}: has a header but no row of data") from None
    except pd.errors.ParserWarning:
        raise UserError(
            f"{path}: the rows hold more cells than the {len(layout.names)} of the header; with decimal commas, "
            "separate the columns by semicolons or tabs"
        ) from None
    except csv.Error as error:
        raise UserError(f"{path}: the first lines are no header of a table: {error}") from None
    except pd.errors.ParserError as error:
        raise UserError(f"{path}: {_first_line(error)}; every row must have as many cells") from None
    except OverflowError:
        raise UserError(f"{path}: an integer is beyond all floating-point numbers, 1.8e308") from None
    except (UnicodeDecodeError, EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise UserError(f"{path}: is damaged or no text in UTF-8 or Windows-1252: {error}") from None
    numbers = {c.name: values for c in columns if (values := c.values()) is not None}
    if long is not None:
        return [pivoted(path, long, numbers, pd.concat(texts, ignore_index=True))]
    stated = dict(zip(layout.names, layout.units, strict=False)) | {c.name: "s" for c in columns if c.clock is not None}
    units = {name: stated[name] for name in numbers if stated.get(name)}
    return [Table(numbers, units, texts={c.name: c.text for c in columns if c.text and c.name not in numbers})]


def _chunks(path: str, encoding: str, layout: Layout) -> Any:
    """Return what reads the rows piece by piece."""
    return pd.read_csv(
        _opened(path),
        chunksize=_AT_ONCE,
        encoding=encoding,
        sep=r"\s+" if layout.separator == " " else layout.separator,
        decimal=layout.decimal,
        skiprows=layout.before,
        header=None,
        names=layout.names,
        index_col=False,
        na_values=MISSING,
        keep_default_na=False,
        skipinitialspace=True,
        on_bad_lines="error",
        low_memory=False,
    )


class _Bounded(io.RawIOBase):
    """The bytes of a table, unpacked, as long as they may be those of a recording.

    Args:
        path: The file.
    """

    def __init__(self, path: str) -> None:
        self._path, packed = path, path.lower().endswith(".gz")
        self._file: Any = gzip.open(path) if packed else open(path, "rb")  # noqa: SIM115
        self._most = max(_MOST_UNPACKED * os.path.getsize(path), 64 * 2**20) if packed else MOST_BYTES
        self._most, self._total, self._line = min(self._most, MOST_BYTES), 0, 0

    def readable(self) -> bool:
        """Return that it can be read."""
        return True

    def readinto(self, room: Any) -> int:
        """Read as many bytes as there is room for, at most those of the longest line.

        Raises:
            UserError: If a line or the whole is too long.
        """
        content = self._file.read(min(len(room), _LONGEST_LINE))
        room[: len(content)] = content
        self._total += len(content)
        ends = [at for mark in (b"\n", b"\r") if (at := content.rfind(mark)) >= 0]
        self._line = len(content) - max(ends) - 1 if ends else self._line + len(content)
        refuse_beyond(self._path, "a line", self._line, _LONGEST_LINE, "bytes")
        refuse_beyond(self._path, "the table, unpacked,", self._total, self._most, "bytes")
        return len(content)

    def close(self) -> None:
        """Close the file."""
        self._file.close()
        super().close()


def _opened(path: str) -> io.BufferedReader:
    return io.BufferedReader(_Bounded(path), 2**18)


class _Column:
    """A column that is read piece by piece.

    Args:
        path: The file, for errors.
        name: Its name.
        decimal: Decimal sign.
        wanted: Whether its values are used.
    """

    def __init__(self, path: str, name: str, decimal: str, wanted: bool) -> None:
        self.name = name
        self._path, self._decimal, self._wanted = path, decimal, wanted
        self._pieces: list[Floats] = []
        self._rows, self._any, self._whole = 0, False, True
        self._odd: tuple[int, str, float] | None = None
        self.clock: TextClock | None = None
        self.text = ""

    def add(self, column: pd.Series) -> None:
        """Add the next rows.

        Raises:
            UserError: If a row of a column of times is no time.
        """
        if self._rows == 0 and not pd.api.types.is_numeric_dtype(column):
            self.text = next((str(cell) for cell in column if not pd.isna(cell)), "")
            if self._wanted and is_stamp(self.text):
                self.clock = TextClock(f"{self._path}: column '{self.name}'")
        if self.clock is not None:
            self._rows += len(column)
            self.clock.add(column)
            return
        numbers = pd.to_numeric(column, errors="coerce")
        values = np.asarray(numbers.to_numpy(dtype=float, na_value=np.nan))
        missing = np.isnan(values)
        if self._odd is None and not pd.api.types.is_numeric_dtype(column):
            text = missing & column.notna().to_numpy()
            if self._decimal == ",":  # pandas left it as text, because of its points
                text |= column.astype(str).str.contains(".", regex=False).to_numpy()
            if text.any():
                row = int(np.flatnonzero(text)[0])
                self._odd = self._rows + row, str(column.iloc[row]), float(values[row])
        self._any |= not missing.all()
        if not self._wanted:
            values = np.where(np.abs(values) < NO_MEASUREMENT, 1.0, np.nan)
            if self._whole and (whole := not np.isnan(values).any()) is not self._whole:
                self._pieces, self._whole = [np.ones(self._rows)], whole
        self._rows += len(column)
        if self._wanted or not self._whole:
            self._pieces.append(values)

    def values(self) -> Floats | None:
        """Return the numbers ``(rows,)``; ``None`` of a column of text, or where they are not used.

        Raises:
            UserError: If it holds text between numbers, or dates that may mean two days.
        """
        if self.clock is not None:
            return self.clock.values()
        if self._odd is not None:
            row, cell, value = self._odd
            unclear = separators_in_cell(cell)
            if not unclear and plain_number(cell) is None and not self._any:
                return None
            why = unclear or f"{cell!r} is not a number; leave the cell empty if the sample is missing"
            if not unclear and not np.isnan(value):
                why = (
                    f"{cell!r} may mean {cell} or {cell.replace('.', '')}, as other numbers have decimal commas; "
                    "write one sign"
                )
            raise UserError(f"{self._path}: column '{self.name}', row {row + 1} of the data: {why}")
        pieces, self._pieces = self._pieces, []
        if not self._wanted and self._whole:
            return None
        return np.concatenate(pieces) if len(pieces) > 1 else np.array(pieces[0] if pieces else [], dtype=float)


def _lines(path: str, encoding: str) -> Iterator[str]:
    """Yield the lines without their line ends."""
    with io.TextIOWrapper(_opened(path), encoding=encoding, newline=None) as file:
        for line in file:
            yield line.rstrip("\n")


def _head(path: str) -> tuple[str, list[str]]:
    """Return the encoding, and the lines in which header and units are looked for."""
    encoding, lines, plain, size = _UTF_8, list[str](), 0, 0
    for line in itertools.islice(_lines(path, _BYTES), 10_000):
        lines.append(line)
        plain, size = plain + is_data(line), size + len(line)
        if plain >= 3 and (size > _LONGEST_LINE or plain == _MOST_OF_PREAMBLE):
            break
    raw = "\n".join(lines).encode(_BYTES)
    try:
        text = raw.decode(encoding)
    except UnicodeDecodeError:
        encoding = _WINDOWS
        text = raw.decode(encoding)
        if wide := wide_text(raw):
            raise UserError(f"{path}: is {wide}; save or export it as UTF-8") from None
        if b"\0" in raw:  # no text at all
            raise
    return encoding, text.split("\n")


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0].removeprefix("Error tokenizing data. C error: ")
