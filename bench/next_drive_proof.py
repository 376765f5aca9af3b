"""Planned drives against drives by rule on the sealed plants: the share of open traces that one more drive settles.

``python -m bench.next_drive_proof --vehicle car --draws 20`` draws cases of ``tests/blind``, traces each over three
calm drives, and where several names are left plans the next drive. The vehicle then drives what was planned, and for
as long the frequency sweep and the random steering of ISO 7401 at the highest lateral acceleration that is allowed;
where no name stands behind these, twice as long. Each is traced together with the calm drives. What is in the folder
already is kept, so that an interrupted run goes on where it stopped. The seals are opened when all of it is scored;
``--page`` writes table and figure into ``docs/next-drive.md``.
"""

from __future__ import annotations

import argparse
import json
import subprocess
import sys
import traceback
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
from rich.console import Console
from threadpoolctl import threadpool_limits

from bench.attribution.gate import drawn
from bench.attribution.run import NOMINAL, PLANT, Case, listed, task_of
from bench.attribution.score import FAILED
from bench.next_drive_score import ARMS, FIRST, PLANNED, figure, page, scored_cases, standing, table
from harness.common.arguments import Parser
from harness.common.errors import ModelError, UserError
from harness.common.files import json_text, write_files
from harness.config import DriveSpec, single_drive
from harness.diagnosis.earlier_trace import models_left
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.run import augmented_model_of, run_trace
from harness.experiment.contract import total
from harness.experiment.files import contents
from harness.experiment.limits import Limits
from harness.experiment.manoeuvres import SearchRange
from harness.experiment.rehearsal import Rehearsal, Rehearsed
from harness.experiment.run import Designed, DesignTask, design_drives
from harness.identification.measured_file import finely
from harness.models.contracts import Profile
from harness.recordings import load_recording
from harness.simulation.drives import profile_of
from harness.study.provenance import commit

SHARES = {"none": 1, "parameters": 2, "effect": 12}
"""Draws of each kind that has a right name in a block: mostly effects, as the others seldom leave several names."""

LIMITS = {"car": Limits(), "semitrailer": Limits(lateral_acceleration=2.0)}
"""Of every drive behind the calm ones: those of ``harness next-drive``, and gentler ones where a trailer may roll."""

BUDGET = 60.0
"""s of planned driving."""

STEP = 0.01
"""s; of the recordings."""

_CALM = {"kind": "random_sequence", "duration": 40.0, "speed": 15.0, "speed_variation": 3.0, "rise_time": 2.0}
_CALM_ANGLE = {"car": 0.25, "semitrailer": 0.4}
"""rad of the steering wheel in the calm drives: about 1 m/s^2 of lateral acceleration."""

_EXIT = 1.0
"""s for which a vehicle goes on behind a drive before the recording ends, which may lack samples."""

_RATIO = 20.0
"""Steering ratio by which the calm drives are checked: of the car's parameter set the steering wheel is the road's."""

_BY_RULE: dict[str, dict[str, Any]] = {
    "sweep": {"kind": "sine_sweep", "first_frequency": 0.2, "last_frequency": 2.0, "fade": 1.0},
    "random": {"kind": "random_sequence", "rise_time": 0.25, "longest_hold": 0.5},
}
"""ISO 7401: steering of 0.2 to 2 Hz, at the highest speed and lateral acceleration that are allowed."""

_SOFTER, _TRIES = 0.9, 25
"""Factor on the steering from try to try, until no model of the set passes a limit."""


class Prover:
    """Runs cases; the library of a vehicle is compiled once.

    Args:
        effort: Drives that are tried of each manoeuvre.
        threads: Of a trace and a plan.
    """

    def __init__(self, effort: int, threads: int) -> None:
        self._effort, self._threads = effort, threads
        self._augmented: dict[str, AugmentedModel] = {}

    def run(self, case: Case) -> str:
        """Do what is left of a case; return how it ended. The seal is not read."""
        try:
            return self._run(case)
        except Exception as error:  # one broken case must not end the run
            is_refusal = isinstance(error, UserError | ModelError)
            write_files(case.folder, {FAILED: str(error) if is_refusal else traceback.format_exc()})
            return f"failed: {error}"

    def _run(self, case: Case) -> str:
        folder = case.folder
        if not (folder / "sealed.json").exists():
            vehicle = case.name.split("-")[0]
            _driven(case, folder, {n: _calm(vehicle, case.repeat, n) for n in ("train_a", "train_b", "test")})
        is_field = case.quality == "field"
        before = self._traced(case, FIRST, ())
        if standing(before, is_field) is not None:
            return "one name stands behind the calm drives"
        if models_left(before) < 2:
            return "no name stands behind the calm drives, but one model is left"
        plan = self._planned(case)
        for arm in ARMS:
            halved = arm.removesuffix(" twice")
            if halved != arm:
                so_far = self._traced(case, halved, plan["arms"][halved]["drives"])
                if standing(so_far, is_field) is not None:
                    continue
            self._traced(case, arm, plan["arms"][arm]["drives"])
        (folder / FAILED).unlink(missing_ok=True)
        return f"{plan['seconds']:g} s planned"

    def _traced(self, case: Case, arm: str, further: Sequence[str]) -> dict[str, Any]:
        """Return the trace of the calm drives and further ones, each second of which judges."""
        out = case.folder / arm.replace(" ", "-")
        if not (out / "trace.json").exists():
            task, vehicle = task_of(case.folder)
            map_ = case.folder / "channels.toml" if (case.folder / "channels.toml").exists() else None
            recordings = [load_recording(case.folder / "further" / f"{n}.csv", map_, name=n) for n in further]
            task = replace(
                task, train=task.train + recordings[::2], test=task.test + recordings[1::2], jobs=self._threads
            )
            if vehicle not in self._augmented:
                self._augmented[vehicle] = augmented_model_of(task)
            run_trace(task, out, Console(quiet=True), self._augmented[vehicle])
            write_files(out, {"commit.txt": commit() + "\n"})
        return dict(json.loads((out / "trace.json").read_text(encoding="utf-8")))

    def _planned(self, case: Case) -> dict[str, Any]:
        """Return seconds and drives of each arm with what is expected of them, and have the vehicle drive them."""
        file = case.folder / PLANNED
        if not file.exists():
            vehicle = case.name.split("-")[0]
            task = DesignTask(
                case.folder / FIRST, limits=LIMITS[vehicle], budget=BUDGET, effort=self._effort, seed=case.repeat,
                jobs=self._threads,
            )  # fmt: skip
            designed = design_drives(task)
            write_files(case.folder / "plan", contents(designed))
            with threadpool_limits(1):
                arms, profiles = _arms(designed, case.repeat)
            _driven(case, case.folder / "further", profiles)
            record = {"commit": commit(), "effort": self._effort, "seconds": designed.plan.seconds, "arms": arms}
            write_files(case.folder, {PLANNED: json_text(record)})
        return dict(json.loads(file.read_text(encoding="utf-8")))


def _arms(designed: Designed, seed: int) -> tuple[dict[str, Any], dict[str, Profile]]:
    """Return each arm with its drives, seconds and expectation, and all drives by name."""
    seconds = designed.plan.seconds
    planned = [t.rehearsed for t, times in designed.plan.sequence for _ in range(times)]
    drives = {"designed": planned, "designed twice": 2 * planned}
    rehearsal = Rehearsal(
        designed.goal.model, designed.plant, designed.goal.versions, designed.goal.recorded, designed.task.limits
    )
    for kind in _BY_RULE:
        four = [_by_rule(kind, designed, rehearsal, seconds / 2, seed + number) for number in range(4)]
        drives |= {kind: four[:2], f"{kind} twice": four}
    arms: dict[str, Any] = {}
    profiles: dict[str, Profile] = {}
    for arm, driven in drives.items():
        names = [f"{arm.removesuffix(' twice')}-{number}" for number in range(1, 1 + len(driven))]
        profiles |= {name: r.profile for name, r in zip(names, driven, strict=True)}
        evidence = total([(designed.goal.evidence(r), 1) for r in driven])
        expected = designed.goal.expectation(evidence).record
        arms[arm] = {
            "drives": names,
            "seconds": sum(r.seconds for r in driven),
            "expected": {
                "stands": expected["stands"],
                "probability": sum(m["share"] * m["expected"] for m in expected["models"].values()),
                "models": expected["models"],
            },
        }
    return arms, profiles


def _by_rule(kind: str, designed: Designed, rehearsal: Rehearsal, seconds: float, seed: int) -> Rehearsed:
    """Return a drive of ISO 7401, as hard as the limits allow for every model of the set.

    Raises:
        UserError: If even the gentlest passes a limit.
    """
    room = SearchRange.of(designed.plant, designed.task.limits)
    speed = designed.task.limits.highest_speed
    angle, reason = room.angle(1.0, speed), ""
    for _ in range(_TRIES):
        options = {**_BY_RULE[kind], "speed": speed, "amplitude": angle, "duration": seconds}
        tried = rehearsal.of(_drive(kind, options, seed))
        if not isinstance(tried, str):
            return tried
        angle, reason = angle * _SOFTER, tried
    raise UserError(f"{kind}: the gentlest drive passes {reason}")


def _drive(name: str, options: dict[str, Any], seed: int) -> DriveSpec:
    options = {"lead_in": 1.0, "lateral_acceleration_limit": 20.0, **options}
    options |= {"seed": seed} if options["kind"] == "random_sequence" else {}
    return single_drive({"name": name, **options}, f"drive '{name}'")


def _calm(vehicle: str, repeat: int, name: str) -> Profile:
    """Return a drive as on an ordinary road, from before there was a plan."""
    spec = finely({"vehicle": vehicle, **NOMINAL[vehicle], "values": {"steering_ratio": _RATIO}}, STEP, vehicle)
    seed = 10 * repeat + ("train_a", "train_b", "test").index(name)
    return profile_of(spec, _drive(name, {**_CALM, "amplitude": _CALM_ANGLE[vehicle]}, seed))


def _driven(case: Case, out: Path, profiles: dict[str, Profile]) -> None:
    """Have the vehicle of a case drive, and its measuring system record.

    Raises:
        UserError: If it cannot.
    """
    plans = case.folder / "drives"
    plans.mkdir(parents=True, exist_ok=True)
    files = []
    for name, p in profiles.items():
        files.append(str(plans / f"{name}.csv"))
        columns = np.column_stack([p.time, p.steering_wheel_angle, p.speed])
        columns = np.vstack([columns, columns[-1] + [_EXIT, 0.0, 0.0]])
        np.savetxt(files[-1], columns, "%.9g", ",", header="time,steering_wheel_angle,speed", comments="")
    plant = [sys.executable, str(PLANT), "--case", case.name, "--repeat", str(case.repeat), "--quality", case.quality]
    done = subprocess.run([*plant, "--out", str(out), "--drive", *files], capture_output=True, text=True, check=False)
    if done.returncode:
        raise UserError(done.stderr.strip())


def draws(vehicle: str, first: int, count: int, out: Path, quality: str) -> list[Case]:
    """Return cases at random, one vehicle's, in the shares above; a draw depends on its number alone."""
    cases = [c for c in listed() if c.kind in SHARES and c.name.startswith(f"{vehicle}-")]
    chosen = drawn(cases, first, count, SHARES)
    return [Case(name, number, out / f"{name}-{number}", quality) for name, number in chosen]


def main(arguments: Sequence[str] | None = None) -> None:
    """Run, score, print and write."""
    parser = Parser(
        prog="python -m bench.next_drive_proof",
        description=__doc__,
        formatter_class=argparse.RawDescriptionHelpFormatter,
    )
    parser.add_argument("--vehicle", choices=tuple(NOMINAL), default="car", help="of the cases (%(default)s)")
    parser.add_argument(
        "--quality", choices=("clean", "field"), default="clean", help="of the recordings (%(default)s)"
    )
    parser.add_argument("--draws", type=int, default=0, metavar="N", help="cases to draw (%(default)s: score only)")
    parser.add_argument("--first", type=int, default=0, metavar="N", help="number of the first draw (%(default)s)")
    parser.add_argument("--effort", type=int, default=12, metavar="N", help="drives tried of each manoeuvre")
    parser.add_argument("--jobs", type=int, default=1, metavar="N", help="threads (%(default)s)")
    parser.add_argument("--out", type=Path, default=Path("results/next-drive-proof"), help="folder (%(default)s)")
    parser.add_argument("--page", action="store_true", help="write table and figure into docs/next-drive.md")
    given = parser.parse_args(arguments)
    if given.draws < 0 or given.first < 0 or given.effort < 1 or given.jobs < 1:
        parser.error("--draws and --first are 0 or more, --effort and --jobs 1 or more")
    console, prover = Console(), Prover(given.effort, given.jobs)
    folder = given.out / f"{given.vehicle}-{given.quality}"
    for case in draws(given.vehicle, given.first, given.draws, folder, given.quality):
        console.print(f"{case.folder.name}: {prover.run(case)}", soft_wrap=True, highlight=False)
    scored = scored_cases(given.out)
    console.print(table(scored), markup=False, soft_wrap=True)
    if scored.opened:
        write_files(given.out, {"reliability.svg": figure(scored)})
    if given.page:
        page(scored)


if __name__ == "__main__":
    main()
