"""Comma-separated values, plain or gzipped, with or without comment lines and a header.

Separator (comma, semicolon, tab) and, with the latter two, decimal comma are recognised; a file whose commas may as
well separate thousands is refused. Comment lines (``#``, ``%``, ``//``)
before the data are passed over; if the last of them names as many columns as there are, it is the header, as
``numpy.savetxt`` writes it. Without a header the columns are ``column_1``, ``column_2``, ... A line of units
below the header is returned as the units. The header tells the encoding: UTF-8, or else that of Windows in the west
of Europe, in which loggers write ``°/s`` and ``m/s²``.
"""

from __future__ import annotations

import csv
import gzip
import io
import itertools
import os
import re
import warnings
import zlib
from collections.abc import Iterator
from typing import Any

import numpy as np
import pandas as pd

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import refuse_beyond, wide_text
from harness.common.units import plain_number, separators, separators_in_cell
from harness.recordings.readers._table import MOST_BYTES, MOST_COLUMNS, NO_MEASUREMENT, Table, Wanted

_LONGEST_LINE = 2**20
"""Bytes of a line, and of what is read at once."""
_MOST_UNPACKED = 100
"""Bytes that a byte of a packed table may be unpacked into on average; tables have 3 to 30."""
_AT_ONCE = 2**18
"""Rows that are held as text at a time."""

SUFFIXES = (".csv", ".csv.gz", ".txt", ".txt.gz")

_UTF_8, _WINDOWS = "utf-8-sig", "cp1252"
_BYTES = "latin-1"
"""Takes every byte for one character: to look at lines before their encoding is known."""

_COMMENTS = ("#", "%", "//")
_MISSING = ["", "nan", "NaN", "NAN", "null", "NA", "N/A", "-"]
_WITH_POINT = re.compile(r"[+-]?(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?")
_WITH_COMMA = re.compile(r"[+-]?(?:\d+,\d*|,\d+)(?:[eE][+-]?\d+)?")
_MAY_BE_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")


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
        lines, names, separator, decimal, units = _layout(path, encoding, head)
        if wanted is not None and not any(map(wanted, names)):
            wanted = None  # for an error that lists them
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            chunks = pd.read_csv(
                _opened(path),
                chunksize=_AT_ONCE,
                encoding=encoding,
                sep=separator,
                decimal=decimal,
                skiprows=lines,
                header=None,
                names=names,
                index_col=False,
                na_values=_MISSING,
                keep_default_na=False,
                skipinitialspace=True,
                on_bad_lines="error",
                low_memory=False,
            )
            columns = [_Column(path, name, decimal, wanted is None or wanted(name)) for name in names]
            with chunks:
                for chunk in chunks:
                    for column in columns:
                        column.add(chunk[column.name])
    except pd.errors.EmptyDataError:
        raise UserError(f"{path}: has a header but no row of data") from None
    except pd.errors.ParserWarning:
        raise UserError(
            f"{path}: the rows hold more cells than the {len(names)} of the header; with decimal commas, separate the "
            "columns by semicolons or tabs"
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
    return [Table(numbers, {name: unit for name, unit in zip(names, units, strict=False) if unit and name in numbers})]


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

    def add(self, column: pd.Series) -> None:
        """Add the next rows."""
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
            UserError: If it holds text between numbers.
        """
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


def _is_data(line: str) -> bool:
    return bool(line.strip()) and not line.lstrip().startswith(_COMMENTS)


def _head(path: str) -> tuple[str, list[str]]:
    """Return the encoding, and the lines up to two past the comments (header, units)."""
    encoding, lines, plain = _UTF_8, list[str](), 0
    for line in itertools.islice(_lines(path, _BYTES), 10_000):
        lines.append(line)
        plain += _is_data(line)
        if plain == 3:
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


def _decimal(path: str, encoding: str, separator: str) -> str:
    """Return the decimal sign: that of the first number in which it can be nothing else.

    Raises:
        UserError: If there are commas in numbers, and all of them may separate thousands.
    """
    if separator == ",":
        return "."
    doubtful = ""
    for line in filter(_is_data, _lines(path, encoding)):
        for cell in (c.strip(' "') for c in line.split(separator)):
            if _WITH_POINT.fullmatch(cell):
                return "."
            if _WITH_COMMA.fullmatch(cell):
                if not _MAY_BE_THOUSANDS.fullmatch(cell):
                    return ","
                doubtful = doubtful or cell
    if doubtful:
        raise UserError(f"{path}: {separators(doubtful)}")
    return "."


def _layout(path: str, encoding: str, head: list[str]) -> tuple[int, list[str], str, str, list[str]]:
    """Return how many lines precede the data, the columns' names, separator, decimal sign and the units stated."""
    data = [n for n, line in enumerate(head) if _is_data(line)]
    if not data:
        raise UserError(f"{path}: is empty")
    first = head[data[0]]
    body = [head[n] for n in data]
    separator = next((s for s in (";", "\t") if all(s in line for line in body)), ",")
    decimal = _decimal(path, encoding, separator)
    cells = _cells(first, separator)
    refuse_beyond(path, "the table", len(cells), MOST_COLUMNS, "columns")
    units: list[str] = []
    if any(_is_number(c, decimal) for c in cells):
        comments = [head[n].strip().lstrip("#%/ ") for n in range(data[0]) if head[n].strip()]
        named = _cells(comments[-1], separator) if comments else []
        fits = len(named) == len(cells) and (len(cells) > 1 or " " not in named[0])
        names = named if fits else [f"column_{n + 1}" for n in range(len(cells))]
        before = data[0]
    else:
        names, before = cells, data[0] + 1
        second = _cells(body[1], separator) if len(data) > 1 else []
        if second and not any(_is_number(c, decimal) or c in _MISSING[1:] for c in second):
            units, before = [c.strip("[]()") for c in second], data[1] + 1
    names = [name or f"column_{n + 1}" for n, name in enumerate(names)]
    twice = next((name for n, name in enumerate(names) if name in names[:n]), None)
    if twice is not None:
        raise UserError(f"{path}: two columns are named '{twice}'; rename one")
    return before, names, separator, decimal, units


def _cells(line: str, separator: str) -> list[str]:
    return [c.strip() for c in next(csv.reader([line], delimiter=separator))]


def _is_number(text: str, decimal: str) -> bool:
    return plain_number(text.replace(decimal, ".")) is not None


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0].removeprefix("Error tokenizing data. C error: ")
