"""Propose a channel map for a recording: which column may be which signal, in which unit, with which sign.

It is a guess to be checked, with reasons for every entry: by the name of the column, the unit that the file or the
name states, the range of the values, and by what signals have to do with each other, ``a_y = v r`` in slow changes.
"""

from __future__ import annotations

import itertools
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import toml_text
from harness.common.unit_spellings import unit_of
from harness.models.signals import SIGNALS, TRUTH
from harness.recordings import readers
from harness.recordings.proposal.column_choice import (
    WHEELBASE,
    WHEELBASES,
    Chosen,
    ClockColumn,
    by_samples,
    choose,
    clocks_of,
    cut,
    filled,
    is_time,
    seconds_of,
)
from harness.recordings.proposal.column_names import AXLE, Reading, read_name
from harness.recordings.proposal.column_values import (
    ALIKE,
    NOBODY,
    Guess,
    Motion,
    MotionPair,
    Witness,
    compared,
    in_units,
    with_convention,
    witness,
)
from harness.recordings.read.channel_map import relative
from harness.recordings.read.span import named_parts

_ALIKE = 0.9
"""Correlation of a column with what the motion makes of the others from which it is taken for their signal."""
_SAYS_NOTHING = "its name says nothing of a signal"
_ACROSS = {"lateral_acceleration": "longitudinal_acceleration", "longitudinal_acceleration": "lateral_acceleration"}
_OTHER_AXES = 1.5
"""Log odds against the other axis of an acceleration whose axis a letter names."""
_RATE = 1.5
"""Log odds against the yaw rate of a column that is called yaw."""
_STEERS = 0.3
"""Correlation of steering and yaw rate from which its sign counts."""
_AS_FAST = 0.1
"""Relative difference within which a velocity along x is the speed."""
_AXES = 0.4
"""Velocity across over that along from which both are along axes that are fixed to the ground."""


@dataclass(frozen=True)
class Proposal:
    """A channel map as proposed.

    Attributes:
        guesses: Its entries.
        clocks: Columns of time with their units and why.
        left_out: Columns that are no entry, with the reason of each.
        notes: Further notes for the user.
        text: The map, as a file.
    """

    guesses: tuple[Guess, ...]
    clocks: tuple[ClockColumn, ...]
    left_out: Mapping[str, str]
    notes: tuple[str, ...]
    text: str = field(default="", repr=False)

    def lines(self) -> list[str]:
        """Return what was guessed and why, in lines."""
        lines = [f"time: '{c.column}' in {c.unit} ({c.why})" for c in self.clocks]
        for g in self.guesses:
            sign = ", reversed" if g.sign < 0 else ", clockwise from north" if g.compass else ""
            lines.append(f"{g.signal}: '{g.column}' in {g.unit}{sign} ({'; '.join(g.why)})")
        return [*lines, *self.omissions(), *(f"note: {note}" for note in self.notes)]

    def omissions(self) -> list[str]:
        """Return a line per reason with the columns that are left out for it."""
        columns: dict[str, list[str]] = {}
        for column, why in self.left_out.items():
            columns.setdefault(why, []).append(f"'{column}'")
        return [f"left out: {', '.join(names)} ({why})" for why, names in columns.items()]


@dataclass
class _Columns:
    """Candidates for the columns of a recording.

    Attributes:
        front: Guesses of the vehicle, or of the tractor.
        rear: Those of a trailer.
        unread: Columns whose names say nothing, but their unit.
        left_out: Columns that can be no entry, with the reason.
    """

    front: list[Guess]
    rear: list[Guess]
    unread: list[Guess]
    left_out: dict[str, str]


def propose(path: Path, databases: Sequence[str] = (), folder: Path = Path()) -> Proposal:
    """Return a channel map for a recording, guessed from names, units, ranges and how signals belong together.

    Args:
        path: Recording, or a part of one: ``log.csv@0s:118s``.
        databases: Of the messages of a bus log, each as ``[BUS=]FILE``.
        folder: Where the map is to lie, from which it names the databases.

    Raises:
        UserError: If it cannot be read, or no column looks like a signal.
    """
    file, _, span = named_parts(path)
    measured = readers.read_tables(file, databases=databases)
    tables = [filled(table) for table in measured]
    own_clocks = [clocks_of(table) for table in tables]
    if span is not None:
        tables = [cut(table, seconds_of(table, own), span, path) for table, own in zip(tables, own_clocks, strict=True)]
    motion = Motion([seconds_of(table, own) for table, own in zip(tables, own_clocks, strict=True)])
    columns = _read(tables, own_clocks, motion)
    columns.front = by_samples(columns.front, measured)
    seen = witness(motion, {g.signal: g for g in sorted(columns.front, key=lambda g: g.points)})
    chosen = choose(columns.front, motion, seen)
    if further := _by_unit_and_motion(columns.unread, chosen.guesses, motion):
        chosen = choose([*columns.front, *further], motion, seen)
    guesses, notes = _settled(chosen, motion, seen)
    guesses = [with_convention(g, motion, chosen.guesses) for g in guesses]
    left_out = columns.left_out | chosen.lost
    if columns.rear or any(g.signal == "articulation_angle" for g in guesses):
        speed = [replace(g, free=False) for g in guesses if g.signal == "speed"]
        behind = choose([*speed, *columns.rear], motion, NOBODY)
        trailing, more = _settled(behind, motion, NOBODY)
        both = [*_of_body(guesses, "tractor"), *_of_body([g for g in trailing if g.signal != "speed"], "trailer")]
        guesses, notes = _articulated(both, motion), list(dict.fromkeys([*notes, *more]))
        left_out |= behind.lost
    else:
        guesses = _with_longitudinal_velocity(guesses, columns.front, motion)
    entries = {g.column for g in guesses}
    left_out = {column: why for column, why in left_out.items() if column not in entries}
    if not guesses:
        named = ", ".join(f"'{c}'" for table in tables for c in table.columns)
        named += "".join(f"; {note}" for table in tables for note in table.notes)
        why = "; ".join(f"'{c}': {reason}" for c, reason in left_out.items() if reason != _SAYS_NOTHING)
        raise UserError(
            f"{path}: no column looks like a signal of a vehicle: {named}; {f'{why}; ' if why else ''}write the map "
            "by hand (docs/measured-data.md)"
        )
    used = {g.table for g in guesses}  # a format's own clocks of other messages need no entry
    clocks = tuple(c for i, own in enumerate(own_clocks) for c in own if i in used or c[0] != tables[i].clock)
    notes += [*(note for table in tables for note in table.notes), *_further_notes(guesses, clocks, left_out)]
    result = Proposal(tuple(guesses), clocks, left_out, tuple(notes))
    return replace(result, text=_text(result, file, [relative(each, folder) for each in databases]))


def _read(tables: Sequence[readers.Table], own_clocks: Sequence[Sequence[ClockColumn]], motion: Motion) -> _Columns:
    """Return what the columns may be by their names, units and ranges."""
    columns = _Columns([], [], [], {})
    for number, (table, own) in enumerate(zip(tables, own_clocks, strict=True)):
        clocks = {name for c in own for name in (c.column, *(c.plus or ())[:1])} if own else {table.clock}
        columns.left_out |= {
            column: f"text that is no time as it is read ('{cell}'): {readers.TEXT_CLOCKS}"
            for column, cell in table.texts.items()
            if is_time(column)
        }
        for column, values in table.columns.items():
            if column in clocks or column.startswith(TRUTH):
                continue
            reading = read_name(column, table.units.get(column, ""))
            guesses, why_not = _guesses(column, values, number, reading)
            if reading.trailer and reading.signal != "speed":
                columns.rear += [g for g in guesses if f"{g.signal}_trailer" in SIGNALS]
                why_not = why_not or "measured on the trailer"
            else:
                columns.front += guesses
            if why_not:
                columns.left_out[column] = why_not
            if reading.unit is not None and why_not in (AXLE, _SAYS_NOTHING):
                columns.unread.append(Guess("", column, reading.unit.text, values, number, True, sure=4.0))
    fixed = _in_fixed_axes(columns.front, motion)
    columns.front = [g for g in columns.front if g.column not in fixed]
    columns.left_out |= fixed
    return columns


def _guesses(column: str, values: Floats, table: int, reading: Reading) -> tuple[list[Guess], str]:
    """Return which signals a column may be, in each unit that it may have; why it is none, where it is none."""
    if not reading.signal:
        return [], reading.why_not or _SAYS_NOTHING
    finite = values[np.isfinite(values)]
    if len(finite) < 2:
        return [], "it holds no values"
    if not finite.any():
        return [], "it is 0 all the time"
    signal, unit = reading.signal, reading.unit
    signal = "speed" if signal == "longitudinal_velocity" else signal
    exact = signal == "_".join(reading.words.split())
    by = "name of the signal" if exact else f"name reads “{reading.words}”"
    stated = unit is not None
    text, why = SIGNALS[signal].unit if unit is None else unit.text, f"unit by the {unit.by}" if unit else ""
    if unit is None and signal in ("latitude", "longitude"):
        text, why, stated = "deg", "usual unit", True
    elif unit is None and signal == "heading":
        largest = float(np.abs(finite).max())
        if largest > 6.5 and np.abs(np.diff(finite)).max() > 50:
            text, why, stated = "deg", f"values to {largest:.4g} that wrap, so degrees", True
    first = Guess(signal, column, text, values, table, stated, (why,), sure=reading.sure)
    made = in_units(first, by, reading.symbol)
    if not made:
        reached = f"{float(np.quantile(np.abs(finite), 0.995)):.4g} {text if stated else ''}".strip()
        return [], f"may be {signal} by its name, but its values to {reached} are those of no vehicle"
    if reading.letter and signal in _ACROSS:
        other = replace(first, signal=_ACROSS[signal], sure=first.sure - _OTHER_AXES)
        made += in_units(other, f"{by}, and it moves as the other axis of the vehicle", reading.symbol)
    if signal == "heading" and unit is None and reading.bare:
        made += in_units(replace(first, signal="yaw_rate", unit="rad/s", sure=first.sure - _RATE), by, reading.symbol)
    if signal == "steering_wheel_angle" and not reading.handwheel:
        road = replace(first, signal="road_wheel_angle", sure=first.sure - 1.0)
        made += in_units(road, by, reading.symbol)
    return made, ""


def _in_fixed_axes(candidates: Sequence[Guess], motion: Motion) -> dict[str, str]:
    """Return velocities along x and y that are as large, with the reason: the axes are not the vehicle's."""
    fixed: dict[str, str] = {}
    speeds, across = ([g for g in candidates if g.signal == s] for s in ("speed", "lateral_velocity"))
    for x, y in itertools.product(speeds, across):
        if x.unit == y.unit and y.column.lower().replace("y", "x") == x.column.lower().replace("y", "x"):
            forward, sideways = (np.nanmedian(np.abs(motion.series(g))) for g in (x, y))
            if sideways > _AXES * forward:
                fixed |= dict.fromkeys((x.column, y.column), "along x and y as fast: axes that are not the vehicle's")
    return fixed


def _by_unit_and_motion(unread: Sequence[Guess], guesses: Mapping[str, Guess], motion: Motion) -> list[Guess]:
    """Return speed and steering that no name tells: the only column in their unit, or that the motion needs.

    The speed times the yaw rate is nearly the lateral acceleration; the steering times the speed nearly in proportion
    to the yaw rate.
    """
    made = dict(guesses)
    for signal, kind in (("speed", "velocity"), ("steering_wheel_angle", "angle")):
        if signal in made or (signal != "speed" and "road_wheel_angle" in made):
            continue
        pool = []
        for g in (replace(u, signal=signal, why=("unit by the name",)) for u in unread):
            if (unit := unit_of(g.unit)) is not None and unit.si == SIGNALS[signal].unit:
                pool += in_units(g, f"in a unit of {kind}")
        moves = [
            replace(g, why=(f"{g.why[0]}, and as the others move", *g.why[1:]))
            for g in pool
            if _moves_alike(g, made, motion)
        ]
        only = [replace(g, why=(f"the only column {g.why[0]}", *g.why[1:])) for g in pool]
        if len(moves) == 1 or (signal == "speed" and len(only) == 1):
            made[signal] = moves[0] if len(moves) == 1 else only[0]
    return [g for signal, g in made.items() if signal not in guesses]


def _moves_alike(g: Guess, guesses: Mapping[str, Guess], motion: Motion) -> bool:
    """Return whether a column moves as its signal must."""
    names = ("yaw_rate", "lateral_acceleration") if g.signal == "speed" else ("speed", "yaw_rate")
    if not set(names) <= set(guesses):
        return False
    factor, product = (motion.series(guesses[n]) for n in names)
    values = motion.series(g)
    return len(values) == len(factor) and abs(compared("", (), product, values * factor).alike) > _ALIKE


def _settled(chosen: Chosen, motion: Motion, seen: Witness) -> tuple[list[Guess], list[str]]:
    """Return guesses with the signs by which their motions agree, with reasons, and notes on them."""
    guesses = dict(chosen.guesses)
    signs, notes = _signs(guesses, chosen.relations, motion, seen)
    for name, why in signs.items():
        guesses[name] = replace(guesses[name], sign=-1, why=(*guesses[name].why, why))
    agreeing = [r for r in chosen.relations if r.agrees]
    for linked in _linked(agreeing):
        signals = [s for s in dict.fromkeys(s for r in linked for s in r.signals) if s in guesses]
        units, turned = sum(guesses[s].free for s in signals), sum(s in signs for s in signals)
        nothing = units + turned >= len(linked)
        price = f"{_many(units, 'unit')} and {_many(turned, 'sign')} chosen for {_many(len(linked), 'agreement')}"
        price += ", which confirms nothing" * nothing
        for s in signals:
            agree = "; ".join(f"{r.name}: {abs(r.factor):.2f}" for r in linked if s in r.signals)
            guesses[s] = replace(guesses[s], why=(*guesses[s].why, f"{agree} ({price})"))
        if nothing:
            notes.append(f"{', '.join(signals)}: {price}; look at them")
    for r in chosen.relations:
        if not r.agrees and abs(r.alike) >= ALIKE:
            notes.append(f"{r.name} is {abs(r.factor):.3g}: a column is another signal, or in another unit")
        elif not r.agrees:
            notes.append(f"{r.name}: they hardly move alike (correlation {r.alike:.2f})")
    for s, g in guesses.items():
        if beaten := sum(why.startswith(f"'{g.column}' is ") for why in chosen.lost.values()):
            guesses[s] = replace(g, why=(*g.why, f"best of {beaten + 1} columns"))
    together = {s for r in agreeing for s in r.signals} | {s for s, g in guesses.items() if _turns(g)}
    if alone := [s for s, g in guesses.items() if g.free and s not in together]:
        notes.append(f"{', '.join(alone)}: unit by the values alone, look at it")
    calm = not any(r.signals[0] == "lateral_acceleration" for r in chosen.relations)
    if {"speed", "yaw_rate", "lateral_acceleration"} <= set(guesses) and calm:
        notes.append("the recording hardly turns, so units and signs could not be compared: look at them")
    return list(guesses.values()), notes


def _turns(g: Guess) -> bool:
    """Return whether a steering angle was compared with the yaw rate."""
    return any(why.startswith(WHEELBASE) for why in g.why)


def _many(number: int, thing: str) -> str:
    return f"{number or 'no'} {thing}{'' if number == 1 else 's'}"


def _linked(relations: Sequence[MotionPair]) -> list[list[MotionPair]]:
    """Return relations in groups that share signals."""
    groups: list[list[MotionPair]] = []
    for r in relations:
        shared = [g for g in groups if any(set(r.signals) & set(o.signals) for o in g)]
        groups = [g for g in groups if g not in shared] + [[r, *(o for g in shared for o in g)]]
    return groups


def _signs(
    guesses: Mapping[str, Guess], relations: Sequence[MotionPair], motion: Motion, seen: Witness
) -> tuple[dict[str, str], list[str]]:
    """Return which signals count the other way and why, and notes: positions tell it, or two of three, or nothing."""
    by = {r.signals[0]: r for r in relations if abs(r.alike) >= ALIKE}
    signs: dict[str, str] = {}
    along, across, turn = (by.get(s) for s in ("longitudinal_acceleration", "lateral_acceleration", "yaw_rate"))
    if along is not None and along.factor < 0:
        signs["longitudinal_acceleration"] = "sign against the rate of the speed"
    wheel, rate = next((guesses[s] for s in WHEELBASES if s in guesses), None), guesses.get("yaw_rate")
    steers = np.nan
    if wheel is not None and rate is not None:
        steers = compared("", (), motion.series(wheel), motion.series(rate)).alike
    if seen.signed and turn is not None:
        if turn.factor < 0:
            signs["yaw_rate"] = "sign against the course over ground"
    elif across is not None and "yaw_rate" in across.signals and across.factor < 0 and steers < -_STEERS:
        signs["yaw_rate"] = "sign against the other and the steering"
    turned = -1 if "yaw_rate" in signs else 1
    if across is not None and across.factor * (turned if rate is not None else seen.signed) < 0:
        signs["lateral_acceleration"] = "sign against the yaw rate"
    if wheel is not None and steers * turned < -_STEERS:
        signs[wheel.signal] = "sign against the yaw rate"
    unknown = "" if seen.signed else "; which of them is right nothing here says"
    return signs, [f"{name} is reversed: {why}{unknown}" for name, why in signs.items()]


def _with_longitudinal_velocity(guesses: list[Guess], candidates: Sequence[Guess], motion: Motion) -> list[Guess]:
    """Return guesses with a longitudinal velocity: a column along x that moves as the speed, or the speed itself."""
    speed = next((g for g in guesses if g.signal == "speed"), None)
    if speed is None or any(g.signal == "longitudinal_velocity" for g in guesses):
        return guesses
    entries = {g.column for g in guesses}
    for g in candidates:
        if g.signal == "speed" and g.column not in entries and read_name(g.column).along:
            both = compared("", (), motion.series(g), motion.series(speed))
            if abs(both.alike) > _ALIKE and abs(both.factor - 1.0) < _AS_FAST:
                why = (*g.why, f"over the speed: {both.factor:.2f}")
                return [*guesses, replace(g, signal="longitudinal_velocity", why=why)]
    return [*guesses, replace(speed, signal="longitudinal_velocity", why=("the same column serves both",))]


def _of_body(guesses: Sequence[Guess], body: str) -> list[Guess]:
    """Return guesses of a vehicle combination: what either body has is that of one of them."""
    named = ((g, f"{g.signal}_{body}") for g in guesses)
    return [replace(g, signal=name) if name in SIGNALS and g.signal != "speed" else g for g, name in named]


def _articulated(guesses: Sequence[Guess], motion: Motion) -> list[Guess]:
    """Settle unit and sign of the articulation angle: it changes by what the yaw rates differ."""
    by_signal = {g.signal: g for g in guesses}
    names = ("articulation_angle", "yaw_rate_tractor", "yaw_rate_trailer")
    if not set(names) <= set(by_signal):
        return list(guesses)
    angle, front, rear = (by_signal[n] for n in names)
    turned = motion.series(rear) - motion.series(front)
    pairs = [
        (g, compared("its rate over that by the yaw rates", names, motion.rate(motion.series(g)), turned))
        for g in in_units(replace(angle, why=angle.why[1:]), angle.why[0])
    ]
    pairs = [(g, r) for g, r in pairs if abs(r.alike) > _ALIKE]
    if not pairs:
        return list(guesses)
    best, rates = min(pairs, key=lambda pair: abs(np.log(abs(pair[1].factor))))
    settled = replace(best, sign=-1 if rates.factor < 0 else 1, why=(angle.why[0], f"{rates.name}: {rates.factor:.2f}"))
    return [settled if g is angle else g for g in guesses]


def _further_notes(guesses: Sequence[Guess], clocks: Sequence[ClockColumn], left_out: Mapping[str, str]) -> list[str]:
    notes = []
    if not clocks:
        notes.append('no column of time was found; state one, or [recording] rate = "100 Hz"')
    wheels = [c for c, why in left_out.items() if why == AXLE or "one wheel" in why]
    if wheels and not any(g.signal == "speed" for g in guesses):
        notes.append(f"no speed of the vehicle; that of a wheel that is not driven may serve: {', '.join(wheels)}")
    steering = next((g for g in guesses if g.signal == "steering_wheel_angle"), None)
    if steering is not None and not _turns(steering) and np.nanmax(np.abs(steering.si)) < 0.7:
        notes.append(
            f"'{steering.column}' stays below {np.degrees(np.nanmax(np.abs(steering.si))):.0f} deg: if it is the angle "
            "of the road wheels, name it road_wheel_angle"
        )
    notes.append(
        "positive is x forward, y left, z up (ISO 8855): in a bend to the left steering, yaw rate and lateral "
        "acceleration must be positive"
    )
    return notes


def _text(proposal: Proposal, path: Path, databases: Sequence[str]) -> str:
    """Return the map as a file, with the reasons as comments."""
    content: dict[str, object] = {
        "title": f"Channels of {path.name}",
        "source": "whose recording, and may it be passed on?",
    }
    comments: dict[tuple[str, ...], str] = {}
    if databases:
        content["database"] = databases[0] if len(databases) == 1 else list(databases)
    if proposal.clocks:
        times = [
            {"channel": c.column, "unit": c.unit}
            | ({} if c.plus is None else {"plus": {"channel": c.plus[0], "unit": c.plus[1]}})
            for c in proposal.clocks
        ]
        content["time"] = times[0] if len(times) == 1 else times
    for g in proposal.guesses:
        entry: dict[str, object] = {"channel": g.column, "unit": g.unit}
        entry |= {"convention": "compass"} if g.compass else {}
        content[g.signal] = entry | ({"sign": -1} if g.sign < 0 else {})
        comments[g.signal,] = "; ".join(g.why)
    head = ["Proposed by harness new channels: a guess, look at every entry (docs/measured-data.md).", *proposal.notes]
    head += proposal.omissions()
    return "".join(f"# {line}\n" for line in head) + "\n" + toml_text(content, comments=comments)
