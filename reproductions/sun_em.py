"""Identify the car of Sun 2015, section 3.2, by EM with particles: table 3.2, figures 3.10 and 3.11.

``python -m reproductions.sun_em --out results/identify-em`` simulates a braking lane change with the thesis's
parameters and measurement noise, starts EM at the thesis's offset parameters with its process covariance, repeats that
with fresh noise and particles, and compares E-steps and searches. It writes report and ``identify.npz``.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import joblib
import numpy as np
from rich.console import Console

from harness.cli.options import answers_errors
from harness.common.arguments import Parser
from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.config import DriveSpec, ModelSpec, resolve_single
from harness.identification.contract import Problem, load_method, settings_of
from harness.identification.data import DriveData
from harness.identification.innovations import Innovations
from harness.identification.methods.em import Maximisation, Settings
from harness.simulation.drives import profile_of
from reproductions.simulated_recording import record
from reproductions.stored import save
from reproductions.sun_em_report import Outcome, report

FREE = ("stiffness_over_load_front", "stiffness_over_load_rear", "mass_over_inertia", "cog_to_front_axle")
START = (7.942, 7.386, 0.56, 0.91)
"""Values EM begins with (3.2)."""

SPREAD = {"lateral_velocity_rear": 0.02**2, "yaw_rate": 0.003**2, "heading": 0.003**2}
"""Process covariance EM begins with (3.2)."""

DRIVE = {
    "duration": "5 s",
    "lead_in": "0.3 s",
    "fade": "0.5 s",
    "speed": "60 km/h",
    "speed_change": "-40 km/h",
    "amplitude": "75 deg",
    "frequency": "0.6 Hz",
    "lateral_acceleration_limit": "9 m/s^2",
}
"""Lane changes while braking: at constant speed the drive hardly tells l_f from m/J, because m/J l_f l_r is near 1."""

PROFILE_POINTS = 41
PROFILE_REACH = 0.4

VARIANTS: dict[str, tuple[str, dict[str, object]]] = {
    "EM, smoother": ("em", {}),
    "EM, filter": ("em", {"e_step": "filter"}),
    "EM, one at a time": ("em", {"search": "coordinate"}),
    "likelihood": ("likelihood", {"profiles": False}),
}
"""What is compared: name in the report, method, settings."""


def car(start: bool) -> ModelSpec:
    """Return the plant, which has no process noise, or the model with which the search begins."""
    table: dict[str, object] = {"vehicle": "car_reference_point", "parameters": "sun_2015", "sensors": "car_reference"}
    if start:
        table |= {"values": dict(zip(FREE, START, strict=True)), "noise": {"process": SPREAD}}
    else:
        table |= {"noise": {"process_scale": 0.0}}
    return resolve_single(table, "car of Sun 2015")


def recording(seed: int) -> DriveData:
    """Return a simulated recording of 500 steps."""
    spec = car(start=False)
    return record(
        spec, profile_of(spec, DriveSpec("lane change", "sine", dict(DRIVE), "lane change")), "lane change", seed
    )


def search(variant: str, seed: int, iterations: int) -> Outcome:
    """Identify the recording of a seed by a variant, EM in so many iterations at most."""
    method, given = VARIANTS[variant]
    drive, spec = recording(seed), car(start=True)
    begin = time.process_time()
    if method == "em":
        settings = Settings.model_validate(given | {"iterations": iterations})
        result = Maximisation(spec, FREE, [drive], settings).run(seed)
        path = np.array([p.free for p in result.history])
        process = np.sqrt([p.process for p in result.history])
        return Outcome(result.point.free, path, process, result.converged, time.process_time() - begin)
    file = load_method(method)
    problem = Problem(Innovations(spec, jobs=1), (drive,), FREE, seed)
    fit = file.identify(problem, settings_of(file, given))
    values = np.array([fit.estimate(name).value for name in FREE])
    nothing = np.empty((0, 0))
    return Outcome(values, nothing, nothing, fit.converged, time.process_time() - begin)


def profiles(seed: int) -> tuple[Floats, Floats]:
    """Return values of each parameter and Q above its value at the start, the others at the start (figure 3.10).

    Both ``(free, points)``, at the first iteration with the process covariance EM begins with.
    """
    em = Maximisation(car(start=True), FREE, [recording(seed)], Settings(process_noise=False))
    point = em.start()
    cost = em.negative_q(em.expecter.expect(point, np.random.SeedSequence(seed)), point)
    truth = np.array([car(start=False).values[name] for name in FREE])
    values = truth[:, None] * np.linspace(1 - PROFILE_REACH, 1 + PROFILE_REACH, PROFILE_POINTS)
    first = cost(point.free)[0]
    q = [
        [first - cost(np.where(np.arange(len(FREE)) == i, v, point.free))[0] for v in row]
        for i, row in enumerate(values)
    ]
    return values, np.array(q)


def _arguments() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m reproductions.sun_em", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument("--repeats", type=int, default=50, help="recordings with fresh noise")
    parser.add_argument("--beside", type=int, default=10, help="of them for the methods beside EM with the smoother")
    parser.add_argument("--iterations", type=int, default=Settings().iterations, help="of EM, at most")
    parser.add_argument("--seed", type=int, default=0, help="of the first recording")
    parser.add_argument("--jobs", type=int, default=joblib.cpu_count(), help="processes")
    return parser


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Identify as the arguments say and write data and report."""
    chosen, console = _arguments().parse_args(arguments), Console(stderr=True)
    if min(chosen.repeats, chosen.beside, chosen.iterations, chosen.jobs) < 1 or chosen.seed < 0:
        raise UserError("repeats, beside, iterations and jobs must be at least 1, the seed at least 0")
    outcomes: dict[str, list[Outcome]] = {}
    for number, variant in enumerate(VARIANTS):
        count = min(chosen.beside, chosen.repeats) if number else chosen.repeats
        search(variant, chosen.seed, 1)  # compiles, so that the times below are those of the fit
        seeds = range(chosen.seed, chosen.seed + count)
        fits = (joblib.delayed(search)(variant, seed, chosen.iterations) for seed in seeds)
        outcomes[variant] = joblib.Parallel(chosen.jobs)(fits)
        spent = np.median([o.seconds for o in outcomes[variant]])
        console.print(f"{variant}: {count} recordings, median {spent:.1f} s of CPU time each")
    truth = np.array([car(start=False).values[name] for name in FREE])
    command = f"python -m reproductions.sun_em {shlex.join(arguments)}"
    over = profiles(chosen.seed)
    report(truth, outcomes, over, command).write(chosen.out)
    values = {v.replace(", ", "_").replace(" ", "_"): np.array([o.values for o in fs]) for v, fs in outcomes.items()}
    stored = {"truth": truth, "parameters": np.array(FREE), "profile_values": over[0], "profile_q": over[1]}
    stored["iterations"] = np.array([len(o.path) - 1 for o in outcomes["EM, smoother"]])
    save(chosen.out, "identify-em", command, {**stored, **values})
    print(f"wrote {chosen.out}/report.html")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
