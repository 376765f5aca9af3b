"""Measure how time and memory grow, and draw it: ``python -m bench.growth``.

Each point is a process of its own, so that its peak of memory is that of its work. What was measured is kept in
``growth.json`` in the folder of ``--out`` and not measured again.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
from rich import box
from rich.console import Console
from rich.table import Table

from bench.growth.points import CURVES
from harness.common.arguments import Parser
from harness.study.provenance import processor

LAST = 3
"""Points at the upper end through which an exponent is fitted: below them what does not grow weighs."""


def exponent(sizes: list[int], values: list[float]) -> float:
    """Return the slope of the logarithms over the largest sizes, by least squares."""
    return float(np.polyfit(np.log(sizes[-LAST:]), np.log(values[-LAST:]), 1)[0])


def measured(curve: str, size: int) -> tuple[float, float]:
    """Return one point: the smaller time and memory of two processes, because the first may have to compile."""
    command = [sys.executable, "-m", "bench.growth", "--point", curve, str(size)]
    points = []
    for _ in range(2):
        done = subprocess.run(command, capture_output=True, text=True, check=False)
        if done.returncode:
            raise SystemExit(f"{curve}, {size}: {done.stderr[-2000:]}")
        points.append(json.loads(done.stdout.splitlines()[-1]))
    return min(seconds for seconds, _ in points), min(memory for _, memory in points)


def draw(curves: dict[str, dict[str, list[float]]], path: Path) -> None:
    """Write the figure: time above, memory below, with the fitted exponents."""
    import matplotlib

    matplotlib.use("Agg")
    from matplotlib import pyplot as plt

    figure, rows = plt.subplots(2, len(curves), figsize=(3.2 * len(curves), 6), squeeze=False, layout="constrained")
    for column, (curve, points) in enumerate(curves.items()):
        sizes = [int(n) for n in points]
        for row, (what, unit) in enumerate((("time", CURVES[curve][0]), ("memory", "MiB"))):
            values, axes = [p[row] for p in points.values()], rows[row, column]
            axes.loglog(sizes, values, "o-")
            axes.set(xlabel=curve, ylabel=f"{what}, {unit}", ylim=(min(values) / 2, max(values) * 2))
            axes.set_xticks(sizes, [f"{n:,}" for n in sizes], rotation=30)
            axes.yaxis.set_major_formatter("{x:g}")
            if row == 1:  # the process itself is most of it
                axes.set(yscale="linear", ylim=(0, max(values) * 1.2))
            axes.minorticks_off()
            if len(sizes) > 1:
                fitted, last = exponent(sizes, values), np.array(sizes[-LAST:])
                axes.plot(last, values[-1] * (last / last[-1]) ** fitted, "k--", lw=1)
                axes.set_title(f"exponent {fitted:.2f}", fontsize=10)
            axes.grid(alpha=0.3)
    figure.savefig(path)


def main() -> None:
    """Measure what is missing, print the table and draw the figure."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--out", type=Path, default=Path("results/growth"))
    parser.add_argument("--largest", type=int, default=1_000_000, help="leave larger sizes out")
    parser.add_argument("--point", nargs=2, metavar=("CURVE", "SIZE"), help="measure one point and print it")
    given = parser.parse_args()
    if given.point:
        print(json.dumps(CURVES[given.point[0]][1](int(given.point[1]))))
        return
    given.out.mkdir(parents=True, exist_ok=True)
    kept, console = given.out / "growth.json", Console()
    curves = json.loads(kept.read_text(encoding="utf-8")) if kept.exists() else {}
    for curve, (_, _, sizes) in CURVES.items():
        largest = min(given.largest, os.cpu_count() or 1) if curve == "workers" else given.largest
        points = curves.setdefault(curve, {})
        for size in (n for n in sizes if n <= largest and str(n) not in points):
            with console.status(f"measuring: {curve}, {size:,}"):
                points[str(size)] = measured(curve, size)
            kept.write_text(json.dumps(curves, indent=1), encoding="utf-8")
    curves = {curve: points for curve, points in curves.items() if points}
    table = Table(box=box.MARKDOWN, title=f"{processor()}")
    for name in ("what grows", "sizes", "time", "", "exponent", "memory, MiB", "exponent"):
        table.add_column(name)
    for curve, points in curves.items():
        done = [int(n) for n in points]
        times, memory = ([p[k] for p in points.values()] for k in (0, 1))
        fitted = [f"{exponent(done, values):.2f}" if len(done) > 1 else "" for values in (times, memory)]
        table.add_row(
            curve, ", ".join(f"{n:,}" for n in done), ", ".join(f"{t:.3g}" for t in times), CURVES[curve][0],
            fitted[0], ", ".join(f"{m:.0f}" for m in memory), fitted[1],
        )  # fmt: skip
    Console(width=200).print(table)
    draw(curves, given.out / "growth.svg")


if __name__ == "__main__":
    main()
