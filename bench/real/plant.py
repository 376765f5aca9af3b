"""Realistic plants: write the recordings of a case, what is published, and to a sealed file what is true.

    python -m bench.real.plant --list
    python -m bench.real.plant --case car-baseline-mass-medium --repeat 3 --out DIR

Of the design ``baseline`` there are ``monday.csv``, ``tuesday.csv``, ``today.csv`` and ``today2.csv``, of ``alone``
``today.csv``, ``today_too.csv`` and ``today2.csv``, which is held out. ``belief.json`` and ``nominal.toml`` have what
is published about the vehicle, ``channels.toml`` is the map, ``sealed.json`` the truth, which only the scoring opens.
"""

from __future__ import annotations

import argparse
import difflib
import json
import sys
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from bench.real.cases import CASES, DESIGNS, Case, Truth, draw, drive_case, noise, seeds
from bench.real.sensors import CHANNELS, UNITS
from bench.real.vehicle import Floats

LIBRARY = {"car": "car", "multi_body": "car", "semitrailer": "semitrailer"}
"""The library's vehicle of each plant."""

THERE = (
    "accelerometer_roll",
    "aerodynamic_side_force",
    "axle_compliance_steer",
    "body_roll",
    "brake_pull",
    "combined_slip",
    "lateral_load_transfer",
    "longitudinal_load_transfer",
    "road_bank",
    "road_bank_varying",
    "roll_steer",
    "sensor_bias",
    "sensor_delay",
    "sensor_drift",
    "sensor_gain",
    "sensor_lever_arm",
    "speed_delay",
    "steering_backlash",
    "steering_compliance",
    "steering_compliance_lag",
    "steering_delay",
    "steering_lag",
    "steering_offset",
    "steering_ratio",
    "tyre_curvature",
    "tyre_force_offset",
    "tyre_relaxation",
    "tyre_saturation",
    "wheel_radius_error",
)
"""Effects of the library that every plant has anyway, if only a little; to name one of them is no invention."""

THERE_TOO = {"semitrailer": ("kingpin_friction",)}
"""Those of one vehicle."""

PROCESS_NOISE = {
    "car": {"lateral_velocity": 4e-6, "yaw_rate": 1.2e-7},
    "semitrailer": {
        **{f"lateral_velocity_{b}": 1e-7 for b in ("tractor", "trailer")},
        **{f"yaw_rate_{b}": 1e-8 for b in ("tractor", "trailer")},
        "articulation_angle": 1e-10,
        **{f"lateral_force_axle_{a}": 1000.0 for a in ("11", "12", "21", "22", "23")},
        "steering_wheel_angle": 1e-5,
    },
}
"""First variances per step of 10 ms, SI squared; a trace fits them."""


def csv_text(columns: Mapping[str, Floats]) -> str:
    """Return the file of a drive; a missing sample is an empty field."""
    rows = (",".join("" if x != x else f"{x:.7g}" for x in row) for row in zip(*columns.values(), strict=True))
    return "\n".join([",".join(columns), *rows]) + "\n"


def channel_map(vehicle: str) -> str:
    """Return the channel map of the recordings, which says nothing of what is wrong with them."""
    lines = [f'{n} = {{ channel = "{n}", unit = "{UNITS[n]}", remove_spikes = true }}\n' for n in CHANNELS[vehicle]]
    return f'time = {{ channel = "time", unit = "s" }}\n{"".join(lines)}\n[recording]\nstep = "10 ms"\n'


def nominal_text(case: Case, truth: Truth) -> str:
    """Return the parameter file of the published vehicle."""
    vehicle, deviations = LIBRARY[case.vehicle], noise(case, truth)
    tables = {
        "values": truth.sheet,
        "process_noise": PROCESS_NOISE[vehicle],
        "measurement_noise": {name: s**2 for name, s in deviations.items()},
    }
    lines = [f'vehicle = "{vehicle}"', 'tyre = "magic_formula"', f'sensors = "{", ".join(deviations)}"']
    lines += ['source = "data sheet of a simulated vehicle"', "noise_step = 0.01"]
    for name, table in tables.items():
        lines += ["", f"[{name}]", *(f"{key} = {float(value)!r}" for key, value in table.items())]
    return "\n".join(lines) + "\n"


def seal(case: Case, repeat: int, truth: Truth, stories: Mapping[str, Any]) -> dict[str, Any]:
    """Return the content of ``sealed.json``."""
    change = truth.change
    return {
        "schema": 1,
        "case": case.name,
        "repeat": repeat,
        "vehicle": case.vehicle,
        "design": case.design,
        "kind": case.kind,
        "magnitude": case.magnitude,
        "change": None if change is None else asdict(change),
        "there": [*THERE, *THERE_TOO.get(case.vehicle, ())],
        "values": dict(truth.values),
        "column": dict(truth.column),
        "recording": asdict(truth.logger),
        "drives": dict(stories),
    }


def write(case: Case, repeat: int, out: Path) -> None:
    """Drive a case and write its files, the seal last.

    Raises:
        FloatingPointError: If the vehicle spins.
        OSError: If the folder cannot be written.
    """
    first, *rest = seeds(case, repeat)
    truth = draw(case, np.random.default_rng(first))
    out.mkdir(parents=True, exist_ok=True)
    stories = {}
    for name, seed in zip(DESIGNS[case.design], rest, strict=True):
        columns, stories[name] = drive_case(case, truth, name, seed)
        (out / f"{name}.csv").write_text(csv_text(columns), encoding="utf-8")
    belief = {"vehicle": LIBRARY[case.vehicle], "parameters": dict(truth.sheet), "noise": noise(case, truth)}
    texts = {"channels.toml": channel_map(case.vehicle), "nominal.toml": nominal_text(case, truth)}
    texts |= {"belief.json": _json(belief), "sealed.json": _json(seal(case, repeat, truth, stories))}
    for name, text in texts.items():
        (out / name).write_text(text, encoding="utf-8")


def _json(content: object) -> str:
    return json.dumps(content, indent=1) + "\n"


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--list", action="store_true", help="print name, kind and first draw of every case")
    parser.add_argument("--case", help="a name from the list")
    parser.add_argument("--repeat", type=int, default=0, help="another draw of it (%(default)s)")
    parser.add_argument("--out", type=Path, help="folder to write to")
    given = parser.parse_args(arguments)
    if given.list:
        print("\n".join(f"{case.name}\t{case.kind}\t0" for case in CASES.values()))
        return 0
    if not given.case or not given.out:
        parser.error("give --case and --out, or --list")
    if given.case not in CASES:
        close = difflib.get_close_matches(given.case, CASES, 3)
        parser.error(f"--case {given.case}: no such case; closest: {', '.join(close) or 'see --list'}")
    if given.repeat < 0:
        parser.error(f"--repeat {given.repeat}: give 0 or more")
    try:
        write(CASES[given.case], given.repeat, given.out)
    except (FloatingPointError, OSError) as problem:
        print(f"error: --case {given.case}: {problem}; take another --repeat or --out", file=sys.stderr)
        return 1
    print(f"wrote {', '.join(f'{name}.csv' for name in DESIGNS[CASES[given.case].design])} to {given.out}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
