"""Print the speed table; ``make bench``."""

from __future__ import annotations

import time

from rich.console import Console
from rich.table import Table

from bench import engine
from bench.peers import filterpy_filter
from bench.peers.problem import problem
from bench.timing import quickest
from harness.common.arguments import Parser
from harness.engine.simd.lanes import LANES
from harness.study.provenance import processor


def main() -> None:
    """Measure and print."""
    parser = Parser(prog="python -m bench", description=__doc__)
    parser.add_argument(
        "--rounds", type=int, default=15, help="measurements of each, the quickest counts (%(default)s)"
    )
    rounds = parser.parse_args().rounds
    console = Console()
    with console.status("measuring"):
        times, ratio = engine.step_times(rounds=rounds), engine.workers(min(rounds, 3))
        given = problem("ukf", 120, 1)
        filters = {"filterpy": filterpy_filter.unscented(given)}
        peer = 1e6 * quickest(filters, 3, time.thread_time)["filterpy"] / given.steps
        particle = engine.particle_time(rounds=min(rounds, 8))
    table = Table(title=f"microseconds per step and run, one core of {processor()}, {LANES} runs at a time")
    table.add_column("what")
    table.add_column("us", justify="right")
    table.add_column("target", justify="right")
    table.add_column("over EKF", justify="right")
    for name, value in times.items():
        target = engine.TARGETS.get(name)
        table.add_row(name, f"{value:.3f}", "" if target is None else f"{target:g}", f"{value / times['ekf']:.2f}")
    table.add_row("filterpy's UKF on the same compiled model", f"{peer:.0f}", "", f"{peer / times['ekf']:.0f}")
    console.print(table)
    console.print(
        f"the particle filter takes {particle:.1f} ns per particle and step with {engine.PARTICLES} particles "
        f"(target {engine.PARTICLE_TARGET:g})"
    )
    console.print(f"our UKF is {peer / times['ukf']:.0f} times as fast as filterpy's")
    console.print(f"two workers are {ratio:.2f} times as fast as one (target {engine.WORKERS_TARGET:g})")


if __name__ == "__main__":
    main()
