"""The channel map: which channel of a file is which signal, in which unit, measured where and how late.

::

    title = "..."                                   # what was recorded
    source = "..."                                  # whose data, licence
    database = "truck.dbc"                          # of a bus log, or a list; of one of its buses "2=gnss.dbc"
    time = { channel = "t", unit = "s" }            # one clock, or a list: each serves the channels stored with it
    yaw_rate = { channel = "EBS11.YawRate", unit = "deg/s", sign = -1, delay = "20 ms" }

    [recording]                                     # step, rate, start, stop, largest_gap
    [points.imu]                                    # x, y, yaw of a sensor, from the reference point
    [derive]                                        # signals to be computed from positions and heading

Every other table is a signal (``harness list signals``). A plain number is in SI units, text carries a unit. The value
of a signal is ``sign * factor * channel + offset``, as the steering calibration of Sun 2015 (3.48).
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, StrictBool, StrictStr

from harness.common import locations
from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import read_toml
from harness.common.registry import closest
from harness.common.units import scale, to_si
from harness.config.key_types import Name, Number, Quantity, StrictTable
from harness.config.problems import Problems, validated
from harness.models.signals import SIGNALS
from harness.recordings.motion.kinematics import DERIVED
from harness.recordings.motion.mounting import rotation
from harness.recordings.motion.pose import UNSIGNED
from harness.recordings.readers import bus_and_file

ESTIMATE = "estimate"
"""Value of ``delay`` where it is to be estimated from the recording itself."""


class CurveTable(StrictTable):
    """Calibration curve: values of the channel, rising, and those of the signal that belong to them."""

    channel: list[Number] = Field(min_length=2, description="values of the channel, strictly rising")
    value: list[Number] = Field(min_length=2, description="values in the unit that the entry states")


class AddedTable(StrictTable):
    """A column that is added to a clock."""

    channel: Name = Field(description="column")
    unit: Name = Field(description="its unit")


class ClockTable(StrictTable):
    """``time``."""

    channel: Name = Field(description="column of the time")
    unit: Name = Field(description="its unit")
    factor: Number = Field(default=1.0, gt=0, description="s that pass while the clock counts one: of one that drifts")
    offset: Quantity = Field(default=0.0, description="added to its stamps")
    plus: AddedTable | None = Field(
        default=None, description='a column with the rest of the stamps, such as { channel = "nanosec", unit = "ns" }'
    )


class ChannelTable(StrictTable):
    """One signal."""

    channel: Name = Field(description="column of the file")
    unit: StrictStr | None = Field(
        default=None,
        description="unit of the channel (of the curve's values where there is a curve); that of the file if absent",
    )
    sign: Literal[1, -1] = Field(default=1, description="-1 reverses the sign of the channel")
    factor: Number = Field(default=1.0, description="calibration factor on the channel")
    offset: Quantity = Field(default=0.0, description="added last; SI or text with a unit")
    delay: Quantity = Field(default=0.0, description='how late the channel is, or "estimate"')
    point: Name | None = Field(default=None, description="where it is measured: a table [points.<name>]")
    curve: CurveTable | None = Field(default=None, description="calibration curve, applied before all else")
    lag: Quantity = Field(default=0.0, description="time constant from the recorded command to the signal")
    reverse: StrictStr = Field(
        default="",
        description="where an unsigned speed is driven backwards: a column that is negative there, such as the gear, "
        'or "course", where the course over ground is against the heading',
    )
    valid: StrictStr = Field(default="", description='another column, 0 where it is no value, or "Quality == 3"')
    convention: Literal["", "compass"] = Field(
        default="", description='"compass": a heading or course that counts clockwise from north'
    )
    hold: StrictBool = Field(default=False, description="the value is held until the next update, as that of a command")
    remove_spikes: StrictBool = Field(default=False, description="treat single-sample spikes as missing")
    includes_gravity: StrictBool = Field(
        default=False, description="the acceleration includes gravity through bank and roll"
    )


class PointTable(StrictTable):
    """``[points.<name>]``: without ``x`` and ``y`` the lever arm is unknown and nothing is moved."""

    x: Quantity | None = Field(default=None, description="ahead of the reference point")
    y: Quantity | None = Field(default=None, description="left of the reference point")
    yaw: Quantity = Field(default=0.0, description="angle of the sensor's axes from the vehicle's, to the left")
    description: StrictStr = Field(default="", description="which point it is")


class RecordingTable(StrictTable):
    """``[recording]``."""

    step: Quantity | None = Field(default=None, description="step of the common time base; the clock's if absent")
    rate: Quantity | None = Field(
        default=None, description="sampling rate, for files without a clock, or whose stamps repeat"
    )
    start: Quantity = Field(default=0.0, description="time after the first sample at which the recording begins")
    stop: Quantity | None = Field(default=None, description="time after the first sample at which it ends")
    largest_gap: Quantity | None = Field(default=None, description="longest time without samples that is bridged")
    reference: StrictStr = Field(default="CoG", description="the point that the signals refer to")


class DeriveTable(StrictTable):
    """``[derive]``."""

    signals: list[Name] = Field(min_length=1, description="signals to compute from the measured ones")
    window: Quantity = Field(default=0.1, description="length of the window of the local polynomial")


class MountingTable(StrictTable):
    """``[mounting.<name>]``: an inertial unit whose axes are not the vehicle's; its columns are turned into those."""

    acceleration: list[Name] = Field(default_factory=list, description="columns along its x, y and z axis")
    angular_velocity: list[Name] = Field(default_factory=list, description="the same of its turning")
    roll: Quantity = Field(default=0.0, description="about x, the first turn that takes its axes to the vehicle's")
    pitch: Quantity = Field(default=0.0, description="about y, the second")
    yaw: Quantity = Field(default=0.0, description="about z, the last")


class MapFile(StrictTable):
    """The tables of a channel map in addition to its signals."""

    title: StrictStr = ""
    source: StrictStr = ""
    database: Annotated[list[StrictStr], BeforeValidator(lambda d: [d] if isinstance(d, str) else d)] = Field(
        default_factory=list
    )
    time: Annotated[list[ClockTable], BeforeValidator(lambda t: [t] if isinstance(t, dict) else t)] = Field(
        default_factory=list
    )
    recording: RecordingTable = RecordingTable()
    points: dict[str, PointTable] = Field(default_factory=dict)
    mounting: dict[str, MountingTable] = Field(default_factory=dict)
    derive: DeriveTable | None = None


@dataclass(frozen=True)
class Channel:
    """How one signal follows from a channel, everything in SI units.

    Attributes:
        signal: Name in ``models/signals.py``.
        channel: Column of the file.
        scale: From the channel's unit to SI, with sign and factor; sign and factor alone where no unit is stated.
        unit: Unit that is stated; None where it is that of the file.
        offset: Added to the scaled channel.
        delay: s, how late the channel is; NaN if it is to be estimated.
        point: Name of the point where it is measured; empty for the reference point.
        curve: Two rows, channel and value, or None.
        lag: Time constant in s of a first-order lag behind the channel.
        reverse: Column that is negative where an unsigned speed is driven backwards, or ``COURSE``; else empty.
        valid: Column that says whether a value is one, alone or with ``==`` or ``!=`` and a number; else empty.
        hold: Whether a value is held until the next one.
        remove_spikes: Whether single-sample spikes are treated as missing.
        includes_gravity: Whether an accelerometer measures gravity through bank and roll.
        where: File and key, for errors.
    """

    signal: str
    channel: str
    scale: float = 1.0
    unit: str | None = ""
    offset: float = 0.0
    delay: float = 0.0
    point: str = ""
    curve: Floats | None = None
    lag: float = 0.0
    reverse: str = ""
    valid: str = ""
    hold: bool = False
    remove_spikes: bool = False
    includes_gravity: bool = False
    where: str = ""


@dataclass(frozen=True)
class SensorPoint:
    """Where a sensor sits: m ahead and left of the reference point (NaN if unknown), axes turned left by ``yaw``."""

    x: float
    y: float
    yaw: float
    description: str

    @property
    def has_lever_arm(self) -> bool:
        """Whether it is stated."""
        return bool(np.isfinite(self.x) and np.isfinite(self.y))


@dataclass(frozen=True)
class Mounting:
    """Columns of a unit and the matrix ``(3, 3)`` that turns them into the vehicle's axes.

    Attributes:
        acceleration, angular_velocity: Three columns, or none.
        turn: The matrix.
        where: File and key, for errors.
    """

    acceleration: tuple[str, ...]
    angular_velocity: tuple[str, ...]
    turn: Floats
    where: str


@dataclass(frozen=True)
class ChannelMap:
    """A channel map with units resolved; see the tables above for the meaning of the fields.

    Attributes:
        clocks: Scale to s, factor of the time that has passed, and offset in s by the column of the clock, in order of
            preference.
        added: Column that is added to a clock, with its scale to s.
        step, rate, stop, largest_gap: NaN where not stated.
        derive: Signals to compute, and the window in s.
        databases: Of the messages of a bus log, each as ``[BUS=]FILE``.
    """

    channels: tuple[Channel, ...]
    clocks: dict[str, tuple[float, float, float]] = field(default_factory=dict)
    added: dict[str, tuple[str, float]] = field(default_factory=dict)
    points: dict[str, SensorPoint] = field(default_factory=dict)
    mounting: tuple[Mounting, ...] = ()
    step: float = np.nan
    rate: float = np.nan
    start: float = 0.0
    stop: float = np.nan
    largest_gap: float = np.nan
    reference: str = "CoG"
    derive: tuple[str, ...] = ()
    window: float = 0.1
    title: str = ""
    source: str = ""
    databases: tuple[str, ...] = ()


def load_map(source: str | Path | Mapping[str, Any]) -> ChannelMap:
    """Read a channel map.

    Args:
        source: A TOML file, the name of a map of the user's project or of the package, or what a file holds.

    Raises:
        UserError: If the file cannot be read or anything in it is wrong: one line per problem with file, key and
            remedy. Blank units are refused: a number without a unit is a guess.
    """
    where, content = "channels" if isinstance(source, Mapping) else str(_file(source)), map_content(source)
    problems = Problems(where)
    raw = _validate({k: v for k, v in content.items() if k in MapFile.model_fields}, MapFile, problems, "")
    entries = {k: v for k, v in content.items() if k not in MapFile.model_fields}
    if not entries:
        problems.add("", 'maps no signal; write e.g. yaw_rate = { channel = "YawRate", unit = "deg/s" }')
    channels = []
    for name, entry in entries.items():
        if name not in SIGNALS:
            choices = [*SIGNALS, *MapFile.model_fields]
            problems.add(name, f"is no signal and no setting of a channel map{closest(name, choices)}")
        elif (table := _validate(entry, ChannelTable, problems, name)) is not None:
            with problems.catch(name):
                channels.append(_channel(name, table, problems.at(name), raw.points if raw else {}))
    problems.stop()
    assert raw is not None
    with problems.catch(""):
        resolved = _resolve(raw, channels, where)
    problems.stop()
    return resolved


def map_content(source: str | Path | Mapping[str, Any]) -> Mapping[str, Any]:
    """Return what a channel map holds, unresolved, but for the paths of databases, which are relative to its folder.

    Raises:
        UserError: If the file cannot be read.
    """
    if isinstance(source, Mapping):
        return source
    file = _file(source)
    content = read_toml(file)
    stated = content.get("database", [])
    if stated and isinstance(stated, str | list):
        named = [stated] if isinstance(stated, str) else stated
        content["database"] = [located(each, file.parent) if isinstance(each, str) else each for each in named]
    return content


def located(database: str, folder: Path) -> str:
    """Return a database, ``[BUS=]FILE``, with its file as an absolute path."""
    bus, file = bus_and_file(database, folder)
    return "=".join([bus] * bool(bus) + [str((folder / file).resolve())])


def relative(database: str, folder: Path) -> str:
    """Return a database, ``[BUS=]FILE`` from the working directory, as a map in a folder names it."""
    bus, file = bus_and_file(database, Path())
    return "=".join([bus] * bool(bus) + [Path(os.path.relpath(file, folder)).as_posix()])


def _file(source: str | Path) -> Path:
    path = Path(source)
    return path if path.suffix or path.is_file() else locations.find(locations.CHANNELS, str(path))


def _validate(content: Any, table: type[Any], problems: Problems, key: str) -> Any:
    """Return the table, or None after noting what is wrong with it."""
    if not isinstance(content, dict):
        problems.add(key, f'expected a table such as {{ channel = "...", unit = "..." }}, got {content!r}')
        return None
    return validated(content, table, problems, key)


def _channel(name: str, table: ChannelTable, where: str, points: dict[str, PointTable]) -> Channel:
    """Resolve the units of one signal."""
    unit = SIGNALS[name].unit
    if table.unit is None and table.curve is not None:
        raise UserError(f"{where}.unit: state the unit of the curve's values, e.g. '{SIGNALS[name].report_unit}'")
    if table.unit is not None and not table.unit.strip():
        example = SIGNALS[name].report_unit
        raise UserError(
            f"{where}.unit: is blank; state what the channel is in, e.g. '{example}' ('1' for a plain number)"
        )
    if table.point is not None and table.point not in points:
        raise UserError(f"{where}.point: there is no [points.{table.point}]{closest(table.point, sorted(points))}")
    curve = None
    if table.curve is not None:
        lengths = len(table.curve.channel), len(table.curve.value)
        if lengths[0] != lengths[1]:
            raise UserError(f"{where}.curve: {lengths[0]} channel values but {lengths[1]} values; make them pairs")
        curve = np.array([table.curve.channel, table.curve.value])
        if not (np.diff(curve[0]) > 0).all():
            raise UserError(f"{where}.curve.channel: must rise from value to value; sort the pairs")
    if table.reverse and name not in UNSIGNED:
        raise UserError(f"{where}.reverse: {name} has a sign of its own; it is for {', '.join(UNSIGNED)}")
    if table.factor == 0:
        raise UserError(f"{where}.factor: {table.factor!r} leaves nothing of the channel; write a number other than 0")
    if table.convention and name != "heading":
        raise UserError(f"{where}.convention: is for the heading; {name} has another sign by sign = -1")
    turned = -1.0 if table.convention else 1.0
    delay = np.nan if table.delay == ESTIMATE else to_si(table.delay, "s", f"{where}.delay")
    lag = to_si(table.lag, "s", f"{where}.lag")
    if lag < 0:
        raise UserError(f"{where}.lag: {lag:g} s is negative; a lag cannot look ahead, use delay for a time shift")
    in_si = 1.0 if table.unit is None else scale(table.unit, unit, f"{where}.unit")
    return Channel(
        signal=name,
        channel=table.channel,
        scale=turned * table.sign * table.factor * in_si,
        unit=table.unit,
        offset=to_si(table.offset, unit, f"{where}.offset") + (np.pi / 2 if table.convention else 0.0),
        delay=delay,
        point=table.point or "",
        curve=curve,
        lag=lag,
        reverse=table.reverse,
        valid=table.valid,
        hold=table.hold,
        remove_spikes=table.remove_spikes,
        includes_gravity=table.includes_gravity,
        where=where,
    )


def _mounting(table: MountingTable, where: str) -> Mounting:
    for key in ("acceleration", "angular_velocity"):
        if len(getattr(table, key)) not in (0, 3):
            raise UserError(f"{where}.{key}: name three columns, along x, y and z")
    turn = rotation(*(to_si(getattr(table, key), "rad", f"{where}.{key}") for key in ("roll", "pitch", "yaw")))
    return Mounting(tuple(table.acceleration), tuple(table.angular_velocity), turn, where)


def _resolve(raw: MapFile, channels: list[Channel], file: str) -> ChannelMap:
    """Resolve the units of the settings."""

    def number(table: str, key: str, value: object, unit: str, positive: bool = True) -> float:
        if value is None:
            return np.nan
        in_si = to_si(value, unit, f"{file}: {table}.{key}")
        if positive and in_si <= 0:
            raise UserError(f"{file}: {table}.{key}: {in_si:g} {unit} must be positive")
        return in_si

    points = {
        name: SensorPoint(
            x=number(f"points.{name}", "x", p.x, "m", False),
            y=number(f"points.{name}", "y", 0.0 if p.y is None and p.x is not None else p.y, "m", False),
            yaw=to_si(p.yaw, "rad", f"{file}: points.{name}.yaw"),
            description=p.description,
        )
        for name, p in raw.points.items()
    }
    setting = raw.recording
    wanted = tuple(raw.derive.signals) if raw.derive else ()
    for name in wanted:
        if name not in DERIVED:
            raise UserError(f"{file}: derive.signals: '{name}' cannot be derived{closest(name, sorted(DERIVED))}")
        if any(c.signal == name for c in channels):
            raise UserError(f"{file}: derive.signals: '{name}' is measured as well; keep one of the two")
    return ChannelMap(
        channels=tuple(channels),
        clocks={
            c.channel: (
                scale(c.unit, "s", f"{file}: time.unit"),
                c.factor,
                to_si(c.offset, "s", f"{file}: time.offset"),
            )
            for c in raw.time
        },
        added={
            c.channel: (c.plus.channel, scale(c.plus.unit, "s", f"{file}: time.plus.unit"))
            for c in raw.time
            if c.plus is not None
        },
        points=points,
        mounting=tuple(_mounting(table, f"{file}: mounting.{name}") for name, table in raw.mounting.items()),
        step=number("recording", "step", setting.step, "s"),
        rate=number("recording", "rate", setting.rate, "Hz"),
        start=number("recording", "start", setting.start, "s", False),
        stop=number("recording", "stop", setting.stop, "s"),
        largest_gap=number("recording", "largest_gap", setting.largest_gap, "s"),
        reference=setting.reference,
        derive=wanted,
        window=number("derive", "window", raw.derive.window, "s") if raw.derive else 0.1,
        databases=tuple(raw.database),
        title=raw.title,
        source=raw.source,
    )
