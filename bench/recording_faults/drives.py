"""Drives to plant faults in: simulated ones as a data logger would hold them, and measured ones where they are.

A simulated drive is recorded by two devices with a clock each: satellite navigation (latitude and longitude or east and
north, heading) and the vehicle bus. Noise, rates, lever arm and what is recorded at all are drawn for every drive.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

import harness as h
from harness.common.arrays import Floats
from harness.common.files import read_toml
from harness.recordings.readers import Table, read_tables

MEASURED = next(
    (p for p in (Path("../shared/measured"), Path("../../shared/measured")) if p.is_dir()), Path("../shared/measured")
)
_LATITUDE, _LONGITUDE = 52.4, 9.7
_EAST_PER_DEG, _NORTH_PER_DEG = 68_065.0, 111_275.0
"""m per degree near there; the check has the ellipsoid, the plant a plane, 0.01 % apart."""


@dataclass
class Drive:
    """What a file holds, and the map that reads it.

    Attributes:
        name: For reports.
        tables: As a reader returns them, one per clock.
        mapping: Channel map.
        noise: Standard deviations drawn, by column.
    """

    name: str
    tables: list[Table]
    mapping: dict[str, Any]
    noise: dict[str, float] = field(default_factory=dict)

    def copy(self) -> Drive:
        """Return a drive whose arrays and map may be changed."""
        import copy

        tables = [Table({k: v.copy() for k, v in t.columns.items()}, dict(t.units), t.clock) for t in self.tables]
        return Drive(self.name, tables, copy.deepcopy(self.mapping), dict(self.noise))

    def table_of(self, column: str) -> Table:
        """Return the table that holds a column."""
        return next(t for t in self.tables if column in t.columns)


CARS = ("govindarajan_2018", "blanco_2021")


def car(seed: int) -> Drive:
    """Return a drawn drive of a car on a winding road."""
    rng = np.random.default_rng([seed, 1])
    parameters = CARS[rng.integers(len(CARS))]
    model = h.model("car", parameters, tyre="magic_formula" if parameters != "govindarajan_2018" else "linear",
                    sensors="car_series", step="2 ms")  # fmt: skip
    drive = h.drive("winding_road", duration="120 s", speed=f"{rng.uniform(14, 22):.2f} m/s", seed=int(seed) + 1)
    run = h.simulate(model, drive)
    time, r, v_y = (run[n].to_numpy() for n in ("time", "yaw_rate", "lateral_velocity"))
    v_x = run["speed"].to_numpy()
    truth = {"": (v_x, v_y, r)}
    angle = run["steering_wheel_angle"].to_numpy()
    name = "steering_wheel_angle" if np.abs(angle).max() > 0.3 else "road_wheel_angle"  # a ratio of 1 in some sets
    return _logged(f"car {seed}", rng, time, truth, name, angle)


def semitrailer(seed: int) -> Drive:
    """Return a drawn drive of the semitrailer on a winding road."""
    rng = np.random.default_rng([seed, 2])
    model = h.model("semitrailer", "ziaukas_2023", tyre="magic_formula", sensors="test_vehicle", step="2 ms")
    drive = h.drive("winding_road", duration="120 s", speed=f"{rng.uniform(11, 17):.2f} m/s", seed=int(seed) + 1)
    wanted = ["speed_tractor", "lateral_velocity_tractor", "articulation_angle"]
    run = h.simulate(model, drive, signals=[w for w in wanted if w not in model.states])
    time = run["time"].to_numpy()
    truth = {
        "_tractor": tuple(run[n].to_numpy() for n in ("speed_tractor", "lateral_velocity_tractor", "yaw_rate_tractor")),
        "_trailer": tuple(run[n].to_numpy() for n in ("speed", "lateral_velocity_trailer", "yaw_rate_trailer")),
    }
    name = next(n for n in ("steering_wheel_angle", "road_wheel_angle") if n in run)
    return _logged(f"semitrailer {seed}", rng, time, truth, name, run[name].to_numpy(),
                   run["articulation_angle"].to_numpy())  # fmt: skip


def _integral(rate: Floats, time: Floats) -> Floats:
    return np.concatenate([[0.0], np.cumsum((rate[1:] + rate[:-1]) / 2 * np.diff(time))])


def _logged(
    name: str,
    rng: np.random.Generator,
    time: Floats,
    truth: dict[str, tuple[Floats, ...]],
    steering_name: str,
    steering: Floats,
    articulation: Floats | None = None,
) -> Drive:
    """Record a drive: two clocks, noise, quantisation."""
    first = next(iter(truth))
    v_x, v_y, r = truth[first]
    heading = rng.uniform(-np.pi, np.pi) + _integral(r, time)
    east = _integral(v_x * np.cos(heading) - v_y * np.sin(heading), time)
    north = _integral(v_x * np.sin(heading) + v_y * np.cos(heading), time)
    noise: dict[str, float] = {}

    def sampled(column: str, values: Floats, at: Floats, size: float, step: float = 0.0) -> Floats:
        noise[column] = size
        result = np.interp(at, time, values) + size * rng.normal(size=len(at))
        return np.round(result / step) * step if step else result

    rate = float(rng.choice([10.0, 20.0, 50.0, 100.0]))
    gnss = np.arange(0.05, time[-1] - 0.1, 1 / rate)
    rtk = float(rng.choice([0.01, 0.02]))
    columns: dict[str, Floats] = {"gnss_time": gnss}
    clocks = [{"channel": clock, "unit": "s"} for clock in ("bus_time", "gnss_time")]
    mapping: dict[str, Any] = {"title": name, "time": clocks}
    x, y = sampled("east", east, gnss, rtk), sampled("north", north, gnss, rtk)
    if rng.random() < 0.5:
        columns["lat"], columns["lon"] = _LATITUDE + y / _NORTH_PER_DEG, _LONGITUDE + x / _EAST_PER_DEG
        mapping["latitude"] = {"channel": "lat", "unit": "deg"}
        mapping["longitude"] = {"channel": "lon", "unit": "deg"}
    else:
        columns["east"], columns["north"] = x, y
        mapping["position_x"] = {"channel": "east", "unit": "m"}
        mapping["position_y"] = {"channel": "north", "unit": "m"}
    if rng.random() < 0.75:
        angle = sampled("heading", heading, gnss, np.radians(rng.choice([0.02, 0.05, 0.1])))
        columns["heading"] = np.angle(np.exp(1j * angle))
        mapping["heading"] = {"channel": "heading", "unit": "rad"}
        if rng.random() < 0.5 and first == "":
            columns["vx"] = sampled("vx", v_x, gnss, 0.02)
            columns["vy"] = sampled("vy", v_y, gnss, 0.02)
            mapping["longitudinal_velocity"] = {"channel": "vx", "unit": "m/s"}
            mapping["lateral_velocity"] = {"channel": "vy", "unit": "m/s"}
    bus = np.arange(0, time[-1], 1 / float(rng.choice([50.0, 100.0])))
    fast: dict[str, Floats] = {"bus_time": bus}

    def log(signal: str, column: str, values: Floats, size: float, unit: str, scale: float, step: float) -> None:
        fast[column] = sampled(column, values * scale, bus, size * scale, step)
        mapping[signal] = {"channel": column, "unit": unit}

    speed, fine = truth[first][0], "speed_tractor" if first else "speed"
    log(fine, "WheelSpeed", speed, 0.02, "km/h", 3.6, 1 / 256)
    for body, (u, v, w) in truth.items():
        gyro = np.radians(rng.uniform(0.05, 0.3))
        log(f"yaw_rate{body}", f"YawRate{body}", w, gyro, "deg/s", np.degrees(1), 0.01)
        a_y = np.gradient(v, time) + u * w
        log(f"lateral_acceleration{body}", f"AccY{body}", a_y, rng.uniform(0.03, 0.15), "m/s^2", 1.0, 0.01)
        if not body:
            a_x = np.gradient(u, time) - v * w
            log("longitudinal_acceleration", "AccX", a_x, rng.uniform(0.03, 0.15), "m/s^2", 1.0, 0.01)
    if articulation is not None:
        log("articulation_angle", "Hitch", articulation, np.radians(0.05), "deg", np.degrees(1), 0.02)
    log(steering_name, "Steering", steering, np.radians(0.1), "deg", np.degrees(1), 0.1)
    return Drive(name, [Table(fast, {}), Table(columns, {})], mapping, noise)


def measured() -> list[Callable[[], Drive]]:
    """Return the measured drives that are there, to be read when they are needed."""
    result: list[Callable[[], Drive]] = []
    for folder, pattern in (("genesis_g80", "*.mat"), ("revs_250lm", ""), ("dart_scaled_car", "9*.csv.gz")):
        place = MEASURED / folder
        files = (sorted(place.glob(pattern)) if pattern else [place]) if place.is_dir() else []
        result += [lambda file=file, folder=folder: _measured(file, folder) for file in files]  # type: ignore[misc]
    return result


def _measured(file: Path, folder: str) -> Drive:
    """Return a measured drive with the map of the project."""
    mapping = read_toml(Path("studies/channels") / f"{folder}.toml")
    return Drive(file.name.split(".")[0], read_tables(file), mapping)
