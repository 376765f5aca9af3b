"""Print how far each kernel of the mass study is from the arithmetic that it does: ``python -m bench.floor``."""

from __future__ import annotations

from collections import Counter
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from bench.engine import mass_study, step_times
from bench.floor.counting import counted, counts
from bench.floor.particle import parts
from bench.floor.throughput import EXACT_NORMAL, throughput
from harness.common.arguments import Parser
from harness.engine import standard_normal
from harness.engine.simd.lanes import LANES
from harness.estimation.compiled_estimator import CompiledEstimator
from harness.simulation.simulate import CompiledSimulator
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.provenance import processor
from harness.study.run_noise import Case

UNITS = {
    "products": ("multiply", "multiply-add"),
    "sums": ("add", "round"),
    "choices": ("compare", "select"),
    "quotients": ("divide", "root"),
    "random": ("draw", "normal pair", "gather", EXACT_NORMAL),
}
"""Operations that compete for a part of the processor; at best the parts work at the same time."""

_BYTES = 8 * LANES


def operations() -> dict[str, dict[str, float]]:
    """Return the operations on all lanes per step, by kernel of the mass study and kind; warmed up, scores included."""
    evaluator = StudyEvaluator(mass_study())
    unit, cases = Unit(0, 4, 3, 0, 1), [Case(0, r) for r in range(LANES)]
    simulator, record = cast(CompiledSimulator, evaluator.compiled.simulator), evaluator.compiled.recorded
    short, long = 4, 9
    batches = {n: evaluator.simulate(unit, cases, n) for n in (short, long)}
    believed, counted_operations = evaluator.held(unit, cases, "belief"), {}
    simulator.loops[record.names], draw = counted(simulator.loop(record)), standard_normal._compiled
    standard_normal._compiled = lambda: SimpleNamespace(fill=_counted_draw)  # type: ignore[assignment]
    counted_operations["simulation with noise"] = _per_step(lambda n: evaluator.simulate(unit, cases, n), short, long)
    standard_normal._compiled = draw
    for i, estimator in enumerate(cast(list[CompiledEstimator], evaluator.compiled.estimators)):
        if estimator.kind not in counted_operations:
            estimator._kernels = SimpleNamespace(estimate=counted(estimator.loop))
            counted_operations[estimator.kind] = _per_step(
                lambda n, i=i: evaluator.estimate(i, unit, cases, batches[n], believed), short, long
            )
    return counted_operations


def busy(kinds: dict[str, float], each: dict[str, float]) -> dict[str, float]:
    """Return ns per run that each part of the processor works for these operations on all lanes."""
    return {unit: sum(kinds.get(k, 0.0) * each[k] for k in own) / LANES for unit, own in UNITS.items()}


def _counted_draw(words: Any, widths: Any, inside: Any, heights: Any, drawn: Any) -> None:
    """Stand for the kernel that draws the noise of a simulation, in a language of its own and not on lanes."""
    counts[EXACT_NORMAL] += drawn.size // LANES
    drawn[:] = 0.0


def _per_step(run, short: int, long: int) -> dict[str, float]:
    totals: list[Counter[str]] = []
    for samples in (short, long):
        counts.clear()
        with np.errstate(all="ignore"):
            run(samples)
        totals.append(Counter(counts))
    return {kind: (totals[1][kind] - totals[0][kind]) / (long - short) for kind in totals[1]}


def main() -> None:
    """Measure and print."""
    Parser(prog="python -m bench.floor", description=__doc__).parse_args()
    console = Console(width=140)
    with console.status("measuring"):
        each, times, done = throughput(), step_times(), operations()
    console.print(f"nanoseconds per operation on {LANES} lanes, one core of {processor()}:")
    console.print(", ".join(f"{kind} {value:.2f}" for kind, value in each.items()))
    table = Table(box=box.MARKDOWN)
    for name in ("kernel", "operations", *UNITS, "kB moved", "floor, us", "measured, us", "share"):
        table.add_column(name, justify="left" if name == "kernel" else "right")
    for name, kinds in done.items():
        works = {unit: 1e-3 * ns for unit, ns in busy(kinds, each).items()}
        floor, arithmetic = max(works.values()), sum(kinds.get(k, 0.0) for own in UNITS.values() for k in own)
        moved = 1e-3 * _BYTES * (kinds.get("load", 0.0) + kinds.get("store", 0.0))
        table.add_row(
            name, f"{arithmetic:,.0f}", *(f"{value:.3f}" for value in works.values()), f"{moved:.0f}",
            f"{floor:.3f}", f"{times[name]:.3f}", f"{100 * floor / times[name]:.0f} %",
        )  # fmt: skip
    console.print(table)
    took, operated = parts()
    words = (f"{part} {took[part]:.1f} (at best {max(busy(operated[part], each).values()):.1f})" for part in took)
    console.print("ns of a particle and run: " + ", ".join(words))


if __name__ == "__main__":
    main()
