"""Identification by likelihood: time of its passes and of a fit, and coverage of its intervals.

``python -m bench.identify`` prints the speed table, ``python -m bench.identify --coverage 100`` how often the 95 %
intervals of so many simulated recordings hold the truth.
"""

from __future__ import annotations

import dataclasses
import time

import numpy as np
import xarray as xr
from rich.console import Console
from rich.table import Table

from bench.timing import quickest
from harness.common.arguments import Parser
from harness.config import ModelSpec, resolve_single
from harness.engine.simd.lanes import LANES
from harness.identification.candidates import Candidates
from harness.identification.contract import Fit, Problem
from harness.identification.data import DriveData
from harness.identification.innovations import Innovations
from harness.identification.methods.likelihood import Search, Settings, identify
from harness.models.contracts import DriveContext
from harness.models.roles import VEHICLES
from harness.simulation.drives import build_drive
from harness.simulation.simulate import simulate_drive

TRUCK = {"vehicle": "semitrailer", "parameters": "ziaukas_2023", "tyre": "magic_formula", "sensors": "test_vehicle"}
CAR = {
    "vehicle": "car_reference_point",
    "parameters": "sun_2015",
    "sensors": "car_reference",
    "noise": {"process_scale": 0.01},
}
FREE = (
    "trailer_mass", "stiffness_peak_11", "stiffness_peak_12", "stiffness_peak_2", "relaxation_length_2",
    "tractor_mass", "friction", "steering_ratio",
)  # fmt: skip
FREE_CAR = ("stiffness_over_load_front", "stiffness_over_load_rear", "mass_over_inertia")
TARGETS = {"likelihood, per candidate": 12.0, "frozen gains, per direction": 4.0}
"""ms for 120 s at 100 Hz."""


def recorded(spec: ModelSpec, seed: int, **options: float) -> xr.Dataset:
    """Return a simulated drive of random steering with its noise."""
    vehicle = VEHICLES.load(spec.vehicle)
    context = DriveContext(vehicle.wheelbase(spec.values), spec.values["steering_ratio"], spec.step)
    chosen = {**options, "seed": seed + 1, "lateral_acceleration_limit": 6.0}
    return simulate_drive(spec, build_drive("random_sequence", chosen, context, "bench"), [], seed)


def problem(table: dict[str, object], free: tuple[str, ...], seed: int, jobs: int | None, **options: float) -> Problem:
    """Return a model whose free parameters are wrong by up to a fifth, and a drive of the right one."""
    spec = resolve_single(table, "bench")
    wrong = np.exp(np.random.default_rng(seed).uniform(-0.2, 0.2, len(free)))
    values = {**spec.values, **{n: spec.values[n] * float(w) for n, w in zip(free, wrong, strict=True)}}
    innovations = Innovations(dataclasses.replace(spec, values=values), jobs=jobs)
    drive: DriveData = innovations.drive(recorded(spec, seed, **options), "drive")
    return Problem(innovations, (drive,), free)


def passes(rounds: int = 10) -> dict[str, float]:
    """Return ms of each pass over 120 s of the semitrailer at 100 Hz on one core."""
    posed = problem(TRUCK, FREE, 1, 1, duration=120.0, speed=18.0, speed_variation=4.0, amplitude=0.55)
    innovations, (drive,) = posed.innovations, posed.drives
    held, along = Candidates.of(posed.spec), innovations.along(FREE)
    still = held.take([0] * len(FREE))
    directions = Candidates(along, 0.0 * still.process, 0.0 * still.measurement)
    kept = innovations.run(drive, held)
    times = quickest(
        {
            "likelihood, per candidate": lambda: innovations.log_likelihoods([drive], held.take([0] * LANES)),
            "likelihood with exact gradient, per direction": lambda: innovations.slopes([drive], held, directions),
            "frozen gains, per direction": lambda: innovations.sensitivities(drive, held.values, along, kept),
        },
        rounds,
    )
    return {name: 1e3 * t / LANES for name, t in times.items()}


def fit_time(jobs: int | None = None) -> tuple[float, float, Fit]:
    """Return seconds by the clock and of all cores of a fit of 8 parameters and all noises, and the fit."""
    posed = problem(TRUCK, FREE, 1, jobs, duration=120.0, speed=18.0, speed_variation=4.0, amplitude=0.55)
    search = Search(posed, Settings())
    start = search.coordinates.centre
    search.objective.slopes(start, np.ones(len(start), dtype=bool))  # compile
    search.objective.values(start[:, None])
    clock, cores = time.perf_counter(), time.process_time()
    fit = identify(posed, Settings(profiles=False))
    return time.perf_counter() - clock, time.process_time() - cores, fit


def coverage(sets: int, profiles: bool = False) -> dict[str, float]:
    """Return the share of simulated recordings of a car whose 95 % interval holds the truth, by parameter.

    By the recordings alone, without priors: the first values are wrong by up to a fifth.
    """
    truth = resolve_single(CAR, "bench").values
    inside = []
    for seed in range(sets):
        posed = problem(CAR, FREE_CAR, seed, 1, duration=20.0, speed=15.0, speed_variation=2.0, amplitude=0.55)
        fit = identify(posed, Settings(profiles=profiles, stated_priors=False))
        inside.append([fit.estimate(n).lower <= truth[n] <= fit.estimate(n).upper for n in FREE_CAR])
    return dict(zip(FREE_CAR, np.mean(inside, axis=0).tolist(), strict=True))


def main() -> None:
    """Measure and print."""
    parser = Parser(description=__doc__)
    parser.add_argument("--coverage", type=int, metavar="SETS", help="simulated recordings in place of times")
    chosen = parser.parse_args()
    console = Console()
    if chosen.coverage:
        for name, share in coverage(chosen.coverage).items():
            console.print(f"{name}: {100 * share:.0f} % of {chosen.coverage} intervals hold the truth")
        return
    table = Table(title="semitrailer, 10 states, 4 outputs, 120 s at 100 Hz, one core")
    for column in ("pass", "ms", "target"):
        table.add_column(column, justify="left" if column == "pass" else "right")
    for name, ms in passes().items():
        table.add_row(name, f"{ms:.1f}", f"{TARGETS[name]:g}" if name in TARGETS else "")
    console.print(table)
    clock, cores, fit = fit_time()
    console.print(
        f"fit of {len(FREE)} parameters and {len(fit.estimates) - len(FREE)} noises: {clock:.1f} s, {cores:.1f} s of "
        f"all cores, {len(fit.history)} passes with derivatives (target 10 s)"
    )


if __name__ == "__main__":
    main()
