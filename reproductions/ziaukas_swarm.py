"""Identify the semitrailer by particle swarm as Ziaukas 2023, 4.2.2 and 4.3: Bild 4.6 to 4.9, table 4.6.

``python -m reproductions.ziaukas_swarm --out results/identify-swarm`` simulates the drives of
``studies/drives/identification.toml`` with hidden parameters, searches them with the thesis's swarm several times and
with differential evolution of the same budget beside it, and writes report and ``identify.npz``. Each finished search
is kept under ``runs``; an interrupted command goes on from there.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any

import joblib
import numpy as np
from rich.console import Console
from scipy.optimize import differential_evolution

from harness.cli.options import answers_errors
from harness.common.arguments import Parser
from harness.common.arrays import Floats
from harness.common.errors import UserError
from harness.common.files import BUNDLED_STUDIES
from harness.config import DriveSpec, ModelSpec, resolve_single
from harness.engine.compile import compile_model
from harness.identification.data import DriveData
from harness.identification.methods.swarm import Settings, SwarmResult, optimise
from harness.identification.simulation_error import Free, Misfit
from harness.models.contracts import Profile
from harness.simulation.drives import profile_of, read_drives
from reproductions.kept import Parts, state_of
from reproductions.simulated_recording import Setup, record
from reproductions.stored import LONG, save
from reproductions.ziaukas_swarm_report import report

DRIVES = BUNDLED_STUDIES / "drives" / "identification.toml"
LOADS = {
    "empty": {"trailer_mass": "7.5 t", "trailer_cog_from_rear": "7.2 m"},
    "laden": {"trailer_mass": "24 t", "trailer_cog_from_rear": "7.8 m"},
}
"""Mass and centre of gravity of the hidden trailer; the mass is known to the search."""

BOUNDS = {
    "friction": (0.1, 1.2),
    **{f"shape_factor_{axle}": (0.5, 4.0) for axle in ("11", "12", "2")},
    **{f"stiffness_peak_{axle}": (0.1, 1e9) for axle in ("11", "12", "2")},
    "stiffness_load_11": (0.1, 1e9),
    "stiffness_load_12": (0.1, 1e9),
    "stiffness_load_2": (0.1, 1e6),
    **{f"relaxation_length_{axle}": (0.01, 2.0) for axle in ("11", "12", "2")},
    "steering_ratio": (15.0, 30.0),
}
"""Search ranges of table 4.4; the centre of gravity comes on top, once per load."""

COG = ("trailer_cog_from_rear", 4.0, 12.0)


def plant(load: str) -> ModelSpec:
    """Return the semitrailer at a load."""
    parts = {"vehicle": "semitrailer", "parameters": "ziaukas_2023", "tyre": "magic_formula", "sensors": "test_vehicle"}
    return resolve_single({**parts, "values": LOADS[load]}, f"semitrailer, {load}")


def setup(path: Path, seed: int, jobs: int) -> Setup:
    """Simulate the drives and return the problem.

    Raises:
        UserError: If the file cannot be read or a drive's name lacks part or load.
    """
    drives: dict[str, list[DriveData]] = {"fit": [], "judge": []}
    loads: dict[str, str] = {}
    profiles: dict[str, Profile] = {}
    for number, (name, (kind, options)) in enumerate(read_drives(path).items()):
        part, _, rest = name.partition("-")
        load = rest.partition("-")[0]
        if part not in drives or load not in LOADS:
            raise UserError(f"{path}, drive '{name}': the name must begin with fit- or judge-, then empty- or laden-")
        spec = plant(load)
        profiles[name] = profile_of(spec, DriveSpec(name, kind, options, f"{path}, drive '{name}'", path.parent))
        drives[part].append(record(spec, profiles[name], name, seed + number))
        loads[name] = load
    for part, some in drives.items():
        for load in LOADS:
            if load not in (loads[d.name] for d in some):
                raise UserError(f"{path}: no drive begins with '{part}-{load}-'; the study needs one")
    specs = {load: plant(load) for load in LOADS}
    per_drive = {name: {"trailer_mass": specs[load].values["trailer_mass"]} for name, load in loads.items()}
    free = [Free(name, *ends) for name, ends in BOUNDS.items()]
    free += [Free(*COG, tuple(n for n in loads if loads[n] == load)) for load in LOADS]
    hidden = [specs["laden"].values[name] for name in BOUNDS] + [specs[load].values[COG[0]] for load in LOADS]
    spec = specs["laden"]
    compiled = compile_model(spec.model(), spec.step, spec.integrator, spec.substeps)
    costs = {}
    for part, some in drives.items():
        names = [d.name for d in some]
        own = [Free(f.parameter, f.lower, f.upper, tuple(n for n in f.drives if n in names)) for f in free]
        costs[part] = Misfit(compiled, spec.values, own, some, per_drive, jobs)
    plants = {name: specs[load] for name, load in loads.items()}
    return Setup(costs["fit"], costs["judge"], np.array(hidden), plants, profiles)


def swarm_over_logarithms(cost: Misfit, seed: int, settings: Settings) -> SwarmResult:
    """Minimise by the swarm with the stiffnesses' coefficients, whose ranges span decades, on a logarithmic scale."""
    wide = np.array([f.parameter.startswith("stiffness_") for f in cost.free])

    def to_si(z: Floats) -> Floats:
        return np.where(wide, 10.0 ** np.where(wide, z, 0.0), z)

    lower, upper = (np.where(wide, np.log10(end), end) for end in (cost.lower, cost.upper))
    result = optimise(lambda z: cost(to_si(z)), lower, upper, seed, settings)
    return replace(result, values=to_si(result.values))


def evolve(cost: Misfit, seed: int, settings: Settings) -> SwarmResult:
    """Minimise by SciPy's differential evolution with as many candidates as the swarm tries."""
    history: list[float] = []
    diverged = 0

    def judged(candidates: Floats) -> Floats:
        nonlocal diverged
        costs = cost(candidates.T)
        diverged += int(np.sum(~np.isfinite(costs)))
        history.append(min(float(costs.min()), history[-1] if history else np.inf))
        return np.where(np.isfinite(costs), costs, 1e6)  # the convergence test of SciPy takes means

    rng = np.random.default_rng(np.random.SeedSequence(seed))
    first = cost.lower + (cost.upper - cost.lower) * rng.random((settings.particles, len(cost.lower)))
    best = differential_evolution(
        judged,
        list(zip(cost.lower, cost.upper, strict=True)),
        init=first,
        maxiter=settings.iterations,
        tol=0.0,
        polish=False,
        vectorized=True,
        updating="deferred",
        rng=rng,
    )
    values = np.asarray(best.x) if np.isfinite(history[-1]) else np.full(len(cost.lower), np.nan)
    return SwarmResult(values, np.array(history), settings.particles * len(history), diverged)


def searched(
    searches: Mapping[str, Sequence[Callable[[int], SwarmResult]]], seed: int, parts: Parts, code: str, console: Console
) -> dict[str, list[SwarmResult]]:
    """Run every search, or read what was kept of it.

    Args:
        searches: By name, each from its seed.
        seed: Of the first run of each.
        parts: Where finished runs are kept.
        code: Digest of what decides them beside the seed.
        console: Told of every run.

    Raises:
        UserError: If every candidate of a run diverged.
    """
    results: dict[str, list[SwarmResult]] = {}
    for name, runs in searches.items():
        results[name] = []
        for number, search in enumerate(runs):
            begin, own = time.perf_counter(), seed + number
            stem, state = f"{_stem(name)}_{number + 1:02d}", state_of(code, own)
            kept, there = parts.made(stem, state, partial(_as_arrays, search, own))
            run = SwarmResult(kept["values"], kept["history"], int(kept["evaluated"]), int(kept["diverged"]))
            results[name].append(run)
            spent = "kept from before" if there else f"{time.perf_counter() - begin:.0f} s"
            console.print(
                f"{name} {number + 1} of {len(runs)}: cost {run.cost:.4f}, "
                f"{run.diverged} of {run.evaluated} candidates diverged, {spent}",
                soft_wrap=True,
            )
            if not np.isfinite(run.cost):
                raise UserError(f"{name}: every candidate of run {number + 1} diverged; take more particles")
    return results


def _as_arrays(search: Callable[[int], SwarmResult], seed: int) -> dict[str, Any]:
    return asdict(search(seed))


def _arguments() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m reproductions.ziaukas_swarm", description=__doc__)
    parser.add_argument("--out", type=Path, required=True, help="folder to write to")
    parser.add_argument("--drives", type=Path, default=DRIVES, help="file of drives")
    parser.add_argument("--repeats", type=int, default=10, help="runs of the swarm")
    parser.add_argument("--beside", type=int, default=3, help="runs of each other search")
    parser.add_argument("--particles", type=int, default=240, help="candidates per iteration")
    parser.add_argument("--iterations", type=int, default=200, help="iterations of a run")
    parser.add_argument("--seed", type=int, default=1, help="of noise and searches")
    parser.add_argument("--jobs", type=int, default=joblib.cpu_count(), help="threads")
    return parser


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Search as the arguments say and write data and report."""
    chosen, console = _arguments().parse_args(arguments), Console(stderr=True)
    if min(chosen.repeats, chosen.beside, chosen.iterations, chosen.jobs) < 1 or chosen.particles < 5:
        raise UserError("repeats, beside, iterations and jobs must be at least 1, particles at least 5")
    settings = Settings(particles=chosen.particles, iterations=chosen.iterations)
    problem = setup(chosen.drives, chosen.seed, chosen.jobs)
    searches = {
        "swarm": [lambda s: optimise(problem.fit, problem.fit.lower, problem.fit.upper, s, settings)] * chosen.repeats,
        "swarm, logarithmic": [lambda s: swarm_over_logarithms(problem.fit, s, settings)] * chosen.beside,
        "differential evolution": [lambda s: evolve(problem.fit, s, settings)] * chosen.beside,
    }
    code = state_of(LONG["identify-swarm"].code(), chosen.drives.read_bytes(), settings.model_dump())
    results = searched(searches, chosen.seed, Parts(chosen.out / "runs"), code, console)
    command = f"python -m reproductions.ziaukas_swarm {shlex.join(arguments)}"
    report(problem, results, settings, command).write(chosen.out)
    arrays = {}
    for name, some in results.items():
        arrays[f"{_stem(name)}_values"] = np.array([f.values for f in some])
        arrays[f"{_stem(name)}_cost"] = np.array([f.history for f in some])
    arrays["hidden"], arrays["parameters"] = problem.hidden, np.array([f.parameter for f in problem.fit.free])
    overall = min((f for some in results.values() for f in some), key=lambda f: f.cost)
    judged = [problem.judged(drive.name, overall.values) for drive in problem.judge.drives]  # table 4.6
    arrays["judged"] = np.array([list(errors.values()) for errors in judged])
    arrays["judged_drives"] = np.array([drive.name for drive in problem.judge.drives])
    arrays["judged_outputs"] = np.array(list(judged[0]))
    arrays["hidden_cost"] = problem.fit(problem.hidden[None])
    save(chosen.out, "identify-swarm", command, arrays)
    print(f"wrote {chosen.out}/report.html")


def _stem(name: str) -> str:
    return name.replace(", ", "_").replace(" ", "_")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
