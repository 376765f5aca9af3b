"""Figures of the choice of a network, as Bild 5.3, 5.4 and 5.5 of Ziaukas 2023; each returns SVG."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.colors import LogNorm
from matplotlib.lines import Line2D

from harness.common.arrays import Floats
from harness.models.quantities import quantity
from harness.reporting import style
from reproductions.narx.lipschitz import Indices


def delays(indices: Sequence[Indices], chosen: tuple[int, int]) -> bytes:
    """Draw the Lipschitz indices of some drives over growing delays, a panel per output (Bild 5.3)."""
    outputs = list(dict.fromkeys(i.output for i in indices))
    drives = list(dict.fromkeys(i.drive for i in indices))
    looks = style.looks(drives)
    with style.drawing():
        fig = style.figure(1.0 + 2.3 * len(outputs))
        panels = fig.subplots(len(outputs), 1, sharex=True, squeeze=False)[:, 0]
        for axes, output in zip(panels, outputs, strict=True):
            for index in (i for i in indices if i.output == output):
                look = looks[index.drive]
                axes.semilogy(index.values, marker=look.marker, color=look.line, ls=look.dashes, ms=4)
            steps = indices[0].delays
            axes.axvline(steps.index(chosen), color="black", ls="--", lw=0.8)
            axes.set_xticks(range(len(steps)), [f"{a}, {b}" for a, b in steps])
            axes.set_ylabel("Lipschitz index")
            axes.set_title(quantity(output).words, loc="left")
            axes.grid(axis="y")
        panels[-1].set_xlabel("delays of the inputs, of the output")
        handles = [
            Line2D([], [], color=looks[d].line, ls=looks[d].dashes, marker=looks[d].marker, label=d) for d in drives
        ]
        handles.append(Line2D([], [], color="black", ls="--", lw=0.8, label="chosen"))
        style.head(fig, "How many past samples does the network need?", handles)
        return style.svg(fig)


def restarts(errors: Floats, counts: Sequence[int], name: str) -> bytes:
    """Draw how the errors of one architecture scatter with the first weights (Bild 5.4)."""
    with style.drawing():
        fig = style.figure(3.2)
        axes = fig.subplots()
        groups = [errors[:n][np.isfinite(errors[:n])] for n in counts]
        axes.boxplot(groups, whis=(0, 100), widths=0.5, medianprops={"color": style.TRUTH})
        for place, group in enumerate(groups, start=1):
            axes.plot(np.full(len(group), place), group, "o", ms=2.5, color="#0072B2", alpha=0.5, mew=0)
        axes.set_yscale("log")
        axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_xticks(range(1, len(counts) + 1), [str(n) for n in counts])
        axes.set_xlabel("trainings from different first weights")
        axes.set_ylabel("free-running NRMSE, sum")
        axes.grid(axis="y")
        style.head(fig, f"How much do the first weights matter ({name})?")
        return style.svg(fig)


def architectures(best: Mapping[str, Mapping[tuple[int, int], float]]) -> bytes:
    """Draw the error of the best training of each architecture, a panel per kind of error (Bild 5.5).

    Args:
        best: Per kind of error the value by (layers, neurons per layer).
    """
    kinds = list(best)
    layers = sorted({a for a, _ in best[kinds[0]]})
    neurons = sorted({b for _, b in best[kinds[0]]})
    with style.drawing():
        fig = style.figure(0.8 + 2.2 * len(kinds))
        panels = fig.subplots(len(kinds), 1, sharex=True, squeeze=False)[:, 0]
        for axes, kind in zip(panels, kinds, strict=True):
            grid = np.full((len(neurons), len(layers)), np.nan)
            for (a, b), value in best[kind].items():
                grid[neurons.index(b), layers.index(a)] = value if np.isfinite(value) else np.nan
            axes.imshow(grid, origin="lower", norm=LogNorm(), cmap="cividis_r", aspect="auto")
            least = np.unravel_index(np.nanargmin(grid), grid.shape)
            middle = np.sqrt(np.nanmin(grid) * np.nanmax(grid))
            for (row, column), value in np.ndenumerate(grid):
                if np.isfinite(value):
                    colour = "white" if value > middle else "black"
                    weight = "bold" if (row, column) == least else "normal"
                    axes.text(
                        column, row, f"{value:.1e}", ha="center", va="center", color=colour, size=9, weight=weight
                    )
            axes.plot(least[1] + 0.4, least[0], "x", color="#D55E00", mew=1.6, ms=6)
            axes.set_xticks(range(len(layers)), [str(n) for n in layers])
            axes.set_yticks(range(len(neurons)), [str(n) for n in neurons])
            axes.set_ylabel("neurons per layer")
            axes.set_title(f"{kind}: NRMSE, sum over the outputs", loc="left")
        panels[-1].set_xlabel("hidden layers")
        style.head(fig, "Which architecture gives the least error on the test drives?")
        return style.svg(fig)
