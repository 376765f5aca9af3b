"""Frames of text logs: lines of one shape are read at once, column by column, odd ones by themselves."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats, Mask
from harness.recordings.readers._frames import EXTENDED, Frames, Part, joined

HEX = b"[0-9A-Fa-f]"
_BLOCK = 2**24
"""Bytes that are read at once; no line is longer."""
_SHAPES = 64
"""Among lines of one length; beyond them each line is read by itself."""
_LONGEST = 64
_LENGTHS = (*range(9), 12, 16, 20, 24, 32, 48, 64)
"""Bytes of a frame by its data length code (ISO 11898-1, table 5)."""
_FLAGS = 3 << 29
"""Bits of an identifier that mark error and remote frames."""
_FREE = ("time", "number", "id", "data")
"""Groups in which lines of one shape differ, the latter two in hexadecimal digits."""
_SPACE, _ZERO = np.uint8(ord(" ")), np.uint8(ord("0"))
_STAMP = re.compile(rb"\s*\(?(?P<time>\d+(\.\d+)?)\)?(?!\S)")


@dataclass(frozen=True)
class Grammar:
    """Lines of a text log.

    Attributes:
        frames: Patterns of a data frame with the groups ``time``, ``id`` and ``data``; ``x`` is there where the
            identifier has 29 bits, ``bus`` where the log names it, ``dlc`` or ``length`` where it tells how many of
            the bytes are data, ``number`` where digits have no meaning here.
        other: Pattern of a line that is no data frame; any other line is damaged.
        base: Of identifiers, data length codes and data.
        relative: Whether each stamp is the time since the line before.
    """

    frames: tuple[re.Pattern[bytes], ...]
    other: re.Pattern[bytes]
    base: int = 16
    relative: bool = False


def text_frames(path: str, what: str, grammar: Grammar) -> Frames:
    """Return the data frames of a text log.

    Args:
        path: File.
        what: Format, for errors.
        grammar: Of its lines.

    Raises:
        UserError: If there is no frame, or more than any recording holds.
        ValueError: If a line is damaged; the last one may have been cut.
    """
    buses: dict[bytes, int] = {}
    parts = _parts(path, grammar, buses)
    return joined(parts, path, what, lambda number: list(buses)[number].decode(errors="replace"))


def _parts(path: str, grammar: Grammar, buses: dict[bytes, int]) -> Iterator[Part]:
    clock, lines, rest, ends = 0.0, 0, b"", False
    with open(path, "rb") as stream:
        while not ends:
            content = stream.read(_BLOCK)
            ends = len(content) < _BLOCK
            content, _, rest = (rest + content).rpartition(b"\n") if not ends else (rest + content, b"", b"")
            if len(rest) > _BLOCK:
                raise ValueError(f"a line of more than {_BLOCK} bytes")
            block = _Block(content, grammar, buses, lines, ends)
            block.read()
            if grammar.relative:
                block.time = np.round(clock + np.cumsum(block.time), block.decimals)
                clock = float(block.time[-1])
            lines += len(block.start)
            kept, width = block.is_frame, max(int(block.size.max()), 1)
            octets = block.octets[:, :width]
            yield block.time[kept], block.identifier[kept], block.bus[kept], block.size[kept], octets[kept]


class _Block:
    """Lines of a file, and what they hold.

    Args:
        content: Lines, the last one without its end.
        grammar: Of them.
        buses: Numbers of the buses by name; new ones are added.
        lines: Of the file before these.
        ends: Whether the last line is that of the file, which may have been cut.

    Attributes:
        start: Places of the lines in ``content`` ``(lines,)``.
        is_frame: Which are data frames ``(lines,)``; the other fields are as in ``Part``, with a row for each line.
        decimals: Most digits behind the point of a stamp.
    """

    def __init__(self, content: bytes, grammar: Grammar, buses: dict[bytes, int], lines: int, ends: bool) -> None:
        self._content, self._grammar, self._buses, self._lines, self._ends = content, grammar, buses, lines, ends
        self._text = np.frombuffer(content + b"\n", dtype=np.uint8)
        self._end = np.flatnonzero(self._text == ord("\n"))
        self.start = np.concatenate([[0], self._end[:-1] + 1])
        count = len(self.start)
        self.time, self.is_frame, self.decimals = np.zeros(count), np.zeros(count, dtype=bool), 0
        self.identifier, self.bus = np.zeros(count, dtype=np.uint32), np.zeros(count, dtype=np.int16)
        self.size, self.octets = np.zeros(count, dtype=np.uint8), np.zeros((count, _LONGEST), dtype=np.uint8)

    def read(self) -> None:
        """Fill in what the lines hold.

        Raises:
            ValueError: If a line is damaged.
        """
        length = self._end - self.start
        order = np.argsort(length, kind="stable")
        for rows in np.split(order, np.flatnonzero(np.diff(length[order])) + 1):
            shapes = 0
            while len(rows):
                line = self._content[self.start[rows[0]] : self._end[rows[0]]]
                match = self._match(line)
                shapes += match is not None
                if match is None:
                    self._pass_over(int(rows[0]), line)
                    rows = rows[1:]
                elif shapes > _SHAPES or self._grammar.base != 16:
                    self._read_line(int(rows[0]), match)
                    rows = rows[1:]
                else:
                    rows = rows[~self._read_alike(rows, line, match)]

    def _match(self, line: bytes) -> re.Match[bytes] | None:
        """Return a frame; ``None`` if the line is none, or does not have as many bytes as it says."""
        match = next((m for m in (p.match(line) for p in self._grammar.frames) if m is not None), None)
        if match is None or (stated := _stated(match)) is None:
            return match
        count = len(self._octets(match))
        classic = count == 8 and "dlc" in match.re.groupindex  # which has 8 bytes with any code from 8 on
        further = stated < count and match.end() == len(line.rstrip())
        return None if further or (stated > count and not classic) else match

    def _pass_over(self, row: int, line: bytes) -> None:
        """Take the stamp of a line that is no frame.

        Raises:
            ValueError: If it is damaged.
        """
        cut = self._ends and row == len(self.start) - 1
        if not cut and self._grammar.other.match(line) is None:
            raise ValueError(f"line {self._lines + row + 1} is no frame: {line[:60].decode(errors='replace')!r}")
        stamp = _STAMP.match(line) if self._grammar.relative else None
        if stamp is not None:
            self._note(row, stamp, float(stamp["time"]))

    def _octets(self, match: re.Match[bytes]) -> list[bytes]:
        return re.findall(rb"\w\w" if self._grammar.base == 16 else rb"\d+", match["data"])

    def _read_line(self, row: int, match: re.Match[bytes]) -> None:
        """Read a frame by itself."""
        base = self._grammar.base
        data = [int(octet, base) for octet in self._octets(match)][: _stated(match)]
        self._note(row, match, float(match["time"]))
        self._keep(row, match, np.array(int(match["id"], base), dtype=np.uint32), len(data))
        self.octets[row, : len(data)] = data

    def _read_alike(self, rows: NDArray[np.intp], line: bytes, match: re.Match[bytes]) -> Mask:
        """Read all frames of the shape of the first one, and return which of the rows those are.

        Two lines have one shape if they differ in digits of stamps, identifiers and data only.
        """
        places = [i for i in range(*match.span("data")) if line[i] > _SPACE]
        stated, high = _stated(match), places[::2]
        high = high[:stated]
        end = len(line) if stated is None else high[-1] + 2 if high else match.start("data")
        start, likely = self.start[rows], np.ones(len(rows), dtype=bool)
        for begin in {match.start(name) for name in _FREE if name in match.re.groupindex}:  # quicker than all places
            for place in (begin - 1, begin):
                if 0 <= place < end:
                    likely &= (self._text[start + place] > _SPACE) == (line[place] > _SPACE)
        start, rows = start[likely], rows[likely]
        text = np.lib.stride_tricks.sliding_window_view(self._text, end)[start]
        is_digit = (text ^ _ZERO) < 10
        is_hex = is_digit | ((text | 32) - ord("a") < 6)
        alike = text == text[0]
        alike |= is_digit & is_digit[0] & _spans(match, end, _FREE[:2])
        alike |= is_hex & is_hex[0] & _spans(match, end, _FREE[2:])
        chosen = alike.all(axis=1) & (self._text[start + end] <= _SPACE)
        text, rows = text[chosen], rows[chosen]
        begin, behind = match.span("time")
        stamps = np.ascontiguousarray(text[:, begin:behind]).view(f"S{behind - begin}")[:, 0].astype(float)
        nibble = (text & 15) + 9 * (text >> 6)
        identifier = np.zeros(len(text), dtype=np.uint32)
        for place in range(*match.span("id")):
            identifier = identifier << 4 | nibble[:, place]
        self._note(rows, match, stamps)
        self._keep(rows, match, identifier, len(high))
        self.octets[rows, : len(high)] = nibble[:, high] << 4 | nibble[:, [i + 1 for i in high]]
        likely[likely] = chosen
        return likely

    def _note(self, rows: NDArray[np.intp] | int, match: re.Match[bytes], stamps: Floats | float) -> None:
        self.time[rows] = stamps
        self.decimals = max(self.decimals, len(match["time"].partition(b".")[2]))

    def _keep(
        self, rows: NDArray[np.intp] | int, match: re.Match[bytes], identifier: NDArray[np.uint32], size: int
    ) -> None:
        """Keep frames, unless their identifiers mark errors."""
        name = match.groupdict().get("bus", b"1")
        self.bus[rows] = self._buses.setdefault(name, len(self._buses))
        self.size[rows] = size
        extended = EXTENDED * (match["x"] is not None)
        self.identifier[rows] = identifier & 0x1FFFFFFF | extended
        self.is_frame[rows] = not extended or identifier & _FLAGS == 0


def _stated(match: re.Match[bytes]) -> int | None:
    """Return how many bytes the line of a frame says that it has; ``None`` if it does not say so."""
    groups = match.groupdict()
    if "length" in groups:
        return min(int(groups["length"]), _LONGEST)
    code = groups.get("dlc")
    if code is None:
        return None
    return _LENGTHS[min(int(code, 16 if len(code) == 1 else 10), len(_LENGTHS) - 1)]


def _spans(match: re.Match[bytes], end: int, names: Sequence[str]) -> Mask:
    """Return which of the first places of a line are in groups."""
    inside = np.zeros(end, dtype=bool)
    for name in names:
        if name in match.re.groupindex:
            begin, behind = match.span(name)
            inside[begin:behind] = True
    return inside
