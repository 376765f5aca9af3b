"""Print the peers' table; ``make bench PEERS=1``."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from dataclasses import dataclass

from bench.peers import reference
from bench.peers.ours import filtering, means, simulating
from bench.peers.problem import Problem, driven, problem
from harness.common.arrays import Floats
from harness.study.provenance import processor

CORE = min(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else None
if CORE is not None:
    os.sched_setaffinity(0, {CORE})  # before JAX counts the cores for its threads

from rich.console import Console  # noqa: E402
from rich.table import Table  # noqa: E402

from bench.engine import PARTICLES, keep_pages  # noqa: E402
from bench.peers import filterpy_filter, free_simulation, jax_filters, linear_ukf, particle_library, stone_soup  # noqa: E402
from bench.timing import quickest  # noqa: E402

SAMPLES = {1: 2000, 64: 2000, 1024: 1000}
"""Samples by the number of runs in a batch: drives of 10 to 20 s, in which what a call costs does not count."""

SHORT = 200
"""Samples for what takes a millisecond per step."""

ROUNDS = 5
OURS = "this project"


@dataclass
class Line:
    """A line of the table.

    Attributes:
        what: Is computed.
        by: Which library.
        batch: Runs at once.
        time: In us per step and run.
        ratio: To ours of the same kind and batch.
        error: Largest deviation from the same filter in extended precision, ``None`` where there is none.
    """

    what: str
    by: str
    batch: int
    time: float
    ratio: float
    error: float | None = None


def _lines(
    what: str, given: Problem, work: dict[str, Callable[[], object]], errors: dict[str, float] | None = None
) -> Iterator[Line]:
    per_run = {name: 1e6 * t / given.steps / given.batch for name, t in quickest(work, ROUNDS).items()}
    for name, time in per_run.items():
        yield Line(what, name, given.batch, time, time / per_run[OURS], (errors or {}).get(name))


def filters(kind: str, batch: int) -> Iterator[Line]:
    """Measure an EKF or UKF in every library that takes batches, and one run at a time in those that do not."""
    given = problem(kind, SAMPLES[batch], batch)
    exact = reference.extended(kind, given)
    work, first_means = {OURS: filtering(given)}, {OURS: means(given)}
    for name, make in {"dynamax": jax_filters.dynamax, "cuthbert": jax_filters.cuthbert}.items():
        if (kind, name) != ("ukf", "cuthbert"):  # it has no sigma points for nonlinear dynamics
            work[name], first = jax_filters.filtering(make(kind, given), given)
            first_means[name] = first()
    yield from _lines(kind.upper(), given, work, {name: reference.error(m, exact) for name, m in first_means.items()})


def single() -> Iterator[Line]:
    """Measure the UKF of the libraries that take one run at a time."""
    given = problem("ukf", SHORT, 1)
    exact = reference.extended("ukf", given)
    runs: dict[str, Callable[[], Floats]] = {
        "filterpy": filterpy_filter.unscented(given),
        "Stone Soup": stone_soup.unscented(given),
    }
    errors = {name: reference.error(run(), exact) for name, run in runs.items()}
    yield from _lines(
        "UKF", given, {OURS: filtering(given), **runs}, errors | {OURS: reference.error(means(given), exact)}
    )


def simulations() -> Iterator[Line]:
    """Measure free simulation; ours adds noise, the others do not."""
    given = problem("ekf", SAMPLES[64], 64)
    work = {OURS: simulating(given), "diffrax, Euler": free_simulation.diffrax_euler(driven(given))}
    yield from _lines("simulation", given, work)
    given = problem("ekf", SHORT, 1)
    work = {
        OURS: simulating(given),
        "scipy, LSODA": free_simulation.scipy_lsoda(driven(given)),
        "commonroad, multi-body car": free_simulation.multi_body(given.steps),
    }
    yield from _lines("simulation", given, work)


def particle_filters() -> Iterator[Line]:
    """Measure a particle filter of many particles; times are per particle."""
    given = problem("particle", SHORT, 8, {"particles": PARTICLES, "roughening": 0.0})
    single = problem("particle", SHORT, 1, {"particles": PARTICLES, "roughening": 0.0})
    best = quickest({OURS: filtering(given), "particles": particle_library.bootstrap(single, PARTICLES)}, ROUNDS)
    ours, theirs = (1e6 * best[n] / p.steps / p.batch / PARTICLES for n, p in ((OURS, given), ("particles", single)))
    yield Line("one particle of 1000", OURS, given.batch, ours, 1.0)
    yield Line("one particle of 1000", "particles", single.batch, theirs, theirs / ours)


def small() -> Iterator[Line]:
    """Measure our UKF on four linear states beside a published time, which is not of this machine."""
    ours = 1e6 * quickest({OURS: linear_ukf.filtering(20000)}, ROUNDS)[OURS] / 20000 / linear_ukf.RUNS
    yield Line("UKF, 4 linear states", OURS, linear_ukf.RUNS, ours, 1.0)
    yield Line(
        "UKF, 4 linear states", "LowLevelParticleFilters.jl, as published", 1,
        linear_ukf.PUBLISHED, linear_ukf.PUBLISHED / ours,
    )  # fmt: skip


def main() -> None:
    """Measure and print, line by line as they come."""
    keep_pages()
    console = Console()
    table = Table(title=f"the same problem through other libraries, one core of {processor()}")
    for heading in ("what", "by", "runs at once", "us per step and run", "times ours", "error"):
        table.add_column(heading, justify="left" if heading in ("what", "by") else "right")
    parts = [
        (f"{kind.upper()}, batches of {n}", lambda k=kind, n=n: filters(k, n))
        for kind in ("ekf", "ukf")
        for n in SAMPLES
    ]
    parts += [
        ("one run at a time", single),
        ("simulation", simulations),
        ("particles", particle_filters),
        ("linear", small),
    ]
    for name, measure in parts:
        with console.status(f"measuring: {name}"):
            for line in measure():
                error = "" if line.error is None else f"{line.error:.1e}"
                table.add_row(line.what, line.by, str(line.batch), f"{line.time:.3g}", f"{line.ratio:.3g}", error)
        if not console.is_terminal:
            print(f"measured: {name}", flush=True)
    console.print(table)
    console.print("error: largest deviation of any state of the first run from the same filter in extended precision,")
    console.print("as a share of that state's largest magnitude; ours computes 8 runs where one is asked for")


if __name__ == "__main__":
    main()
