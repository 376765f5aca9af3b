"""Propose a channel map for a recording: which column may be which signal, in which unit, with which sign.

It is a guess to be looked at, and says for every entry why: by the name of the column, the unit that the file or the
name states, the range of the values, and by what signals have to do with each other, ``a_y = v r`` in slow changes.
"""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import toml_text
from harness.common.units import scale
from harness.models.signals import SIGNALS, TRUTH
from harness.recordings import readers
from harness.recordings.channels import is_measured
from harness.recordings.column_names import NAMES, TIME, TRAILER, in_words, stated_unit

_TAKEN_TWICE = {"speed": "longitudinal_velocity"}
_DISTANCES = ("position_x", "position_y")

_UNITS: dict[str, tuple[str, ...]] = {
    "rad": ("rad", "deg"),
    "rad/s": ("rad/s", "deg/s"),
    "rad/s^2": ("rad/s^2", "deg/s^2"),
    "m/s": ("m/s", "km/h"),
    "m/s^2": ("m/s^2", "g_0"),
    "m": ("m",),
}
"""Units that a column may have by the SI unit of its signal, SI first."""

_LIMITS = {"rad": 12.5, "rad/s": 3.0, "rad/s^2": 30.0, "m/s": 75.0, "m/s^2": 1e9, "m": 1e9}
"""Largest magnitude that is taken to be in SI units; a heading may have turned further."""

_ENOUGH = 50
"""Samples that a comparison of signals needs."""

_AGREES = 0.3
"""Correlation of steering and yaw rate from which its sign counts."""


_ALIKE = 0.9
"""Correlation of a column with what the motion makes of the others from which it is taken for their signal."""


@dataclass(frozen=True)
class Guess:
    """One entry of the map.

    Attributes:
        signal: Signal.
        column: Column of the file.
        unit: Unit of the column.
        values: Its values as recorded ``(samples,)``.
        stated: Whether file or name state the unit.
        why: Reasons, in words.
        sign: -1 where the column counts the other way.
    """

    signal: str
    column: str
    unit: str
    values: Floats
    stated: bool
    why: tuple[str, ...] = ()
    sign: int = 1

    @property
    def si(self) -> Floats:
        """Values in SI units."""
        return self.sign * self.values * scale(self.unit, SIGNALS[self.signal].unit, self.column)


@dataclass(frozen=True)
class Proposal:
    """A channel map as proposed.

    Attributes:
        guesses: Its entries.
        clocks: Columns of time with their units and why.
        left: Columns that nothing was guessed of.
        notes: What else the user should know.
        text: The map, as a file.
    """

    guesses: tuple[Guess, ...]
    clocks: tuple[tuple[str, str, str], ...]
    left: tuple[str, ...]
    notes: tuple[str, ...]
    text: str = field(default="", repr=False)

    def said(self) -> list[str]:
        """Return what was guessed and why, in lines."""
        lines = [f"time: '{column}' in {unit} ({why})" for column, unit, why in self.clocks]
        for g in self.guesses:
            sign = ", reversed" if g.sign < 0 else ""
            lines.append(f"{g.signal}: '{g.column}' in {g.unit}{sign} ({'; '.join(g.why)})")
        return lines + [f"note: {note}" for note in self.notes]


def propose(path: Path) -> Proposal:
    """Return a channel map for a recording, guessed from names, units, ranges and how signals belong together.

    Args:
        path: Recording.

    Raises:
        UserError: If it cannot be read, or no column looks like a signal.
    """
    tables = [_filled(table) for table in readers.read_tables(path)]
    clocks: list[tuple[str, str, str]] = []
    guesses: list[Guess] = []
    left: list[str] = []
    for table in tables:
        own = _clocks(table)
        clocks += own
        taken: list[str | None] = [column for column, _, _ in own] or [table.clock]
        for column, values in table.columns.items():
            if column not in taken:
                guess = _guess(column, values, table.units.get(column, ""))
                left += [column] if guess is None else []
                guesses += [] if guess is None else [guess]
    for signal in ("speed", "steering_wheel_angle"):
        if not any(g.signal == signal for g in guesses):
            guesses += _by_unit_and_motion(signal, tables, left, guesses)
            left = [column for column in left if column not in [g.column for g in guesses]]
    every = guesses
    guesses, doubled = _one_each([g for g in every if not _on_trailer(g)])
    behind, more = _one_each([g for g in every if _on_trailer(g)])
    doubled += more
    if not guesses and not behind:
        columns = ", ".join(f"'{c}'" for table in tables for c in table.columns)
        raise UserError(
            f"{path}: no column looks like a signal of a vehicle: {columns}; write the map by hand "
            "(docs/measured-data.md)"
        )
    guesses, notes = _settled(guesses, tables)
    if behind or any(g.signal == "articulation_angle" for g in guesses):
        speed = [g for g in guesses if g.signal == "speed"]
        behind, further = _settled([*speed, *behind], tables)
        both = [*_of_body(guesses, "tractor"), *_of_body([g for g in behind if g.signal != "speed"], "trailer")]
        guesses = _articulated(both, tables, clocks)
        notes = list(dict.fromkeys([*notes, *further]))
    else:
        guesses += [
            replace(g, signal=_TAKEN_TWICE[g.signal], why=("the same column serves both",))
            for g in guesses
            if g.signal in _TAKEN_TWICE and not any(o.signal == _TAKEN_TWICE[g.signal] for o in guesses)
        ]
    notes += _further_notes(guesses, clocks, doubled)
    result = Proposal(tuple(guesses), tuple(clocks), (*left, *doubled), tuple(notes))
    return replace(result, text=_text(result, path))


def _filled(table: readers.Table) -> readers.Table:
    """Return a table with values joined over the rows of other messages, so that columns can be compared row by row."""
    columns, rows = {}, np.arange(len(next(iter(table.columns.values()))))
    for name, values in table.columns.items():
        known = np.flatnonzero(is_measured(values))
        columns[name] = values
        if 1 < len(known) < len(rows):
            columns[name] = np.interp(rows, known, values[known], left=np.nan, right=np.nan)
    return replace(table, columns=columns)


def _clocks(table: readers.Table) -> list[tuple[str, str, str]]:
    """Return the clock of a table; where its vectors are those of several structures, that of each which has one.

    Clocks of one recording run at the same time; a time of day beside it is none.
    """
    native = None if table.clock not in table.columns else _clock(table, [str(table.clock)])
    if native is not None:
        return [native]
    of_structures: dict[str, list[str]] = {}
    for column in table.columns:
        if TIME.search(in_words(column)):
            of_structures.setdefault(column.rpartition(".")[0], []).append(column)
    found = [c for c in (_clock(table, columns) for columns in of_structures.values()) if c is not None]
    spans = [np.nanquantile(table.columns[column], [0.0, 1.0]) * scale(unit, "s", "time") for column, unit, _ in found]
    return [c for c, (begin, end) in zip(found, spans, strict=True) if begin <= spans[0][1] and end >= spans[0][0]]


def _clock(table: readers.Table, columns: Sequence[str]) -> tuple[str, str, str] | None:
    """Return the first of some columns that rises as a clock does, its unit and why."""
    for column in columns:
        steps = np.diff(table.columns[column])
        steps = steps[np.isfinite(steps)]
        if len(steps) < 2 or (steps < 0).mean() > 0.01:
            continue
        if column == table.clock:
            return column, "s", "the format says so"
        stated, step = stated_unit(column, table.units.get(column, "")), float(np.median(steps))
        if stated is not None and stated[0] in ("s", "ms", "us", "ns"):
            return column, stated[0], stated[1]
        for unit, largest in (("s", 0.5), ("ms", 500.0), ("us", 5e5), ("ns", 5e8)):
            if step <= largest:
                return column, unit, f"rises by {step:g} from row to row, unit by that: {_rate(step, unit)}"
    return None


def _rate(step: float, unit: str) -> str:
    seconds = step * {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}[unit]
    return f"{1 / seconds:.4g} Hz" if seconds > 0 else "several rows at a time"


def _guess(column: str, values: Floats, by_file: str) -> Guess | None:
    """Return which signal a column may be, by its name, and its unit."""
    if column.startswith(TRUTH):
        return None
    words = in_words(column)
    exact = "_".join(words.split()).removeprefix("measured_")
    signal = exact if exact in SIGNALS and exact != "time" else None
    why = "name of the signal"
    if signal is None:
        signal = next((s for s, pattern in NAMES if re.search(pattern, words)), None)
        why = f"name reads “{words}”"
    finite = values[np.isfinite(values)]
    if signal is None or len(finite) < 2:
        return None
    unit = SIGNALS[signal].unit
    possible = _UNITS.get(unit, (unit,))
    stated = stated_unit(column, by_file)
    if stated is not None and stated[0] in possible:
        return Guess(signal, column, stated[0], values, True, (why, stated[1]))
    if stated is not None and stated[0] not in ("g_0", "s", "m"):  # a speed in degrees is none
        return None
    largest = float(np.abs(finite).max())
    if signal in ("latitude", "longitude"):
        return Guess(signal, column, "deg", values, False, (why, "usual unit"))
    if signal == "heading" and largest > 6.5 and np.abs(np.diff(finite)).max() > 50:
        return Guess(signal, column, "deg", values, False, (why, f"values to {largest:.4g} that wrap, so degrees"))
    chosen = possible[0] if largest <= _LIMITS.get(unit, 1e9) or len(possible) == 1 else possible[1]
    return Guess(signal, column, chosen, values, False, (why, f"unit by its values to {largest:.4g}"))


def _by_unit_and_motion(
    signal: str, tables: Sequence[readers.Table], left: Sequence[str], known: Iterable[Guess]
) -> list[Guess]:
    """Return a signal that no name tells: the only column in its unit, or the only one of them that the motion needs.

    The speed times the yaw rate is nearly the lateral acceleration; the steering times the speed nearly in proportion
    to the yaw rate.
    """
    words = {"speed": "velocity", "steering_wheel_angle": "angle"}
    found = []
    for table in tables:
        for column in (c for c in left if c in table.columns):
            stated = stated_unit(column, table.units.get(column, ""))
            if stated is not None and stated[0] in _UNITS[SIGNALS[signal].unit]:
                found.append(Guess(signal, column, stated[0], table.columns[column], True, (stated[1],)))
    moves = [g for g in found if _moves_alike(g, {k.signal: k for k in known})]
    if len(moves) == 1:
        return [replace(moves[0], why=(f"in a unit of {words[signal]}, and as the others move", *moves[0].why))]
    if signal == "speed" and len(found) == 1:
        return [replace(found[0], why=("the only one in a unit of velocity", *found[0].why))]
    return []


def _moves_alike(guess: Guess, known: dict[str, Guess]) -> bool:
    """Whether a column moves as its signal must beside those that are known."""
    if guess.signal == "speed":
        rate, other = known.get("yaw_rate"), known.get("lateral_acceleration")
    else:
        rate, other = known.get("speed"), known.get("yaw_rate")
    if rate is None or other is None or len({len(guess.values), len(rate.values), len(other.values)}) > 1:
        return False
    return abs(_correlation(guess.si * rate.si, other.si)) > _ALIKE


def _one_each(guesses: Iterable[Guess]) -> tuple[list[Guess], list[str]]:
    """Return one guess per signal, that with a stated unit first, and the columns that are left."""
    kept: dict[str, Guess] = {}
    left: list[str] = []
    for g in guesses:
        before = kept.get(g.signal)
        if before is None or (g.stated and not before.stated):
            left += [] if before is None else [before.column]
            kept[g.signal] = g
        else:
            left.append(g.column)
    return list(kept.values()), left


def _on_trailer(g: Guess) -> bool:
    """Whether the name of a column says that it is the trailer's, of a signal that both bodies have."""
    return TRAILER.search(g.column.lower()) is not None and f"{g.signal}_trailer" in SIGNALS


def _settled(guesses: Sequence[Guess], tables: Sequence[readers.Table]) -> tuple[list[Guess], list[str]]:
    """Return guesses of one body with units and signs as its signals agree, and what there is to say about them."""
    first = [g for g in guesses if len(g.values) == len(next(iter(tables[0].columns.values())))]
    found, notes = _consistent({g.signal: g for g in first})
    return [found.get(g.signal, g) for g in guesses], notes


def _of_body(guesses: Sequence[Guess], body: str) -> list[Guess]:
    """Return guesses of a vehicle combination: what either body has is that of one of them."""
    named = ((g, f"{g.signal}_{body}") for g in guesses)
    return [replace(g, signal=name) if name in SIGNALS and g.signal != "speed" else g for g, name in named]


def _articulated(
    guesses: Sequence[Guess], tables: Sequence[readers.Table], clocks: Sequence[tuple[str, str, str]]
) -> list[Guess]:
    """Settle unit and sign of the articulation angle: in a second it changes by what the yaw rates differ."""
    known = {g.signal: g for g in guesses}
    names = ("articulation_angle", "yaw_rate_tractor", "yaw_rate_trailer")
    if not set(names) <= set(known) or not clocks:
        return list(guesses)
    angle, front, rear = (known[n] for n in names)
    time = next(t.columns[clocks[0][0]] for t in tables if clocks[0][0] in t.columns) * scale(clocks[0][1], "s", "time")
    if len({len(values) for values in (time, angle.values, front.values, rear.values)}) > 1:
        return list(guesses)
    step = float(np.nanmedian(np.diff(time)))
    second = max(1, round(1.0 / step))
    turned = np.cumsum(np.nan_to_num(rear.si - front.si)) * step
    units = (angle.unit,) if angle.stated else _UNITS["rad"]
    choices = [replace(angle, unit=unit) for unit in units]
    changes = [(g.si[second:] - g.si[:-second], turned[second:] - turned[:-second]) for g in choices]
    if not abs(_correlation(*changes[0])) > _ALIKE:
        return list(guesses)
    ratios = [float(np.nanstd(change) / np.std(by)) for change, by in changes]
    best = int(np.argmin(np.abs(np.log(ratios))))
    sign = -1 if _correlation(*changes[best]) < 0 else 1
    reason = f"its change in a second over that by the yaw rates: {sign * ratios[best]:.2f}"
    settled = replace(choices[best], sign=sign, why=(angle.why[0], reason))
    return [settled if g is angle else g for g in guesses]


def _consistent(known: dict[str, Guess]) -> tuple[dict[str, Guess], list[str]]:
    """Settle units and signs that are not stated by ``a_y = v r`` and by the steering."""
    if not {"speed", "yaw_rate", "lateral_acceleration"} <= set(known):
        alike, said = _steered_alike(known)
        return alike, ["units that are not stated go by the range of the values alone: look at them", *said]
    found = dict(known)
    notes: list[str] = []
    names = ("speed", "yaw_rate", "lateral_acceleration")
    choices: list[Sequence[Guess]] = [
        [known[n]] if known[n].stated else [replace(known[n], unit=u) for u in _UNITS[SIGNALS[n].unit]] for n in names
    ]
    ratios = [(_ratio(*combination), combination) for combination in itertools.product(*choices)]
    usable = [(k, c) for k, c in ratios if np.isfinite(k) and k != 0]
    if not usable:
        return known, ["the recording hardly turns, so units and signs could not be compared: look at them"]
    k, best = min(usable, key=lambda item: abs(np.log(abs(item[0]))))
    if not 0.5 < abs(k) < 2:
        notes.append(
            f"lateral acceleration is {abs(k):.3g} times speed times yaw rate: one of the three is another signal"
        )
        return found, notes
    for g in best:
        found[g.signal] = replace(g, why=(*g.why, f"lateral acceleration over speed times yaw rate: {abs(k):.2f}"))
    if k > 0:
        return _steered_alike(found)
    agree = _steering_over_yaw(found)
    turned = "yaw_rate" if agree < -_AGREES else "lateral_acceleration"
    reason = "against the other and the steering" if abs(agree) > _AGREES else "against the yaw rate"
    found[turned] = replace(found[turned], sign=-1, why=(*found[turned].why, f"sign {reason}"))
    notes.append(f"{turned} is reversed, because it counts {reason}; which of them is right nothing here says")
    return found, notes


def _steered_alike(known: dict[str, Guess]) -> tuple[dict[str, Guess], list[str]]:
    """Settle the sign of the steering by the yaw rate."""
    if not _steering_over_yaw(known) < -_AGREES:
        return known, []
    steering = known["steering_wheel_angle"]
    turned = replace(steering, sign=-1, why=(*steering.why, "sign against the yaw rate"))
    return {**known, turned.signal: turned}, [
        "steering_wheel_angle is reversed, because it counts against the yaw rate"
    ]


def _steering_over_yaw(known: dict[str, Guess]) -> float:
    """Return the correlation of the steering with the yaw rate, NaN where one of them is not known."""
    steering, rate = known.get("steering_wheel_angle"), known.get("yaw_rate")
    return np.nan if steering is None or rate is None else _correlation(steering.si, rate.si)


def _ratio(speed: Guess, rate: Guess, acceleration: Guess) -> float:
    """Return the slope of lateral acceleration over speed times yaw rate, where the vehicle turns."""
    product, measured = speed.si * rate.si, acceleration.si
    there = np.isfinite(product) & np.isfinite(measured)
    if there.sum() < _ENOUGH or product[there].std() == 0:
        return np.nan
    product, measured = product[there] - product[there].mean(), measured[there] - measured[there].mean()
    if abs(_correlation(product, measured)) < 0.5:
        return np.nan
    return float(np.copysign(measured.std() / product.std(), product @ measured))


def _correlation(one: Floats, other: Floats) -> float:
    if len(one) != len(other):
        return np.nan
    there = np.isfinite(one) & np.isfinite(other)
    if there.sum() < _ENOUGH or one[there].std() == 0 or other[there].std() == 0:
        return np.nan
    return float(np.corrcoef(one[there], other[there])[0, 1])


def _further_notes(
    guesses: Sequence[Guess], clocks: Sequence[tuple[str, str, str]], doubled: Sequence[str]
) -> list[str]:
    notes = []
    if not clocks:
        notes.append('no column of time was found; state one, or [recording] rate = "100 Hz"')
    if doubled:
        notes.append(f"left out, because another column is that signal: {', '.join(doubled)}")
    steering = next((g for g in guesses if g.signal == "steering_wheel_angle"), None)
    if steering is not None and np.nanmax(np.abs(steering.si)) < 0.7:
        notes.append(
            f"'{steering.column}' stays below {np.degrees(np.nanmax(np.abs(steering.si))):.0f} deg: if it is the angle "
            "of the road wheels, name it road_wheel_angle"
        )
    notes.append(
        "positive is x forward, y left, z up (ISO 8855): in a bend to the left steering, yaw rate and lateral "
        "acceleration must be positive"
    )
    return notes


def _text(found: Proposal, path: Path) -> str:
    """Return the map as a file, with the reasons as comments."""
    content: dict[str, object] = {"title": path.name, "source": "whose recording, and may it be passed on?"}
    comments: dict[tuple[str, ...], str] = {}
    if found.clocks:
        times = [{"channel": column, "unit": unit} for column, unit, _ in found.clocks]
        content["time"] = times[0] if len(times) == 1 else times
    for g in found.guesses:
        entry: dict[str, object] = {"channel": g.column, "unit": g.unit}
        content[g.signal] = entry | ({"sign": -1} if g.sign < 0 else {})
        comments[g.signal,] = "; ".join(g.why)
    head = ["Proposed by harness new channels: a guess, look at every entry (docs/measured-data.md).", *found.notes]
    if found.left:
        head.append(f"Columns left out: {', '.join(found.left)}.")
    return "".join(f"# {line}\n" for line in head) + "\n" + toml_text(content, comments=comments)
