"""Faults to plant: what is done to a drive, and what has to be named."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from bench.recording_faults.drives import Drive
from harness.common.units import scale
from harness.models.signals import SIGNALS

Plant = Callable[[Drive, float], None]


@dataclass(frozen=True)
class Planted:
    """One fault in one drive.

    Attributes:
        kind: Row of the table.
        signals: What is wrong; of several any one names it.
        size: Factor, s, or SI units, by the kind.
        named: Kinds of finding that name it.
        plant: Does it to a copy of the drive.
        also: Kinds of finding that come with it: a clock that drifts is late on the whole.
    """

    kind: str
    signals: tuple[str, ...]
    size: float
    named: tuple[str, ...]
    plant: Plant
    also: tuple[str, ...] = ()

    def into(self, drive: Drive) -> Drive:
        """Return the drive with the fault."""
        faults = drive.copy()
        self.plant(faults, self.size)
        return faults


def _multiplied(*signals: str) -> Plant:
    def plant(drive: Drive, factor: float) -> None:
        for column in {drive.mapping[s]["channel"] for s in signals}:
            drive.table_of(column).columns[column] *= factor

    return plant


def _added(signal: str) -> Plant:
    def plant(drive: Drive, by: float) -> None:
        entry = drive.mapping[signal]
        sign = entry.get("sign", 1) * entry.get("factor", 1.0) * scale(entry["unit"], SIGNALS[signal].unit, signal)
        drive.table_of(entry["channel"]).columns[entry["channel"]] += by / sign

    return plant


def _clock_of(drive: Drive, column: str) -> str:
    table = drive.table_of(column)
    clocks = drive.mapping["time"] if isinstance(drive.mapping["time"], list) else [drive.mapping["time"]]
    return next(str(c["channel"]) for c in clocks if c["channel"] in table.columns)


def _late(signal: str) -> Plant:
    def plant(drive: Drive, by: float) -> None:
        column = drive.mapping[signal]["channel"]
        columns = drive.table_of(column).columns
        time = columns[_clock_of(drive, column)]
        columns[column] = np.interp(time - by, time, columns[column])

    return plant


def _late_clock(drive: Drive, by: float) -> None:
    drive.tables[0].columns["bus_time"] += by


def _fast_clock(drive: Drive, by: float) -> None:
    time = drive.tables[0].columns["bus_time"]
    drive.tables[0].columns["bus_time"] = time[0] + (1 + by) * (time - time[0])


def _timed(drive: Drive, factor: float) -> None:
    clocks = drive.mapping["time"] if isinstance(drive.mapping["time"], list) else [drive.mapping["time"]]
    for clock in clocks:
        if factor < 1:
            clock["unit"] = "ms"
        else:
            drive.table_of(clock["channel"]).columns[clock["channel"]] *= factor


def _turned(sign: int, add: float) -> Plant:
    def plant(drive: Drive, _: float) -> None:
        column = drive.mapping["heading"]["channel"]
        columns = drive.table_of(column).columns
        columns[column] = np.mod(sign * (columns[column] - np.radians(add)), 2 * np.pi)

    return plant


def _in_degrees(drive: Drive, _: float) -> None:
    column = drive.mapping["heading"]["channel"]
    columns = drive.table_of(column).columns
    columns[column] = np.mod(np.degrees(columns[column]), 360.0)


def _compass_in_degrees(drive: Drive, _: float) -> None:
    _turned(-1, 90.0)(drive, 0.0)
    column = drive.mapping["heading"]["channel"]
    drive.table_of(column).columns[column] = np.degrees(drive.table_of(column).columns[column])
    drive.mapping["heading"]["unit"] = "deg"


def _exchanged(first: str, second: str, units: bool) -> Plant:
    def plant(drive: Drive, _: float) -> None:
        a, b = drive.mapping[first], drive.mapping[second]
        for key in ("channel", "unit") if units else ("channel",):
            a[key], b[key] = b[key], a[key]

    return plant


def _stuck(signal: str) -> Plant:
    def plant(drive: Drive, _: float) -> None:
        column = drive.mapping[signal]["channel"]
        drive.table_of(column).columns[column][:] = 0.0

    return plant


def planted(drive: Drive, rng: np.random.Generator) -> list[Planted]:
    """Return one fault of every kind that the signals of a drive can show, of a drawn size."""
    there = set(drive.mapping)
    rate = next(s for s in ("yaw_rate", "yaw_rate_tractor") if s in there)
    lateral = next((s for s in ("lateral_acceleration", "lateral_acceleration_tractor") if s in there), None)
    speed = next((s for s in ("speed", "speed_tractor") if s in there), None)
    steering = next((s for s in ("steering_wheel_angle", "road_wheel_angle") if s in there), None)
    placed = bool({"position_x", "latitude"} & there)
    mapped = {
        s: entry["channel"] for s, entry in drive.mapping.items() if isinstance(entry, dict) and "channel" in entry
    }
    twins = tuple(s for s, channel in mapped.items() if speed is not None and channel == mapped[speed])
    radians = float(np.radians(1.0))
    misread = 1 + float(rng.choice([-1, 1]) * rng.uniform(0.25, 0.4))
    misstated = float(rng.choice([radians, 1 / radians]))
    faults = [
        Planted("yaw rate: 57.3", (rate,), 1 / radians, ("unit",), _multiplied(rate)),
        Planted("yaw rate: 1/57.3", (rate,), radians, ("unit",), _multiplied(rate)),
        Planted("yaw rate: 1/57.3²", (rate,), radians**2, ("unit",), _multiplied(rate)),
        Planted("yaw rate: reversed", (rate,), -1.0, ("sign",), _multiplied(rate)),
        Planted("time: ms, us, s for ms", (), float(rng.choice([1e3, 1e6, 1e-3])), ("time",), _timed),
        Planted("yaw rate: never changes", (rate,), 0.0, ("still",), _stuck(rate)),
    ]
    if speed is not None and (placed or len(twins) < 2):
        factor = float(rng.choice([3.6, 1 / 3.6]))
        faults.append(Planted("speed: 3.6, 1/3.6", twins, factor, ("unit",), _multiplied(speed)))
    if lateral is not None:
        faults += [
            Planted("acceleration: 9.81, 1/9.81", (lateral,), float(rng.choice([9.80665, 1 / 9.80665])), ("unit",),
                    _multiplied(lateral)),
            Planted("acceleration: 1000, 1/1000", (lateral,), float(rng.choice([1e3, 1e-3])), ("unit",),
                    _multiplied(lateral)),
            Planted("acceleration: reversed", (lateral,), -1.0, ("sign",), _multiplied(lateral)),
            Planted("acceleration: scale 25 to 40 %", (lateral,), misread,
                    ("scale",), _multiplied(lateral)),
            Planted("exchanged: yaw rate, lateral acceleration", (rate, lateral), 1.0, ("exchanged",),
                    _exchanged(rate, lateral, False)),
        ]  # fmt: skip
    if "longitudinal_acceleration" in there and lateral is not None:
        faults.append(
            Planted("exchanged: accelerations", ("longitudinal_acceleration", lateral), 1.0, ("exchanged",),
                    _exchanged("longitudinal_acceleration", lateral, True))
        )  # fmt: skip
    if steering is not None:
        faults.append(Planted("steering: reversed", (steering,), -1.0, ("sign",), _multiplied(steering)))
        faults.append(Planted("steering: 57.3, 1/57.3", (steering,), misstated, ("unit",),
                             _multiplied(steering)))  # fmt: skip
    return faults + _of_navigation(drive, there, (rate, speed), twins, rng)


def _of_navigation(
    drive: Drive, there: set[str], names: tuple[str, str | None], twins: tuple[str, ...], rng: np.random.Generator
) -> list[Planted]:
    """Return the faults that show against heading and positions only."""
    rate, speed = names
    either = float(rng.choice([-1, 1]))
    bias = either * float(np.radians(rng.uniform(0.5, 2.0)))
    faults = []
    if "latitude" in there:
        pair = ("latitude", "longitude")
        faults.append(Planted("exchanged: position axes", pair, 1.0, ("exchanged", "sign"), _exchanged(*pair, True)))
        faults.append(Planted("positions: mirrored", pair, -1.0, ("sign", "exchanged"), _multiplied("longitude")))
    elif "position_x" in there:
        pair = ("position_x", "position_y")
        faults.append(Planted("exchanged: position axes", pair, 1.0, ("exchanged", "sign"), _exchanged(*pair, True)))
        faults.append(Planted("positions: mirrored", pair, -1.0, ("sign", "exchanged"),
                             _multiplied(str(rng.choice(pair)))))  # fmt: skip
        faults.append(
            Planted("positions: km or mm", pair, float(rng.choice([1e3, 1e-3])), ("unit",), _multiplied(*pair))
        )
    if {"latitude", "position_x"} & there and speed is not None and len(twins) < 2:
        size = 1 + either * float(rng.choice([0.003, 0.005, 0.01, 0.03]))
        faults.append(Planted("wheel radius: 0.3 to 3 %", twins, size, ("scale",), _multiplied(speed)))
        late = float(rng.choice([0.015, 0.03, 0.06, 0.12]))
        faults.append(Planted("delay of the speed: 15 to 120 ms", twins, late, ("delay",), _late(speed)))
    if "heading" in there:
        heading = ("heading",)
        faults += [
            Planted("heading: compass", heading, -1.0, ("heading",), _turned(-1, 90.0)),
            Planted("heading: compass, degrees", heading, -1.0, ("heading",), _compass_in_degrees),
            Planted("heading: from north", heading, 1.0, ("heading",), _turned(1, 90.0)),
            Planted("heading: degrees for radians", heading, 1.0, ("unit",), _in_degrees),
            Planted("yaw rate: offset 0.5 to 2 °/s", (rate,), bias, ("offset",),
                    _added(rate)),
            Planted("yaw rate: scale 5 to 20 %", (rate,), 1 + either * float(rng.uniform(0.05, 0.2)), ("scale",),
                    _multiplied(rate)),
        ]  # fmt: skip
        if drive.mapping[rate].get("delay") != "estimate":
            late = float(rng.choice([0.01, 0.02, 0.04, 0.08, 0.15]))
            faults.append(Planted("delay of the yaw rate: 10 to 150 ms", (rate,), late, ("delay",), _late(rate)))
    if len(drive.tables) > 1 and "bus_time" in drive.tables[0].columns:
        # which of two clocks is late nothing says
        bus = tuple(sorted(s for s in there if isinstance(drive.mapping[s], dict)))
        late = either * float(rng.choice([0.02, 0.05, 0.1]))
        faults.append(Planted("delay of a clock: 20 to 100 ms", bus, late, ("delay",), _late_clock, ("drift",)))
        drift = either * float(rng.choice([2e-4, 5e-4, 1e-3]))
        faults.append(Planted("drift of a clock: 200 to 1000 ppm", bus, drift, ("drift",), _fast_clock, ("delay",)))
    return faults
