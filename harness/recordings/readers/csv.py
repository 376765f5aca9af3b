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
import itertools
import re
import warnings
import zlib
from collections.abc import Iterator

import numpy as np
import pandas as pd

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import wide_text
from harness.common.units import plain_number, separators, separators_in_cell
from harness.recordings.readers._table import Table

SUFFIXES = (".csv", ".csv.gz", ".txt", ".txt.gz")

_UTF_8, _WINDOWS = "utf-8-sig", "cp1252"
_BYTES = "latin-1"
"""Takes every byte for one character: to look at lines before their encoding is known."""

_COMMENTS = ("#", "%", "//")
_MISSING = ["", "nan", "NaN", "NAN", "null", "NA", "N/A", "-"]
_WITH_POINT = re.compile(r"[+-]?(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?")
_WITH_COMMA = re.compile(r"[+-]?(?:\d+,\d*|,\d+)(?:[eE][+-]?\d+)?")
_MAY_BE_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")


def read(path: str) -> list[Table]:
    """Return the numeric columns of a CSV file; columns of text are left out, empty cells are NaN.

    Raises:
        UserError: If the file is empty, its rows differ in length, or a numeric column holds text.
    """
    try:
        encoding, head = _head(path)
        lines, names, separator, decimal, units = _layout(path, encoding, head)
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            table = pd.read_csv(
                path,
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
    except pd.errors.EmptyDataError:
        raise UserError(f"{path}: has a header but no row of data") from None
    except pd.errors.ParserWarning:
        raise UserError(
            f"{path}: the rows hold more cells than the {len(names)} of the header; with decimal commas, separate the "
            "columns by semicolons or tabs"
        ) from None
    except pd.errors.ParserError as error:
        raise UserError(f"{path}: {_first_line(error)}; every row must have as many cells") from None
    except (UnicodeDecodeError, EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise UserError(f"{path}: is damaged or no text in UTF-8 or Windows-1252: {error}") from None
    columns: dict[str, Floats] = {}
    for name in names:
        values = _numbers(table[name], decimal, path, name)
        if values is not None:
            columns[name] = values
    return [Table(columns, {name: unit for name, unit in zip(names, units, strict=False) if unit and name in columns})]


def _lines(path: str, encoding: str) -> Iterator[str]:
    """Yield the lines without their line ends."""
    opener = gzip.open if path.lower().endswith(".gz") else open
    with opener(path, "rt", encoding=encoding, newline=None) as file:
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


def _numbers(column: pd.Series, decimal: str, path: str, name: str) -> Floats | None:
    """Return a column as numbers, or None for a column of text."""
    numbers = pd.to_numeric(column, errors="coerce")
    values = np.asarray(numbers.to_numpy(dtype=float, na_value=np.nan))
    text = np.isnan(values) & column.notna().to_numpy()
    if decimal == "," and not pd.api.types.is_numeric_dtype(column):  # pandas left it as text, because of its points
        text |= column.astype(str).str.contains(".", regex=False).to_numpy()
    if not text.any():
        return values
    row = int(np.flatnonzero(text)[0])
    cell = str(column.iloc[row])
    unclear = separators_in_cell(cell)
    if not unclear and plain_number(cell) is None and np.isnan(values).all():
        return None
    why = unclear or f"{cell!r} is not a number; leave the cell empty if the sample is missing"
    if not unclear and not np.isnan(values[row]):
        why = (
            f"{cell!r} may mean {cell} or {cell.replace('.', '')}, as other numbers have decimal commas; write one sign"
        )
    raise UserError(f"{path}: column '{name}', row {row + 1} of the data: {why}")


def _first_line(error: Exception) -> str:
    return str(error).strip().splitlines()[0].removeprefix("Error tokenizing data. C error: ")
