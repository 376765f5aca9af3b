"""Processor time that the kernels of a study take to compile, one after the other in one process.

``python -m bench.compilation`` compiles those of the mass study into an empty cache. ``--plain`` compiles them as numba
does by itself (``harness.engine.simd.inner``).
"""

from __future__ import annotations

import os
import tempfile
import time
from pathlib import Path

from numba.core import event, ir
from rich.console import Console

from harness.common.arguments import Parser
from harness.config import load_study
from harness.engine.simd.inner import RARE_COLLECTION
from harness.study.evaluate import StudyEvaluator


def as_numba_does() -> None:
    """Take back what is left out of compilations."""
    del ir.Scope.__deepcopy__
    event.unregister("numba:compile", RARE_COLLECTION)


def compilation(study: Path) -> list[tuple[str, float]]:
    """Return what was made ready and the processor time of it in s: the equations, then kernel by kernel."""
    begun = time.process_time()
    evaluator = StudyEvaluator(load_study(study))
    times = [("equations", time.process_time() - begun)]
    for index in range(evaluator.kernels):
        begun = time.process_time()
        name = evaluator.warm_up(index)
        times.append((name, time.process_time() - begun))
    return times


def main() -> None:
    """Compile and print."""
    parser = Parser(description=__doc__)
    parser.add_argument("study", type=Path, nargs="?", default=Path("studies/mass.toml"))
    parser.add_argument("--plain", action="store_true", help="as numba does by itself")
    chosen = parser.parse_args()
    if chosen.plain:
        as_numba_does()
    with tempfile.TemporaryDirectory() as folder:
        os.environ["HARNESS_CACHE"] = folder
        times = compilation(chosen.study)
    console = Console()
    for name, seconds in [*times, ("together", sum(s for _, s in times))]:
        console.print(f"{seconds:7.2f} s  {name}")


if __name__ == "__main__":
    main()
