"""Every case by name, what it draws, and its drives.

A name is ``<vehicle>-<design>-none`` or ``<vehicle>-<design>-<kind>-<magnitude>``. Of the design ``baseline`` there are
the drives of two days before the change, of ``alone`` none. Random numbers come from name and repeat alone.

In every case the vehicle differs from its data sheet in all values by what tolerances allow, and its axles stand a
little askew, its tyres pull and its brakes too.
"""

from __future__ import annotations

import zlib
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

import numpy as np

from bench.real import multi_body, specimens
from bench.real.changes import MAGNITUDES, Change, draw_change, kinds_of
from bench.real.driver import column, draw_drive
from bench.real.sensors import CHANNELS, Fault, Logger, draw_logger, extent, record, signals
from bench.real.vehicle import STEP, Floats, integrate

VEHICLES = ("car", "semitrailer", "multi_body")
DESIGNS = {"baseline": ("monday", "tuesday", "today", "today2"), "alone": ("today", "today_too", "today2")}
"""Drives of each design; the last is held out."""

BEFORE = ("monday", "tuesday")
"""Drives before the change."""

_SPREAD = (
    ("mass", 0.02),
    ("inertia", 0.04),
    ("cog_to", 0.008),
    ("cog_from", 0.01),
    ("steering_ratio", 0.008),
    ("steering_compliance", 0.15),
    ("stiffness", 0.035),
    ("grip", 0.04),
    ("toe", 0.2),
    ("roll_steer", 0.2),
    ("roll_", 0.06),
    ("cog_height", 0.03),
    ("kingpin", 0.3),
)
"""Log-normal deviation of a value from that of the data sheet, by a part of its name; the first that fits counts."""

_FIXED = ("kingpin_from_rear", "tractor_cog_to_kingpin")


@dataclass(frozen=True)
class Case:
    """What is to be drawn."""

    name: str
    vehicle: str
    design: str
    change: str = ""
    magnitude: str = ""

    @property
    def kind(self) -> str:
        """Of the table in which it counts."""
        return f"{self.design}-{'changed' if self.change else 'none'}"


def _all() -> list[Case]:
    cases = []
    for vehicle in VEHICLES:
        for design in DESIGNS:
            cases.append(Case(f"{vehicle}-{design}-none", vehicle, design))
            cases += [
                Case(f"{vehicle}-{design}-{kind}-{m}", vehicle, design, kind, m)
                for kind in kinds_of(vehicle)
                for m in MAGNITUDES
            ]
    return cases


CASES = {case.name: case for case in _all()}
"""By name."""


@dataclass(frozen=True)
class Truth:
    """What is true of a case.

    Attributes:
        sheet: What is published, by the library's names.
        values: Of the vehicle before the change.
        column: Lag (s), delay (s) and play (rad at the road wheels) of the column before.
        logger: The measuring system.
        change: What has changed, if anything.
    """

    sheet: Mapping[str, float]
    values: Mapping[str, float]
    column: Mapping[str, float]
    logger: Logger
    change: Change | None


def draw(case: Case, rng: np.random.Generator) -> Truth:
    """Return the truth of a case."""
    vehicle = case.vehicle
    if vehicle == "multi_body":
        sheet, built = multi_body.SHEET, multi_body.BUILT
        values = {k: x * float(np.exp(_spread(k) * rng.standard_normal())) for k, x in built.items()}
        values |= {"pull": 0.015 * float(rng.standard_normal())}
    else:
        built = specimens.BUILT[vehicle]
        sheet = specimens.data_sheet(vehicle, built)
        values = {k: x * float(np.exp(_spread(k) * rng.standard_normal())) for k, x in built.items()}
        for axle in specimens.AXLES[vehicle]:
            values[f"conicity_{axle}"] = 6e-4 * float(rng.standard_normal())
            values[f"askew_{axle}"] = 6e-4 * float(rng.standard_normal())
            values[f"pull_{axle}"] = 0.015 * float(rng.standard_normal())
    of_column = {"lag": float(rng.uniform(0.004, 0.012)), "delay": 0.0, "play": float(rng.uniform(0.0, 2e-4))}
    logger = draw_logger(vehicle, rng)
    change = draw_change(vehicle, case.change, case.magnitude, values, sheet, rng) if case.change else None
    return Truth(sheet, values, of_column, logger, change)


def _spread(name: str) -> float:
    return next((s for part, s in _SPREAD if part in name), 0.0) if name not in _FIXED else 0.0


def seeds(case: Case, repeat: int) -> list[np.random.SeedSequence]:
    """Return a seed for the truth, and one for each drive."""
    return np.random.SeedSequence([zlib.crc32(case.name.encode()), repeat]).spawn(1 + len(DESIGNS[case.design]))


def drive_case(
    case: Case, truth: Truth, name: str, seed: np.random.SeedSequence
) -> tuple[dict[str, Floats], dict[str, Any]]:
    """Return the recording of a drive and what happened in it.

    Raises:
        FloatingPointError: If the vehicle spins.
    """
    rng = np.random.default_rng(seed)
    change = truth.change if truth.change and name not in BEFORE else None
    values = {**truth.values, **(change.values if change else {})}
    grown = {k: x + (change.column.get(k, 0.0) if change else 0.0) for k, x in truth.column.items()}
    axles = len(specimens.AXLES.get(case.vehicle, ("front", "rear")))
    drive = draw_drive(case.vehicle, 2 * axles, rng)
    road_wheel = column(drive.wheel, values["steering_ratio"], **grown)
    if case.vehicle == "multi_body":
        truths = multi_body.drive_car(drive, road_wheel, values, truth.logger)
        yaw = np.abs(truths["yaw_rate"] * truths["speed"]).max()
        story: dict[str, Any] = {"lateral_acceleration": round(float(yaw), 2)}
    else:
        inputs = np.column_stack([road_wheel, drive.speed, drive.speed_rate, drive.bank, drive.rough])
        states, of_axles, felt = integrate(inputs, specimens.assemble(case.vehicle, values), STEP)
        truths = signals(case.vehicle, drive, states, of_axles, felt, truth.logger)
        story = extent(states, felt)
    if not all(np.isfinite(x).all() for x in truths.values()) or story["lateral_acceleration"] > SPUN:
        raise FloatingPointError(f"{case.name}: the vehicle spins in the drive {name}")
    columns = record(truths, truth.logger, change.fault if change else Fault(), rng)
    return columns, {**story, "manoeuvres": [list(m) for m in drive.manoeuvres]}


SPUN = 9.0
"""m/s^2; who is faster has left the road."""


def noise(case: Case, truth: Truth) -> dict[str, float]:
    """Return the standard deviation of the noise of every output, as it is published."""
    return {c: truth.logger.noise[c] for c in CHANNELS[case.vehicle][2:]}
