"""Blind plant: write recordings of a vehicle with something undeclared in it, and what it is to a sealed file.

    python tests/blind/plant.py --list
    python tests/blind/plant.py --case semitrailer-crosswind-medium --repeat 3 --out DIR
    python tests/blind/plant.py --case 17 --out DIR        # the seed draws the case as well
    python tests/blind/plant.py --case car-none --quality field --out DIR   # as an ordinary logger records it
    python tests/blind/plant.py --case car-none --quality bus --out DIR     # each channel a message of its own
    python tests/blind/plant.py --case car-none --drive sweep.csv --out DIR # what is stated, in place of its own driver

Writes ``train_a.csv``, ``train_b.csv`` and ``test.csv`` (held out), ``belief.json`` with what is published about the
vehicle, and ``sealed.json`` with the truth, which only the scoring opens. With ``--drive`` the recordings have the
names of the files in place of those three: of the same vehicle and measuring system, with noise of their own.
"""

from __future__ import annotations

import argparse
import difflib
import json
import sys
import zlib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.csv
from plant_bus import BusLogger, draw_bus
from plant_cases import VEHICLES, Case, Truth, cases, choose, draw, seeds
from plant_drives import Drive, stated
from plant_effects import CATALOGUE
from plant_field import Logger, beyond, draw_logger
from plant_oracle import SIMILAR, library_times, library_values
from plant_sensors import NOISE, UNITS
from plant_simulation import Driven, drive

SCHEMA = 1
DRIVES = ("train_a", "train_b", "test")
VERDICT = {
    "none": "adequate",
    "parameters": "adequate",
    "effect": "amended",
    "pair": "amended",
    "unlisted": "unresolved",
}


def published(vehicle: str) -> dict[str, float]:
    """Return the parameters that the belief starts from; those of effects are not among them."""
    kind = VEHICLES[vehicle]
    known = kind._fields[: next(i for i, name in enumerate(kind._fields) if name.startswith("gust_force"))]
    return {name: kind._field_defaults[name] for name in known}


def seal(
    case: Case, repeat: int, truth: Truth, driven: dict[str, Driven], logger: Logger | None = None
) -> dict[str, Any]:
    """Return the content of ``sealed.json`` (README.md describes it)."""
    values, effects = published(case.vehicle), []
    for e in truth.effects:
        known = CATALOGUE[case.vehicle][e.name]
        units = dict(zip(e.values, known.units, strict=True))
        effects.append(
            {
                "name": e.name,
                "in_library": known.in_library,
                "equivalent": list(known.equivalent),
                "magnitude": e.magnitude,
                "place": e.place,
                "change": known.change,
                "parameters": {key: {"value": v, "unit": units[key]} for key, v in e.values.items()},
                "oracle": {
                    "form": "similar" if e.name in SIMILAR else "same",
                    "parameters": library_values(e, truth.equations()) if known.in_library else {},
                    "per_drive": {name: library_times(e, d.changes) for name, d in driven.items()},
                },
            }
        )
    true = truth.equations()._asdict()
    return {
        "schema": SCHEMA,
        "case": case.name,
        "repeat": repeat,
        "vehicle": case.vehicle,
        "kind": case.kind,
        "expected_verdict": VERDICT[case.kind],
        "effects": effects,
        "parameters": {k: {"published": v, "true": true[k]} for k, v in values.items() if true[k] != v},
        "drives": {
            name: {"changes": d.changes._asdict(), "manoeuvres": list(d.drive.manoeuvres)} for name, d in driven.items()
        },
        "noise": NOISE[case.vehicle] if logger is None else logger.noise,
        "quality": quality_of(logger),
        "recording": [] if logger is None else logger.faults(),
    }


def quality_of(logger: Logger | None) -> str:
    """Return the quality of what a measuring system records."""
    if logger is None:
        return "clean"
    return "bus" if isinstance(logger, BusLogger) else "field"


def channel_map(vehicle: str) -> str:
    """Return the channel map of a recording that is not clean: single spikes are missing samples."""
    lines = [f'{n} = {{ channel = "{n}", unit = "{UNITS[n]}", remove_spikes = true }}\n' for n in NOISE[vehicle]]
    return f'time = {{ channel = "time", unit = "s" }}\n{"".join(lines)}\n[recording]\nstep = "10 ms"\n'


def read_drive(file: Path) -> Drive:
    """Return the drive of a table with ``time`` from 0 in s, ``steering_wheel_angle`` in rad and ``speed`` in m/s.

    Raises:
        ValueError: If it is none.
        OSError: If it cannot be read.
    """
    try:
        table = pa.csv.read_csv(file)
        columns = [np.asarray(table[n], dtype=float) for n in ("time", "steering_wheel_angle", "speed")]
    except (pa.ArrowInvalid, KeyError, ValueError) as problem:
        raise ValueError(f"{file}: no table with time, steering_wheel_angle and speed: {problem}") from None
    time, _, speed = columns
    if not np.isfinite(columns).all() or len(time) < 2 or time[0] != 0.0 or (np.diff(time) <= 0).any():
        raise ValueError(f"{file}: time has to rise from 0, and every value has to be a number")
    if not speed.min() > 0.0:
        raise ValueError(f"{file}: a speed of {speed.min():g} m/s; this vehicle drives forward")
    return stated(*columns)


def write(
    case: Case, repeat: int, out: Path, quality: str = "clean", plans: Mapping[str, Drive] | None = None
) -> tuple[str, ...]:
    """Drive a case, write its files and return the names of its drives; these are the same in every quality.

    Args:
        case: The case.
        repeat: Which draw of it.
        out: Folder to write to.
        quality: Of the recording.
        plans: What is driven, by name; the plant's own three drives by default.

    Raises:
        FloatingPointError: If the vehicle spins.
        OSError: If the folder cannot be written.
    """
    first, *rest, of_logger = seeds(case, repeat)
    truth, logger = draw(case, np.random.default_rng(first)), None
    if quality != "clean":
        draw_system = draw_bus if quality == "bus" else draw_logger
        truth, logger = beyond(truth), draw_system(case.vehicle, np.random.default_rng(of_logger))
    if plans is None:
        driven = {name: drive(truth, seed, logger) for name, seed in zip(DRIVES, rest, strict=True)}
    else:
        driven = {name: drive(truth, seed_of_plan(case, repeat, name), logger, p) for name, p in plans.items()}
    out.mkdir(parents=True, exist_ok=True)
    for name, d in driven.items():
        columns = {name: pa.array(values, from_pandas=True) for name, values in d.recording.items()}  # NaN is blank
        pa.csv.write_csv(pa.table(columns), out / f"{name}.csv", pa.csv.WriteOptions(quoting_style="none"))
    belief = {"vehicle": case.vehicle, "parameters": published(case.vehicle), "noise": NOISE[case.vehicle]}
    if logger is not None:
        (out / "channels.toml").write_text(channel_map(case.vehicle))
    for name, content in (("belief", belief), ("sealed", seal(case, repeat, truth, driven, logger))):
        (out / f"{name}.json").write_text(json.dumps(content, indent=1) + "\n")
    return tuple(driven)


def seed_of_plan(case: Case, repeat: int, name: str) -> np.random.SeedSequence:
    """Return the seed of a stated drive: its road, change times and noise are those of its name."""
    return np.random.SeedSequence([zlib.crc32(case.name.encode()), repeat, zlib.crc32(name.encode())])


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument(
        "--list", action="store_true", help="print every case: name, kind, first draw that may choose it"
    )
    parser.add_argument("--case", help="a name from the list, or a whole number that draws one")
    parser.add_argument("--repeat", type=int, default=0, help="other drives, noise and signs of a named case")
    parser.add_argument("--quality", choices=("clean", "field", "bus"), default="clean", help="of the recording")
    parser.add_argument(
        "--drive",
        type=Path,
        nargs="+",
        metavar="CSV",
        help="tables of time in s, steering_wheel_angle in rad and speed in m/s to drive, in place of its own drives",
    )
    parser.add_argument("--out", type=Path, help="folder to write to")
    given = parser.parse_args(arguments)
    known = cases()
    if given.list:
        print("\n".join(f"{case.name}\t{case.kind}\t{case.first_draw}" for case in known.values()))
        return 0
    if not given.case or not given.out:
        parser.error("give --case and --out, or --list")
    if given.repeat < 0:
        parser.error(f"--repeat {given.repeat}: give 0 or more")
    if given.case.isdecimal():
        case, repeat = choose(int(given.case)), int(given.case)
    elif given.case in known:
        case, repeat = known[given.case], given.repeat
    else:
        close = difflib.get_close_matches(given.case, known, 3)
        parser.error(f"--case {given.case}: no such case; closest: {', '.join(close) or 'see --list'}")
    try:
        plans = {file.stem: read_drive(file) for file in given.drive} if given.drive else None
        names = write(case, repeat, given.out, given.quality, plans)
    except (FloatingPointError, OSError, ValueError) as problem:
        print(
            f"error: --case {given.case}: {problem}; nothing to score, take another --repeat or --out", file=sys.stderr
        )
        return 1
    print(f"wrote {', '.join(f'{name}.csv' for name in names)}, belief.json, sealed.json to {given.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
