"""Frames of a bus to columns: all frames of one message at once, bit by bit as the database says."""

from __future__ import annotations

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from numpy.typing import NDArray

from harness.common.arrays import Floats, Mask
from harness.common.errors import UserError
from harness.common.files import refuse_beyond
from harness.recordings.readers._database import Database, Message, load_databases
from harness.recordings.readers._frames import Frames, identifiers_in_words, in_hex, named_database
from harness.recordings.readers._table import MOST_BYTES, MOST_COLUMNS, Table, Wanted
from harness.recordings.readers._transport import put_together

_VALID_J1939 = 0xFA
"""Largest upper byte of a value of eight bits or more; beyond it stand indicators, errors and "not available"."""
_NO_VALUE = re.compile(r"inval|not.?(avail|valid)|n/?a\b|sna\b|err|fault|init|unknown|ung.ltig|fehler", re.I)


@dataclass(frozen=True)
class Stream:
    """All frames of a message from one bus and, of J1939, from one address.

    Attributes:
        label: Name of the message, with bus and address where others of that name are in the file.
        message: What it is.
        rows: Its frames.
    """

    label: str
    message: Message
    rows: NDArray[np.intp]


class Octets:
    """Bytes of some frames, each gathered once."""

    def __init__(self, frames: Frames, rows: NDArray[np.intp]) -> None:
        self._start, self.length, self._payload = frames.start[rows], frames.length[rows], frames.payload
        self._shortest = int(self.length.min())
        self._gathered: dict[int, NDArray[np.uint64]] = {}

    def __getitem__(self, place: int) -> NDArray[np.uint64]:
        """Return the byte at a place of each frame ``(frames,)``, anything where a frame is shorter."""
        if place not in self._gathered:
            at = self._start + place
            if place >= self._shortest:
                at = np.minimum(at, len(self._payload) - 1)
            self._gathered[place] = self._payload[at].astype(np.uint64)
        return self._gathered[place]

    def hold(self, last: int) -> Mask | None:
        """Return which frames have a byte at a place; ``None`` if all have."""
        return None if self._shortest > last else self.length > last


def decoded(path: str, frames: Frames, databases: Sequence[str], wanted: Wanted | None = None) -> list[Table]:
    """Return the signals of a bus log, one table per message with its stamps as clock, the largest first.

    The column of a signal is ``Message.Signal``. A message that comes from several buses or, of J1939, several
    addresses has each before and behind its name: ``2.Message@0B.Signal``. Values of J1939 that say "not available" or
    "error", values of a quantity that a value table names, and signals that end behind their frame are missing.

    Args:
        path: The log, for errors.
        frames: Of it.
        databases: Each as ``[BUS=]FILE``; of several the first that has a message describes it.
        wanted: Tells by its name whether a column is used; all are where none is.

    Raises:
        UserError: If no database is named, one cannot be read, or none has a message of the log.
    """
    if not databases:
        raise named_database(path, frames)
    loaded = load_databases(databases)
    for database in loaded:
        if database.bus and database.bus not in frames.buses:
            raise UserError(
                f"{path}: has no bus '{database.bus}', for which {database.file} is named; there are "
                f"{', '.join(frames.buses)}"
            )
    frames = put_together(frames, {group for database in loaded for group in database.by_group})
    streams = _streams(frames, loaded)
    coverage = _coverage(frames, streams, loaded)
    if not streams:
        raise UserError(f"{path}: {coverage}; name the database of this bus")
    chosen = [(s, [x for x in s.message.signals if wanted is None or wanted(f"{s.label}.{x.name}")]) for s in streams]
    if not any(signals for _, signals in chosen):
        chosen = [(s, list(s.message.signals)) for s in streams]
    refuse_beyond(path, "the bus log", sum(len(signals) for _, signals in chosen), MOST_COLUMNS, "signals")
    size = sum(8 * len(s.rows) * (len(signals) + 1) for s, signals in chosen if signals)
    refuse_beyond(path, "the bus log, decoded,", size, MOST_BYTES, "bytes")
    tables = [table for s, signals in chosen if signals for table in _tables(frames, s, signals)]
    tables.sort(key=lambda t: -len(t.columns))
    if tables:
        notes = _contradictions(frames, [s for s, signals in chosen if signals], loaded)
        notes = [coverage, *notes] if wanted is None else notes
        tables[0] = replace(tables[0], notes=(*notes, *tables[0].notes))
    return tables


def _streams(frames: Frames, databases: Sequence[Database]) -> list[Stream]:
    """Return the frames that a database knows, by bus, message and address."""
    keys, inverse = np.unique(frames.bus.astype(np.int64) << 32 | frames.identifier, return_inverse=True)
    numbers: dict[tuple[int, int, int], int] = {}
    messages: list[Message] = []
    of_key = np.full(len(keys), -1)
    for i, key in enumerate(keys.tolist()):
        bus, identifier = key >> 32, key & 0xFFFFFFFF
        fit = (d.message(identifier) for d in databases if d.bus in ("", frames.buses[bus]))
        message = next((m for m in fit if m is not None), None)
        if message is not None:
            address = identifier & (0xFF if message.is_j1939 else 0xFFFFFFFF)
            of_key[i] = numbers.setdefault((bus, id(message), address), len(numbers))
            messages += [message] * (len(numbers) - len(messages))
    of_frame = of_key[inverse.ravel()]
    order = np.argsort(of_frame, kind="stable")
    first = np.searchsorted(of_frame[order], np.arange(len(numbers) + 1))
    labels = _labels([(bus, m, a) for (bus, _, a), m in zip(numbers, messages, strict=True)], frames.buses)
    return [Stream(labels[i], m, order[first[i] : first[i + 1]]) for i, m in enumerate(messages)]


def _contradictions(frames: Frames, streams: Sequence[Stream], databases: Sequence[Database]) -> list[str]:
    """Return a sentence for each message that a later database describes otherwise."""
    notes = []
    for stream in streams:
        bus, identifier = frames.buses[frames.bus[stream.rows[0]]], int(frames.identifier[stream.rows[0]])
        for database in databases:
            other = database.message(identifier) if database.bus in ("", bus) else None
            if other is not None and other.layout() != stream.message.layout():
                notes.append(
                    f"{stream.label}: {stream.message.database} and {other.database} describe it differently; the "
                    "former is taken, as it is named first"
                )
    return list(dict.fromkeys(notes))


def _labels(sources: Sequence[tuple[int, Message, int]], buses: Sequence[str]) -> list[str]:
    """Return names of messages, told apart by bus and address where several have one name."""
    labels: list[str] = []
    for bus, message, address in sources:
        namesakes = [(b, a) for b, m, a in sources if m.name == message.name]
        label = message.name
        if len({a for _, a in namesakes}) > 1:
            label += f"@{address:02X}" if message.is_j1939 else f"@{in_hex(address)}"
        if len({b for b, _ in namesakes}) > 1:
            label = f"{buses[bus]}.{label}"
        labels.append(label if label not in labels else f"{label}#{len(labels)}")
    return labels


def _coverage(frames: Frames, streams: Sequence[Stream], databases: Sequence[Database]) -> str:
    """Return how many frames the databases know, and the identifiers of the others."""
    unknown = np.ones(len(frames.time), dtype=bool)
    for stream in streams:
        unknown[stream.rows] = False
    files = ", ".join(dict.fromkeys(d.file for d in databases))
    count = len(unknown) - int(unknown.sum())
    words = f"{files}: {count or 'none'} of {len(unknown)} frames on the bus are described there"
    return f"{words}; unknown: {identifiers_in_words(frames, unknown)}" if unknown.any() else words


def _tables(frames: Frames, stream: Stream, signals: Sequence[Any]) -> Iterator[Table]:
    """Yield the signals of a message, and those of each choice of its multiplexer, which have frames of their own."""
    octets = Octets(frames, stream.rows)
    by_choice: dict[tuple[str, tuple[int, ...]], list[Any]] = {}
    for signal in signals:
        choice = (str(signal.multiplexer_signal or ""), tuple(signal.multiplexer_ids or ()))
        by_choice.setdefault(choice if choice[0] else ("", ()), []).append(signal)
    for (multiplexer, choices), members in by_choice.items():
        sent = _sent(octets, stream.message, multiplexer, choices)
        if sent is not None and not sent.any():
            continue
        label = stream.label if sent is None else f"{stream.label}.{multiplexer}={','.join(map(str, choices))}"
        columns: dict[str, Floats] = {}
        units, notes = {}, []
        for signal in members:
            name = f"{stream.label}.{signal.name}"
            values, short = _values(octets, signal, stream.message.is_j1939)
            columns[name] = values if sent is None else values[sent]
            units[name] = signal.unit or ""
            lost = int((short if sent is None else short & sent).sum())
            if lost:
                notes.append(
                    f"{name}: {lost} of {len(columns[name])} frames are too short to hold it; they have no value"
                )
        clock = next(c for c in (f"{label}.time", f"{label}.stamp", f"{label}.logged at") if c not in columns)
        stamps = frames.time[stream.rows if sent is None else stream.rows[sent]]
        yield Table({clock: stamps, **columns}, {n: u for n, u in units.items() if u}, clock, tuple(notes))


def _sent(octets: Octets, message: Message, multiplexer: str, choices: Sequence[int]) -> Mask | None:
    """Return which frames of a message hold what a multiplexer chooses; ``None`` for all."""
    if not multiplexer:
        return None
    sent, passed = np.ones(len(octets.length), dtype=bool), set()
    while multiplexer:
        selector = next((s for s in message.signals if s.name == multiplexer), None)
        if selector is None or multiplexer in passed:  # of a damaged database
            return np.zeros(len(sent), dtype=bool)
        passed.add(multiplexer)
        sent &= np.isin(raw_values(octets, selector), choices) & (octets.length > last_octet(selector))
        multiplexer, choices = selector.multiplexer_signal or "", selector.multiplexer_ids or ()
    return sent


def _values(octets: Octets, signal: Any, is_j1939: bool) -> tuple[Floats, Mask]:
    """Return physical values, NaN where a frame holds none, and which frames are too short."""
    raw = raw_values(octets, signal)
    short = octets.length <= last_octet(signal)
    missing = short | _names_no_value(raw, signal)
    if is_j1939 and not (signal.is_signed or signal.conversion.is_float):
        missing |= _not_available(raw, signal.length)
    with np.errstate(invalid="ignore"):  # a signalling NaN
        values = raw.astype(float)
    values *= float(signal.scale)
    values += float(signal.offset)
    values[missing] = np.nan
    return values, short


def raw_values(octets: Octets, signal: Any) -> NDArray[Any]:
    """Return the raw values of a signal ``(frames,)``, all bits of them: unsigned, signed or floating point.

    Args:
        octets: Bytes of the frames.
        signal: Its place in them, as cantools describes it: the number of its lowest bit where the first byte is the
            lowest, of its highest one where it is the highest, eight to a byte from the lowest.
    """
    little = signal.byte_order == "little_endian"
    begin = signal.start if little else signal.start // 8 * 8 + 7 - signal.start % 8
    first, last = begin // 8, (begin + signal.length - 1) // 8
    below = begin % 8 if little else 7 - (begin + signal.length - 1) % 8
    value: NDArray[Any] = np.zeros(len(octets.length), dtype=np.uint64)
    for place in range(first, last + 1):
        shift = 8 * (place - first if little else last - place) - below
        octet = octets[place]
        value |= octet << np.uint64(shift) if shift >= 0 else octet >> np.uint64(-shift)
    if signal.length < 64:
        value &= np.uint64((1 << signal.length) - 1)
    if signal.conversion.is_float:
        return value.astype(f"u{signal.length // 8}").view(f"f{signal.length // 8}")
    if signal.is_signed:
        sign = np.uint64(1 << signal.length - 1)
        return ((value ^ sign) - sign).view(np.int64)
    return value


def last_octet(signal: Any) -> int:
    """Return the place of the last byte that a signal takes."""
    little = signal.byte_order == "little_endian"
    begin = signal.start if little else signal.start // 8 * 8 + 7 - signal.start % 8
    return int(begin + signal.length - 1) // 8


def _not_available(raw: NDArray[Any], length: int) -> Mask:
    """Return which unsigned values are no measurement by SAE J1939-71, 5.1.4: error, not available, indicators."""
    if length >= 8:
        return np.asarray(raw >> np.uint64(length - 8) > _VALID_J1939)
    return np.asarray(raw >= (1 << length) - 2) if length > 1 else np.zeros(len(raw), dtype=bool)


def _names_no_value(raw: NDArray[Any], signal: Any) -> Mask:
    """Return which values a value table names that are no measurement.

    A table of a plain number that begins with two neighbours in the lower half of its range lists states, which are
    kept. In any other one the names stand for what the quantity is not: only that of zero may be a place on its scale.
    """
    names = {int(value): str(text) for value, text in (signal.choices or {}).items()}
    lowest = sorted(names)[:2]
    states = len(lowest) == 2 and lowest[1] - lowest[0] == 1 and 2 * lowest[0] < 1 << signal.length
    if not names or (states and signal.scale == 1 and signal.offset == 0):
        return np.zeros(len(raw), dtype=bool)
    nothing = [value for value, text in names.items() if value != 0 or _NO_VALUE.search(text)]
    if raw.dtype.kind == "f":
        return np.isin(raw, nothing)
    limits = np.iinfo(raw.dtype)
    return np.isin(raw, np.array([v for v in nothing if limits.min <= v <= limits.max], dtype=raw.dtype))
