"""From the columns of a file to one channel per signal: SI units, its own instants, its irregularities, its point."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from itertools import pairwise, takewhile

import numpy as np
import scipy
from numpy.typing import NDArray

from harness.common.arrays import Floats, Mask
from harness.common.errors import UserError
from harness.common.registry import closest
from harness.models.signals import SIGNALS, TRUTH
from harness.recordings.motion import kinematics
from harness.recordings.motion.kinematics import local_polynomial
from harness.recordings.motion.pose import COURSE
from harness.recordings.read.channel_map import Channel, ChannelMap, SensorPoint
from harness.recordings.read.clock import Clock, check_clock, spikes, steadied, updates
from harness.recordings.read.resample import segments
from harness.recordings.readers import NO_MEASUREMENT, TEXT_CLOCKS, Table

_BRIDGED = 5
"""Samples that may be missing in a row before it counts as a gap, unless the map states the time."""


@dataclass(frozen=True)
class Raw:
    """One channel, as delivered.

    Attributes:
        channel: Its entry in the map.
        time: s, instants of the samples that are not missing and not repeated.
        values: In SI units, before the lag and before it is moved to the reference point.
        largest_gap: s without samples that may be bridged.
        held: Rows of the file that one sample stands for (1: nothing is repeated).
        gaps: Stretches without samples longer than that, start and end in s.
        missing: Rows of the file without a value.
        missing_share: Share of the samples that a channel of its rate has in the file and that are missing.
        impossible: Rows whose value is infinite or beyond any measurement; they count as missing.
        spikes: Instants in s of single-sample spikes.
    """

    channel: Channel
    time: Floats
    values: Floats
    largest_gap: float
    held: int
    gaps: list[tuple[float, float]]
    missing: int
    missing_share: float
    impossible: int
    spikes: Floats


def plain_map(tables: list[Table], file: str) -> ChannelMap:
    """Return the map of a file whose columns carry the names of signals and SI units.

    Raises:
        UserError: If no column does, or the file itself states another unit.
    """
    channels = []
    for table in tables:
        for column in table.columns:
            name = column.removeprefix(TRUTH)
            if name not in SIGNALS or name == "time":
                continue
            stated = table.units.get(column, "")
            if stated and stated not in (SIGNALS[name].unit, SIGNALS[name].unit.replace("^", "**")):
                raise UserError(
                    f"{file}: column '{column}' is in {stated} by the file, in {SIGNALS[name].unit} by its name; "
                    f'write a channel map: {name} = {{ channel = "{column}", unit = "{stated}" }}'
                )
            channels.append(Channel(column, column, where=f"{file}: {column}"))
    if not channels:
        columns = [c for table in tables for c in table.columns]
        raise UserError(
            f"{file}: no column has the name of a signal (harness list signals), so a channel map is needed; "
            f"the file holds {', '.join(columns)}"
        )
    return ChannelMap(tuple(channels), {"time": (1.0, 1.0, 0.0)})


def collect(tables: list[Table], channels: ChannelMap, file: str) -> tuple[list[Raw], Clock]:
    """Return every channel of the map, and the clock that gives the common time base: that of the first signal.

    Of a long recording the columns are most of the memory: each gives up its values behind its last use.

    Raises:
        UserError: If a channel is not in the file, has no clock, holds no number, or nothing is left between start
            and stop.
    """
    places = [_place(tables, channel, file) for channel in channels.channels]
    clocks: dict[str, Clock] = {}
    for place, table in enumerate(tables):
        here = [c for n, c in zip(places, channels.channels, strict=True) if n == place]
        for message, rows in _messages(table, here, channels):
            named: dict[str | None, list[Channel]] = {}
            for channel in message:
                named.setdefault(_named_clock(table, channels, file, channel), []).append(channel)
            for name, members in named.items():
                clock = _clock(table, name, rows, channels, file, members)
                clocks |= {c.channel: clock for c in members}
    raws = _raws(tables, places, clocks, channels, file)
    warnings = dict.fromkeys(w for clock in clocks.values() for w in clock.warnings)
    return raws, replace(clocks[channels.channels[0].channel], warnings=tuple(warnings))


def _raws(
    tables: list[Table], places: list[int], clocks: Mapping[str, Clock], channels: ChannelMap, file: str
) -> list[Raw]:
    """Return every channel; what no later one takes gives up its values."""
    used = [name for c in channels.channels for name in (c.channel, c.reverse, validity(c)[0])]
    raws = []
    for i, (n, channel) in enumerate(zip(places, channels.channels, strict=True)):
        for table in tables:
            for name in set(table.columns) - set(used[3 * i :]):
                table.columns[name] = np.empty(0)
        raws.append(_raw(tables[n], channel, clocks[channel.channel], channels, file))
    return raws


def _place(tables: list[Table], channel: Channel, file: str) -> int:
    """Return the number of the table that has a channel."""
    for n, table in enumerate(tables):
        if channel.channel in table.columns:
            return n
    names = [c for table in tables for c in table.columns]
    raise UserError(f"{channel.where}: {file} has no channel '{channel.channel}'{closest(channel.channel, names)}")


def _messages(
    table: Table, mapped: list[Channel], channels: ChannelMap
) -> Iterator[tuple[list[Channel], NDArray[np.intp]]]:
    """Yield channels that come together, and their rows: in some tables each message of a bus has rows of its own.

    What is not mapped may be of the same message or of another one; a column that is never blank is a clock, or counts.
    """
    names, clocks = {c.channel for c in mapped}, {table.clock, *channels.clocks}
    there = {n: is_measured(column) for n, column in table.columns.items() if n in names or n not in clocks}
    remaining = {n: rows for n, rows in there.items() if n in names or not rows.all()}
    messages = []
    while remaining:
        first = max(remaining.values(), key=np.count_nonzero)
        together = [n for n, rows in remaining.items() if _come_together(rows, first)]
        messages.append((together, np.any([remaining.pop(n) for n in together], axis=0)))
    for together, rows in messages:
        if here := [c for c in mapped if c.channel in together]:
            yield here, np.flatnonzero(rows) if len(messages) > 1 else np.arange(len(rows))


def _come_together(channel: Mask, others: Mask) -> bool:
    """Return whether most values of a channel are in the rows of others, in the stretch in which both have any."""
    if np.count_nonzero(channel) < 2:
        return True
    (first, last), (begin, end) = (np.flatnonzero(rows)[[0, -1]] for rows in (channel, others))
    part = slice(max(first, begin), min(last, end) + 1)
    return bool(2 * np.count_nonzero((channel & others)[part]) >= np.count_nonzero(channel[part]))


def is_measured(column: Floats) -> Mask:
    """Return which values a sensor may have given: neither blanks nor numbers that stand for them ``(rows,)``."""
    return np.asarray(np.abs(column) < NO_MEASUREMENT)


def _named_clock(table: Table, channels: ChannelMap, file: str, channel: Channel) -> str | None:
    """Return the clock of a channel: of those of the map in its table the one in the same structure, or the format's.

    Vectors of the same length are one table, also where each message of a bus has stamps of its own.
    """

    def shared(clock: str) -> int:
        parts = zip(clock.split("."), channel.channel.split("."), strict=False)
        return sum(1 for _ in takewhile(lambda pair: pair[0] == pair[1], parts))

    mapped = [c for c in channels.clocks if c in table.columns]
    if not mapped:
        return table.clock
    nearest = [c for c in mapped if shared(c) == max(map(shared, mapped))]
    first = table.columns[nearest[0]]
    for other in nearest[1:]:
        if not np.array_equal(first, table.columns[other], equal_nan=True):
            raise UserError(
                f"{channel.where}: '{nearest[0]}' and '{other}' of {file} may both be the clock of "
                f"'{channel.channel}', which is as long as either; leave one out of time, or store every clock with "
                "its channels in a structure of their own"
            )
    return nearest[0]


def _clock(
    table: Table,
    named: str | None,
    rows: NDArray[np.intp],
    channels: ChannelMap,
    file: str,
    members: list[Channel],
) -> Clock:
    """Return the clock of some channels in some rows, cut to start and stop, by the map, the format or the rate."""
    if named is not None:
        seconds, factor, offset = channels.clocks.get(named, (1.0, 1.0, 0.0))
        stamps = table.columns[named] * seconds
        if named in channels.added:
            stamps = stamps + _added(table, named, channels, file)
        clock = check_clock(stamps, f"{file}: '{named}'", rows, channels.rate)
        origin = stamps[np.isfinite(stamps)][0]
        del stamps
        late = factor * (clock.time[0] - origin)
        clock = replace(clock, time=origin + factor * (clock.time - origin) + offset, step=factor * clock.step)
        clock = steadied(clock, [table.columns[c.channel] for c in members])
    elif np.isfinite(channels.rate):
        late = rows[0] / channels.rate
        clock = Clock(rows / channels.rate, rows, float(np.median(np.diff(rows, prepend=-1))) / channels.rate, ())
    else:
        raise UserError(
            f"{members[0].where}: no clock is stored with '{members[0].channel}'; map one with "
            'time = { channel = "...", unit = "s" }, or state [recording] rate = "100 Hz"'
            f"{_unread(table, channels)}"
        )
    since = clock.time - clock.time[0] + late
    stop = channels.stop if np.isfinite(channels.stop) else np.inf
    inside = (since >= channels.start) & (since <= stop)
    if inside.all() and len(inside) > 1:
        return clock
    if inside.sum() < 2:
        raise UserError(
            f"{file}: nothing lies between start = {channels.start:g} s and stop = {stop:g} s; the recording lasts "
            f"{since[-1]:.2f} s"
        )
    return Clock(clock.time[inside], clock.rows[inside], clock.step, clock.warnings)


def _added(table: Table, clock: str, channels: ChannelMap, file: str) -> Floats:
    """Return what is added to a clock, in s."""
    column, seconds = channels.added[clock]
    if column not in table.columns:
        raise UserError(
            f"time.plus: '{column}' is no column of {file} with the clock '{clock}'"
            f"{closest(column, list(table.columns))}"
        )
    return table.columns[column] * seconds


def _unread(table: Table, channels: ChannelMap) -> str:
    """Return why a clock of the map is none, where it is a column of text; else the nearest name."""
    for clock in channels.clocks:
        if clock in table.texts:
            return f". '{clock}' is text that is no time as it is read ('{table.texts[clock]}'): {TEXT_CLOCKS}"
    return closest("time", list(table.columns))


def _raw(table: Table, channel: Channel, clock: Clock, channels: ChannelMap, file: str) -> Raw:
    """Return a channel in SI units at its own instants."""
    values = clock.in_rows(table.columns[channel.channel])
    impossible = ~is_measured(values) & ~np.isnan(values)
    if impossible.any():
        values = np.where(impossible, np.nan, values)
    invalid = ~_valid(table, channel, clock, file)
    if invalid.any():
        values = np.where(invalid, np.nan, values)
    finite = np.isfinite(values)
    if not finite.any():
        beside = f" where {channel.valid}" if channel.valid else ""
        raise UserError(
            f"{channel.where}: channel '{channel.channel}' of {file} holds no number{beside}; take it out of the map"
        )
    odd = spikes(values)
    time_of_spikes = clock.time[odd]
    if channel.remove_spikes:
        finite &= ~odd
    if not finite.all():
        values = np.where(finite, values, np.nan)
    fresh, held = (np.ones(len(values), dtype=bool), 1) if channel.hold else updates(values)
    keep = finite & fresh
    time, kept = (clock.time, values) if keep.all() else (clock.time[keep], values[keep])
    largest = channels.largest_gap
    if not np.isfinite(largest):
        usual = held * clock.step
        apart = float(np.median(np.diff(time))) if len(time) > 1 else usual
        largest = _BRIDGED * usual * max(np.rint(apart / usual), 1.0)  # a channel may have a value in every tenth row
    parts = segments(time, largest)
    gaps = [(float(time[a.stop - 1]), float(time[b.start])) for a, b in pairwise(parts)]
    return Raw(
        channel=channel,
        time=time,
        values=_signed(_in_si(kept, channel), keep, table, channel, clock, file),
        largest_gap=largest,
        held=held,
        gaps=gaps,
        missing=int((~finite).sum()),
        missing_share=_missing_share(keep),
        impossible=int(impossible.sum()),
        spikes=time_of_spikes,
    )


def _signed(values: Floats, kept: Mask, table: Table, channel: Channel, clock: Clock, file: str) -> Floats:
    """Return the values of some rows, negative where a column marks that the vehicle drives backwards."""
    if channel.reverse in ("", COURSE):
        return values
    gear = clock.in_rows(_column_of(table, channel, "reverse", channel.reverse, file))
    latest = np.maximum.accumulate(np.where(np.isfinite(gear), np.arange(len(gear)), 0))
    return values * np.where(gear[latest] < 0, -1.0, 1.0)[kept]


def _column_of(table: Table, channel: Channel, key: str, column: str, file: str) -> Floats:
    """Return a column that a key of a channel names."""
    if column not in table.columns:
        raise UserError(
            f"{channel.where}.{key}: '{column}' is no column of {file} with the clock of '{channel.channel}'"
            f"{closest(column, list(table.columns))}; name one that has"
            + (f', which is negative in reverse, or write "{COURSE}"' if key == "reverse" else "")
        )
    return table.columns[column]


def validity(channel: Channel) -> tuple[str, str, float]:
    """Return column, comparison and number of a condition such as ``Msg.Quality == 3``; ``!= 0`` is a column's own.

    Raises:
        UserError: If the number is none.
    """
    column, comparison, number = next((p for c in ("==", "!=") if (p := channel.valid.rpartition(c))[0]), ("", "", ""))
    try:
        return (column.strip(), comparison, float(number)) if comparison else (channel.valid.strip(), "!=", 0.0)
    except ValueError:
        raise UserError(
            f"{channel.where}.valid: '{number.strip()}' is no number; write a column, such as \"Msg.Quality\", or "
            '"Msg.Quality == 3"'
        ) from None


def _valid(table: Table, channel: Channel, clock: Clock, file: str) -> Mask:
    """Return in which rows of a clock a channel measures by the column that says so, which has to have a number."""
    if not channel.valid:
        return np.ones(len(clock.rows), dtype=bool)
    column, comparison, number = validity(channel)
    flag = clock.in_rows(_column_of(table, channel, "valid", column, file))
    return np.asarray(np.isfinite(flag) & ((flag == number) == (comparison == "==")))


def _missing_share(there: Mask) -> float:
    """Return the share of samples that are missing, where a channel may have one in so many rows."""
    rows = np.flatnonzero(there)
    every = int(np.median(np.diff(rows))) if len(rows) > 1 else 1
    return max(1 - len(rows) / max(len(there) // every, 1), 0.0)


def _in_si(values: Floats, channel: Channel) -> Floats:
    """Apply curve, scale and offset; unwrap a heading, so that it can be joined and differentiated."""
    if channel.curve is not None:
        recorded, calibrated = channel.curve
        outside = (values < recorded[0]) | (values > recorded[-1])
        if outside.any():
            worst = values[outside][np.abs(values[outside]).argmax()]
            raise UserError(
                f"{channel.where}.curve: the channel reaches {worst:g}, the curve goes from {recorded[0]:g} to "
                f"{recorded[-1]:g}; extend the curve"
            )
        values = np.asarray(scipy.interpolate.PchipInterpolator(recorded, calibrated)(values))
    values = channel.scale * values
    values += channel.offset
    return np.unwrap(values) if channel.signal == "heading" else values


Move = Callable[[Floats, Floats], tuple[Floats, Floats]]

_BODIES = ("", "_tractor", "_trailer")
_WINDOW = 0.1
"""s, window over which heading and yaw rate are differentiated."""


def to_reference_point(signals: dict[str, Floats], channels: ChannelMap, step: float) -> None:
    """Move velocities, accelerations and positions to the reference point, in place.

    Signals measured at a point of unknown lever arm stay as they are.

    Args:
        signals: Arrays of shape ``(samples,)`` in SI units by name.
        channels: The map, with the point where each signal is measured.
        step: s between samples.

    Raises:
        UserError: If the yaw rate or the heading that moving takes is not known.
    """
    point_of = {c.signal: c.point for c in channels.channels}
    for name, point in channels.points.items():
        if not point.has_lever_arm:
            continue
        if point_of.get("heading") == name:
            signals["heading"] = signals["heading"] - point.yaw
        for body in _BODIES:
            mover = _Mover(signals, point, body, step)
            for kind, move in (("velocity", mover.velocity), ("acceleration", mover.acceleration)):
                pair = [f"{side}_{kind}{body}" for side in ("longitudinal", "lateral")]
                here = [s for s in pair if point_of.get(s) == name]
                if here:
                    _move(signals, pair, here, point, move)
        if "position_x" in signals and point_of.get("position_x") == point_of.get("position_y") == name:
            if "heading" not in signals:
                raise UserError(f"points.{name}: moving positions takes the heading; map it, or take the point out")
            east, north, heading = signals["position_x"], signals["position_y"], signals["heading"]
            moved = kinematics.move_position(east, north, heading, -point.x, -point.y)
            signals["position_x"], signals["position_y"] = moved


def _move(signals: dict[str, Floats], pair: list[str], here: list[str], point: SensorPoint, move: Move) -> None:
    """Turn and move one pair of components, of which one may be missing if the axes are parallel."""
    if len(here) < 2 and point.yaw != 0:
        raise UserError(f"points: '{here[0]}' alone cannot be turned by {point.yaw:.4g} rad; map {' and '.join(pair)}")
    zero = np.zeros(len(signals[here[0]]))
    longitudinal, lateral = (signals[s] if s in here else zero for s in pair)
    longitudinal, lateral = kinematics.to_vehicle_axes(longitudinal, lateral, point.yaw)
    for name, values in zip(pair, move(longitudinal, lateral), strict=True):
        if name in here:
            signals[name] = values


class _Mover:
    """Moves vectors of one body by ``-x, -y``; asks for the yaw rate only if there is a way to go."""

    def __init__(self, signals: dict[str, Floats], point: SensorPoint, body: str, step: float) -> None:
        self._signals, self._body, self._step = signals, body, step
        self._x, self._y = -point.x, -point.y

    def velocity(self, v_x: Floats, v_y: Floats) -> tuple[Floats, Floats]:
        if self._x == self._y == 0:
            return v_x, v_y
        return kinematics.move_velocity(v_x, v_y, self._yaw_rate(), self._x, self._y)

    def acceleration(self, a_x: Floats, a_y: Floats) -> tuple[Floats, Floats]:
        if self._x == self._y == 0:
            return a_x, a_y
        rate = self._yaw_rate()
        measured = self._signals.get(f"yaw_acceleration{self._body}")
        turning = measured if measured is not None else local_polynomial(rate, self._step, _WINDOW, 1)
        return kinematics.move_acceleration(a_x, a_y, rate, turning, self._x, self._y)

    def _yaw_rate(self) -> Floats:
        name = f"yaw_rate{self._body}"
        if name in self._signals:
            return self._signals[name]
        if not self._body and "heading" in self._signals:
            return local_polynomial(self._signals["heading"], self._step, _WINDOW, 1)
        raise UserError(f"points: moving a signal to the reference point takes '{name}'; map it, or take the point out")
