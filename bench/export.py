"""Estimators as C against their kernels, and in single precision: docs/export.md.

    python -m bench.export                            # 10^6 steps of each; --study and --estimator choose some
    python -m bench.export --sanitize                 # the same steps under the sanitizers of the compiler
    python -m bench.export --single --duration "1 h"  # a drive in single precision beside double
    python -m bench.export --round-trip mass          # scores of a study by the C, beside those of its own

Studies of the semitrailer, as it is believed to be: with unknown steering and one sensor, with an unknown load and the
sensors of stability control, and with that load considered; and of a car whose accelerometer measures the forces of
tyres, which are not linear in its states. Steps are those of ``harness/realtime/export/steps.py``:
eight behind each point of a Sobol sequence around a recorded run. Differences are the largest of mean and covariance,
NIS and likelihood, in standard deviations or relative; beside them what one rounding of the first state changes. Code
and stack are those of the compiler with -Os for this processor; the stack is the sum over all functions, more than any
chain of calls takes.
"""

from __future__ import annotations

import subprocess
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from rich.table import Table

from harness.cli.options import study_path
from harness.common.arguments import Parser
from harness.common.errors import UserError
from harness.common.files import parse_toml, write_files
from harness.common.units import to_si
from harness.config import StudySpec, build_study, load_study
from harness.engine.simd.lanes import LANES
from harness.realtime.export import steps
from harness.realtime.export.run import Exported, export
from harness.study.design import units
from harness.study.evaluate import StudyEvaluator

AT_ONCE = 2048
LIMIT = 1e-12
SANITIZED = ("-O1", "-fsanitize=address,undefined", "-fno-sanitize-recover=all")
DRIVE = {"name": "sine", "kind": "sine", "speed": "20 m/s", "amplitude": "35 deg", "frequency": "0.2 Hz",
         "lateral_acceleration_limit": "6 m/s^2"}  # fmt: skip
PLANT = {"vehicle": "semitrailer", "parameters": "ziaukas_2023", "tyre": "magic_formula"}
BANK = {"trailer_mass": ["16 t", "24 t", "32 t"]}
OF_STEERING = ("kf", "ekf", "sr_ekf", "ukf", "sr_ukf", "cdkf", "huber_ekf", "student_t_ekf", "adaptive_ekf",
               "innovation_ekf", "h_infinity", "narx")  # fmt: skip
OF_FORCES = tuple(kind for kind in OF_STEERING if kind not in ("kf", "narx"))
CAR = {"vehicle": "car", "parameters": "pacejka_2006", "tyre": "magic_formula_61", "sensors": "car_series"}
STUDIES: dict[str, dict[str, Any]] = {
    "steering": {
        "plant": {**PLANT, "sensors": "series"},
        "belief": {"unknown_inputs": ["steering_wheel_angle"]},
        "estimator": [{"kind": k} for k in OF_STEERING] + [{"kind": "st_cdkf", "softening": 10}],
    },
    "load": {
        "plant": {**PLANT, "sensors": "stability_control"},
        "belief": {"unknown_parameters": [{"name": "trailer_mass", "prior": "8 t"}]},
        "estimator": [{"kind": "ekf"}, {"kind": "sr_ukf"}, {"kind": "imm", "hypotheses": BANK}],
    },
    "considered": {
        "plant": {**PLANT, "sensors": "stability_control"},
        "belief": {"considered_parameters": [{"name": "trailer_mass", "prior": "8 t"}]},
        "estimator": [{"kind": "ekf"}],
    },
    "forces": {
        "plant": CAR,
        "targets": ["lateral_velocity", "sideslip_angle"],
        "estimator": [{"kind": k} for k in OF_FORCES] + [{"kind": "st_cdkf", "softening": 10}],
    },
}


@dataclass(frozen=True)
class Equality:
    """How far C and kernel are apart.

    Attributes:
        first, all: Largest difference behind the first step of a point, and behind any of eight.
        rounded: That of the kernel from itself, the first state being one rounding larger, behind any of eight.
        above: Share of the steps with more than ``LIMIT``.
        time: Of a step in C, in s.
    """

    first: float
    all: float
    rounded: float
    above: float
    time: float


def study(name: str, duration: str) -> StudySpec:
    """Return one of the studies."""
    content = {
        "name": name,
        "seed": 20230109,
        "targets": ["lateral_force_axle_21", "articulation_angle"],
        "drive": [{**DRIVE, "duration": duration}],
        "design": [{"name": "as-believed"}],
        **STUDIES[name],
    }
    return build_study(content, f"{name}.toml")


def equality(run: Exported, folder: Path, count: int, flags: Sequence[str]) -> Equality:
    """Take so many steps in C and Python.

    Raises:
        CalledProcessError: If the C does not compile without a warning, or a sanitizer ends it.
    """
    program, region = steps.built(run.export, folder, "gcc", flags), steps.around(run)
    worst, above, taken, points = np.zeros(3), 0, 0.0, -(-count // (steps.SAMPLES * LANES)) * LANES
    for first in range(0, points, AT_ONCE):
        given = steps.points(region, first, min(AT_ONCE, points - first))
        python, measured = steps.in_python(run.estimator, given)
        c, time = steps.in_c(program, given, measured, python.memory.shape[2])
        off = np.max(list(steps.differences(c, python, region.mean_spread).values()), axis=0)
        moved = replace(given, mean=np.nextafter(given.mean, np.inf))
        rounded, _ = steps.in_python(run.estimator, moved, measured)
        least = max(each.max() for each in steps.differences(rounded, python, region.mean_spread).values())
        worst = np.maximum(worst, [off[:, 0].max(), off.max(), least])
        above, taken = above + int((off > LIMIT).sum()), taken + time
    total = points * steps.SAMPLES
    return Equality(*worst, above / total, taken / total)


def sizes(run: Exported, folder: Path) -> tuple[int, int]:
    """Return bytes of code with its tables, and of the stack of all functions together."""
    name = run.export.name
    write_files(folder, run.files)
    subprocess.run(["gcc", "-std=c99", "-Os", "-fstack-usage", "-c", f"{name}.c"], cwd=folder, check=True)
    size = subprocess.run(["size", f"{name}.o"], cwd=folder, check=True, capture_output=True, text=True).stdout
    lines = (folder / f"{name}.su").read_text().splitlines()
    assert all(line.split("\t")[2] in ("static", "dynamic,bounded") for line in lines), "a stack without a bound"
    return sum(map(int, size.splitlines()[1].split()[:2])), sum(int(line.split("\t")[1]) for line in lines)


def single(run: Exported, folder: Path) -> tuple[float, float, bool]:
    """Return how far estimates in single precision are from double, and when they first are a tenth.

    Returns:
        Largest distance in standard deviations, or of an estimator without any in its largest magnitude; time in s of
        the first above 0.1, NaN if there is none; and whether the state left its range.
    """
    write_files(folder, run.files)
    subprocess.run(["make", "-s", run.export.name], cwd=folder, check=True)
    with (folder / "told.csv").open("w") as told:
        subprocess.run([f"./{run.export.name}", "replay.csv"], cwd=folder, check=True, stdout=told)
    table = np.genfromtxt(folder / "told.csv", delimiter=",", skip_header=1)[:, 1:]  # behind the time
    estimate = run.history.estimate
    deviation = run.history.deviation if run.estimator.has_covariance else np.abs(estimate).max(axis=0)
    scale = np.where(deviation > 0, deviation, np.inf)
    off = np.abs(table[:, : estimate.shape[1]] - estimate) / scale
    off = np.where(np.isnan(off), np.inf, off).max(axis=1)
    late = np.flatnonzero(off > 0.1)
    return float(off.max()), late[0] * run.export.step if len(late) else np.nan, bool(table[:, -1].any())


def round_trip(name: str, repeats: int, folder: Path) -> dict[str, dict[str, float]]:
    """Return the largest relative difference of scores by estimator and score, of the first design of a study."""
    chosen = load_study(study_path(name))
    design = replace(chosen.designs[0], repeats=repeats)
    kinds = {e.name: e for e in chosen.estimators if e.kind not in ("particle", "rbpf", "enkf", "external")}
    tables = []
    for estimator in kinds:
        run = export(chosen, estimator, recorded=(None, 1.0))
        write_files(folder / run.export.name, run.files)
        subprocess.run(["make", "-s", f"lib{run.export.name}.so"], cwd=folder / run.export.name, check=True)
        (table,) = parse_toml(run.files["estimator.toml"], estimator)["estimator"]
        tables.append({**table, "library": str(folder / run.export.name / table["library"])})
    content = parse_toml(chosen.text, str(chosen.path)) | {"estimator": tables, "tuning": None, "report": None}
    in_c = build_study({k: v for k, v in content.items() if v is not None}, chosen.path)
    both = replace(
        chosen, estimators=(*kinds.values(), *in_c.estimators), designs=(design,), history=(), over_time=None
    )
    evaluator = StudyEvaluator(both)
    for index in range(evaluator.kernels):
        evaluator.warm_up(index)
    results = [evaluator.evaluate(unit) for unit in units(both, design)]
    assert not evaluator.lost()
    off: dict[str, dict[str, float]] = {estimator: {} for estimator in kinds}
    for score in ("rmse", "max_error", "nis", "status"):
        parts = [np.asarray(r[score], dtype=float).reshape(-1, 2 * len(kinds), r[score][0, 0, 0].size) for r in results]
        ours, c = np.split(np.concatenate(parts), 2, axis=1)
        apart = np.nanmax(np.abs(c - ours) / np.where(ours == 0, 1.0, np.abs(ours)), axis=(0, 2), initial=0.0)
        apart = np.where((np.isnan(c) == np.isnan(ours)).all(axis=(0, 2)), apart, np.inf)
        for estimator, largest in zip(kinds, apart, strict=True):
            off[estimator][score] = float(largest)
    return off


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table that is asked for."""
    parser = Parser(prog="python -m bench.export", description=__doc__.splitlines()[0])
    parser.add_argument("--study", choices=[*STUDIES], help="all if absent")
    parser.add_argument("--estimator", help="kind; all if absent")
    parser.add_argument("--steps", type=int, default=1_000_000)
    parser.add_argument("--sanitize", action="store_true")
    parser.add_argument("--single", action="store_true")
    parser.add_argument("--duration", default="10 min", help="of the drive in single precision")
    parser.add_argument("--round-trip", metavar="STUDY")
    parser.add_argument("--repeats", type=int, default=4, help="of the first design of that study")
    given = parser.parse_args(arguments)
    if given.round_trip:
        with tempfile.TemporaryDirectory() as place:
            for estimator, scores in round_trip(given.round_trip, given.repeats, Path(place)).items():
                print(f"{estimator:12s}", *(f"{score} {off:.1e}" for score, off in scores.items()), sep="  ")
        return
    heads = ["study", "estimator", *(_SINGLE if given.single else _EQUAL)]
    table, console = Table(*heads, box=None), Console(width=160)
    for name in [given.study] if given.study else STUDIES:
        chosen = study(name, f"{to_si(given.duration, 's', '--duration')} s" if given.single else "30 s")
        for spec in chosen.estimators:
            if given.estimator in (None, spec.kind):
                table.add_row(name, spec.name, *_row(chosen, spec.name, given))
    if not table.row_count:
        raise UserError(f"--estimator {given.estimator}: there is none of that kind in these studies")
    console.print(table)


_EQUAL = (
    "lines",
    "memory/B",
    "code/B",
    "stack/B",
    "one step",
    "eight steps",
    "one rounding",
    "above 1e-12",
    "ns per step",
)
_SINGLE = ("memory/B", "largest distance/deviation", "first above 0.1 at/s", "left its range")


def _row(chosen: StudySpec, estimator: str, given: Any) -> list[str]:
    """Return the cells of one estimator."""
    with tempfile.TemporaryDirectory() as place:
        folder = Path(place)
        if given.single:
            run = export(chosen, estimator, "float", recorded=(None, float("inf")))
            most, at, left_range = single(run, folder)
            return [f"{run.export.memory:,}", f"{most:.2g}", f"{at:.1f}", "yes" if left_range else "no"]
        run = export(chosen, estimator)
        code, stack = sizes(run, folder)
        off = equality(run, folder, given.steps, SANITIZED if given.sanitize else ("-O2",))
        lines = run.files[f"{run.export.name}.c"].count("\n")
        cells = [f"{lines:,}", f"{run.export.memory:,}", f"{code:,}", f"{stack:,}"]
        apart = (off.first, off.all, off.rounded, off.above)
        return [*cells, *(f"{each:.1e}" for each in apart), f"{off.time * 1e9:.0f}"]


if __name__ == "__main__":
    main()
