"""Tables that readers return: columns that share one clock."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field

from harness.common.arrays import Floats

Wanted = Callable[[str], bool]
"""Tells by the name of a column whether its values are used."""

NO_MEASUREMENT = 1e30
"""From here on a number is no measurement in any unit: what programs write for a missing one (the largest of its type),
or a damaged file. Such samples are missing, as NaN and infinite ones are."""

TEXT_CLOCKS = "write seconds, ISO 8601 (2025-05-05T10:00:00.25+02:00) or hh:mm:ss.s"
"""What to do about a clock of text that is not read."""

MOST_COLUMNS = 10_000
MOST_BYTES = 8 * 2**30
"""Of a recording, unpacked."""

MOST_PACKED = 100
"""Bytes that a byte of a packed log is unpacked into at most; measurements are packed to a half or a tenth."""
LEAST_PACKED = 64 * 2**20
"""Bytes that any file may be unpacked into."""


@dataclass(frozen=True)
class Table:
    """Columns of equal length that were sampled together.

    Attributes:
        columns: Values by name, each float64 of shape ``(samples,)``; missing samples are NaN.
        units: Units by column as the file states them; empty where it states none.
        clock: Column that holds the time in s, where the format itself says which one it is.
        notes: What is irregular about the file, in sentences.
        begun: When the clock was zero, in s since 1970, where the format says so.
        texts: The first cell of each column of text, which is left out.
    """

    columns: dict[str, Floats]
    units: dict[str, str] = field(default_factory=dict)
    clock: str | None = None
    notes: tuple[str, ...] = ()
    begun: float | None = None
    texts: dict[str, str] = field(default_factory=dict)


def by_length(vectors: dict[str, Floats]) -> list[Table]:
    """Group vectors by their length, the length that most of them share first (the longer if as many do).

    A single value is a parameter and no signal, and is left out.
    """
    lengths: dict[int, dict[str, Floats]] = {}
    for name, values in vectors.items():
        if len(values) > 1:
            lengths.setdefault(len(values), {})[name] = values
    ranked = sorted(lengths, key=lambda n: (len(lengths[n]), n), reverse=True)
    return [Table(lengths[n]) for n in ranked]
