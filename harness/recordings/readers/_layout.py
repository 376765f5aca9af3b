"""Layout of a table in text: what stands before the data, names, units, separator and decimal sign.

Loggers write a preamble. The header is the last row as wide as the largest block of numbers below it; rows of units and
of sources may stand between. A table that begins with its header is read as it was before preambles were.
"""

from __future__ import annotations

import csv
import re
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import islice

from harness.common.errors import UserError
from harness.common.files import refuse_beyond
from harness.common.unit_spellings import unit_of
from harness.common.units import plain_number, separators
from harness.recordings.readers._table import MOST_COLUMNS
from harness.recordings.readers._text_clock import is_stamp

MISSING = ["", "nan", "NaN", "NAN", "null", "NA", "N/A", "-"]
_COMMENTS = ("#", "%", "//")
_SEPARATORS = (",", ";", "\t", "|", " ")
_WITH_POINT = re.compile(r"[+-]?(?:\d+\.\d*|\.\d+)(?:[eE][+-]?\d+)?")
_WITH_COMMA = re.compile(r"[+-]?(?:\d+,\d*|,\d+)(?:[eE][+-]?\d+)?")
_MAY_BE_THOUSANDS = re.compile(r"[+-]?[1-9]\d{0,2},\d{3}")
_BETWEEN = 8
"""Rows between the header and the numbers in which it is looked for."""

Lines = Callable[[], Iterator[str]]
"""Gives the lines of the file, from its first one."""


@dataclass(frozen=True)
class Layout:
    """Where the data of a table begin, and how they are written.

    Attributes:
        before: Lines before the first row of data.
        names: Of the columns.
        separator: A space stands for any white space.
        decimal: Decimal sign.
        units: By column, as far as they are stated; may be shorter than the names.
    """

    before: int
    names: list[str]
    separator: str
    decimal: str
    units: list[str]


def is_data(line: str) -> bool:
    """Return whether a line is neither blank nor a comment."""
    return bool(line.strip()) and not line.lstrip().startswith(_COMMENTS)


def layout_of(path: str, head: list[str], lines: Lines) -> Layout:
    """Return the layout of a table.

    Args:
        path: The file, for errors.
        head: Its first lines.
        lines: All of them.

    Raises:
        UserError: If there is no line of data, commas in all numbers may separate thousands, two columns have one name,
            or nothing names the columns of numbers behind a preamble.
    """
    data = [n for n, line in enumerate(head) if is_data(line)]
    if not data:
        raise UserError(f"{path}: is empty")
    body = [head[n] for n in data[:3]]
    separator = next((s for s in (";", "\t") if all(s in line for line in body)), ",")
    layout = _without_preamble(path, head, data, separator, lines)
    if not _fits(head, layout):
        layout = _behind_preamble(path, head, data, lines) or layout
    names = [name or f"column_{n + 1}" for n, name in enumerate(layout.names)]
    twice = next((name for n, name in enumerate(names) if name in names[:n]), None)
    if twice is not None:
        raise UserError(f"{path}: two columns are named '{twice}'; rename one")
    return Layout(layout.before, names, layout.separator, layout.decimal, layout.units)


def cells_of(line: str, separator: str) -> list[str]:
    """Return the cells of a line.

    Raises:
        csv.Error: If one is longer than any cell of a table.
    """
    if separator == " ":
        line = " ".join(line.split())
    return [c.strip() for c in next(csv.reader([line], delimiter=separator), [])]


def is_number(text: str, decimal: str) -> bool:
    """Return whether a cell is a number with this decimal sign."""
    return plain_number(text.replace(decimal, ".")) is not None


def _decimal(path: str, separator: str, lines: Iterator[str]) -> str:
    """Return the decimal sign: that of the first number in which it can be nothing else.

    Raises:
        UserError: If there are commas in numbers, and all of them may separate thousands.
    """
    doubtful = ""
    for line in filter(is_data, lines):
        for cell in (c.strip(' "') for c in line.split(None if separator == " " else separator)):
            if _WITH_POINT.fullmatch(cell):
                return "."
            if _WITH_COMMA.fullmatch(cell):
                if not _MAY_BE_THOUSANDS.fullmatch(cell):
                    return ","
                doubtful = doubtful or cell
    if doubtful:
        raise UserError(f"{path}: {separators(doubtful)}")
    return "."


def _without_preamble(path: str, head: list[str], data: list[int], separator: str, lines: Lines) -> Layout:
    """Return the layout of a table whose first line is its header, or data."""
    first = head[data[0]]
    decimal = "." if separator == "," else _decimal(path, separator, lines())
    cells = cells_of(first, separator)
    refuse_beyond(path, "the table", len(cells), MOST_COLUMNS, "columns")
    if any(is_number(c, decimal) for c in cells):
        comments = [head[n].strip().lstrip("#%/ ") for n in range(data[0]) if head[n].strip()]
        named = cells_of(comments[-1], separator) if comments else []
        fits = len(named) == len(cells) and (len(cells) > 1 or " " not in named[0])
        names = named if fits else [f"column_{n + 1}" for n in range(len(cells))]
        return Layout(data[0], names, separator, decimal, [])
    second = cells_of(head[data[1]], separator) if len(data) > 1 else []
    if second and not any(is_number(c, decimal) or is_stamp(c) or c in MISSING[1:] for c in second):
        return Layout(data[1] + 1, cells, separator, decimal, [c.strip("[]()") for c in second])
    return Layout(data[0] + 1, cells, separator, decimal, [])


def _fits(head: list[str], layout: Layout) -> bool:
    """Return whether rows have no more cells than names, and a column is numbers or text, one of them numbers."""
    numbers, texts = set[int](), set[int]()
    rows = [line for line in head[layout.before :] if line.strip()]
    for line in rows:
        try:
            cells = _filled(cells_of(line, layout.separator))
        except csv.Error:
            return True
        if len(cells) > len(layout.names):
            return False
        for place, cell in enumerate(cells):
            if cell not in MISSING:
                (numbers if is_number(cell, layout.decimal) else texts).add(place)
    return not numbers & texts and (bool(numbers) or not rows)


def _filled(cells: list[str]) -> list[str]:
    """Return cells without the blank ones at the end."""
    while cells and not cells[-1]:
        cells = cells[:-1]
    return cells


def _behind_preamble(path: str, head: list[str], data: list[int], lines: Lines) -> Layout | None:
    """Return the layout by the largest block of numbers that a row names; None if there is none.

    Raises:
        UserError: If there is a block behind a preamble, but no row names its columns.
    """
    largest, best, unnamed = 0, None, (0, 0, 0)
    for separator in _SEPARATORS:
        try:
            rows = {n: cells_of(head[n], separator) for n in range(len(head)) if head[n].strip()}
        except csv.Error:
            continue
        for start, block in _blocks(rows, data, separator):
            width = Counter(len(_filled(cells)) for cells in block).most_common(1)[0][0]
            if width < 2 or width * len(block) <= largest:
                continue
            named = _header(head, rows, start, width, separator)
            if named is None and start == data[0]:
                named = [f"column_{n + 1}" for n in range(width)], []
            if named is None:
                unnamed = max(unnamed, (width * len(block), start, width))
                continue
            largest = width * len(block)
            decimal = "."
            if separator != "," or '"' in head[start]:
                decimal = _decimal_of_cells(path, separator, start, lines)
            best = Layout(start, *named[:1], separator, decimal, named[1])
    size, start, width = unnamed
    if size > 2 * largest and sum(n < start for n in data) > 2:
        raise UserError(
            f"{path}: from line {start + 1} on rows hold {width} cells, but no row above has as many names; write one "
            "with their names there"
        )
    return best


def _decimal_of_cells(path: str, separator: str, start: int, lines: Lines) -> str:
    """Return the decimal sign of the data from a line on; that of quoted cells between commas may be a comma."""
    rows = islice(lines(), start, None)
    if separator != ",":
        return _decimal(path, separator, rows)
    return _decimal(path, "\t", ("\t".join(cells_of(line, ",")) for line in rows))


def _blocks(rows: dict[int, list[str]], data: list[int], separator: str) -> Iterator[tuple[int, list[list[str]]]]:
    """Yield runs of rows of numbers with the line in which each begins."""
    block: list[list[str]] = []
    start = 0
    for n in data:
        if _is_row(rows[n], separator):
            start = start if block else n
            block.append(rows[n])
        elif block:
            yield start, block
            block = []
    if block:
        yield start, block


def _is_row(cells: list[str], separator: str) -> bool:
    """Return whether a row begins with a number or a time, or more than half of it are numbers."""
    filled = [c for c in cells if c not in MISSING]
    numbers = [
        is_number(c, ".") or is_stamp(c) or (separator != " " and _WITH_COMMA.fullmatch(c) is not None) for c in filled
    ]
    return bool(numbers) and (numbers[0] or 2 * sum(numbers) > len(numbers))


def _header(
    head: list[str], rows: dict[int, list[str]], start: int, width: int, separator: str
) -> tuple[list[str], list[str]] | None:
    """Return the names and units above a block; None if no row there is as wide.

    A row of a single cell between them is the title of a section.
    """
    group: list[list[str]] = []
    for n in [n for n in range(start - 1, -1, -1) if n in rows][:_BETWEEN]:
        line = head[n].strip()
        cells = _filled(cells_of(line.lstrip("#%/ "), separator) if not is_data(line) else rows[n])
        if (
            separator == " " and len(cells) > 1 and len(cells) != width
        ):  # names with spaces in them, two or more between
            cells = re.split(r"\s{2,}|\t", line.lstrip("#%/ "))
            cells = cells if len(cells) > 1 else ["", *cells]  # a sentence
        if width <= len(cells) <= width + 1 and not any(is_number(c, ".") or is_stamp(c) for c in cells):
            group.append(cells)
        elif group or len(cells) > 1:
            break
    if not group:
        return None
    between = 0
    while between < len(group) - 1 and _is_annotation(group[between]):
        between += 1
    units = max(group[:between], key=lambda row: sum(unit_of(c) is not None for c in row), default=[])
    return group[between], [c.strip("[]()") for c in units]


def _is_annotation(cells: list[str]) -> bool:
    """Return whether a row below the names tells units or sources: blank or repeated cells, or most are units."""
    filled = [c for c in cells if c]
    return len(set(filled)) < len(cells) or 2 * sum(unit_of(c) is not None for c in filled) > len(filled)
