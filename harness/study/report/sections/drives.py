"""Errors per drive: drives differ in what they ask of an estimator, and a box hides that."""

from __future__ import annotations

import textwrap
from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from numpy.typing import NDArray

from harness.models.quantities import words
from harness.reporting import style
from harness.reporting.document import Block, Picture, Prose, plain
from harness.study.report.analysis import Analysis, Findings
from harness.study.report.sections.boxes import UPRIGHT

_LINE = 0.225  # inches per drive
_TITLE_LINE = 0.17  # inches per further line of a panel's title
_TITLE = 90  # characters in a line of it


def blocks(analysis: Analysis) -> list[Block]:
    """Return maps of the medians per drive and estimator of the first design, as believed and where it is worst."""
    findings = analysis.main
    design = findings.design
    if len(design.drives) < 2:
        return []
    content: list[Block] = [
        Prose(
            plain(
                "Drives differ in speed and steadiness, hence in what they ask of an estimator, and a box mixes them. "
                "Here each has a number of its own."
            )
        ),
    ]
    of_targets = [[(t, band) for band in shown(findings, t)] for t in range(len(design.targets))]
    lines = max(_title(findings, *panel).count("\n") for panels in of_targets for panel in panels)
    height = 0.42 + _TITLE_LINE * lines + _LINE * len(design.drives)
    per_page = max(1, int((style.TALLEST - 1.6) // height))
    for panels in of_targets:
        content += [_picture(findings, panels[k : k + per_page], height) for k in range(0, len(panels), per_page)]
    return content


def shown(findings: Findings, target: int) -> list[int]:
    """Return the bands drawn of a target: the one believed, and the one with the largest median over estimators."""
    medians = findings.medians[target]
    size = np.array([np.median(row[np.isfinite(row)]) if np.isfinite(row).any() else -np.inf for row in medians])
    worst = int(np.argmax(size))
    home = findings.design.matched
    return [worst] if home is None or home == worst else [home, worst]


def medians(findings: Findings, target: int) -> NDArray[np.float64]:
    """Return the median RMSE over samples and repeats, ``(band, estimator, drive)``.

    Infinite where most runs diverged, NaN without a run.
    """
    values = findings.design.errors[target]
    flat = values.reshape(*values.shape[:3], -1)
    result = np.full(flat.shape[:3], np.nan)
    some = ~np.isnan(flat).all(axis=-1)
    result[some] = np.nanmedian(flat[some], axis=-1)
    return result


def _picture(findings: Findings, panels: list[tuple[int, int]], height: float) -> Picture:
    """Return the maps of one target."""
    design, name = findings.design, findings.design.targets[panels[0][0]].words
    turn = {"rotation": 90} if len(design.estimators) > UPRIGHT else {}
    with style.drawing():
        fig = style.figure((0.6 if not turn else 1.2) + height * len(panels))
        rows = fig.subplots(len(panels), 1, sharex=True, squeeze=False)[:, 0]
        for axes, (target, band) in zip(rows, panels, strict=True):
            values = medians(findings, target)
            heat_map(axes, values[band].T, colours_of(values))
            axes.set_title(_title(findings, target, band), loc="left")
            axes.set_yticks(range(len(design.drives)), [words(d) for d in design.drives])
            axes.tick_params(length=0)
            axes.spines[:].set_visible(False)
        rows[-1].set_xticks(range(len(design.estimators)), design.estimators, **turn)
        style.head(fig, f"On which drives is the error of the {name} large?")
        svg = style.svg(fig)
    runs = design.planned // len(design.drives)
    caption = (
        f"Median RMSE of {name} per drive and estimator over {runs} runs less those lost, where plant and estimators "
        "differ least and most; darker is worse, – means no run was ok, ∞ that most runs diverged."
    )
    return Picture(svg, caption, f"Median RMSE of {name} per drive, level and estimator")


def _title(findings: Findings, target: int, band: int) -> str:
    """Return what a panel shows, on as many lines as the label of a level of several factors needs."""
    design = findings.design
    quantity = design.targets[target]
    believed = f" ({design.matched_is})" if band == design.matched else ""
    return textwrap.fill(f"{quantity.words}{style.in_unit(quantity.unit)}, {design.bands[band]}{believed}", _TITLE)


def colours_of(values: NDArray[np.float64]) -> Normalize:
    """Return the colours of a target, the same in all its panels."""
    positive = values[np.isfinite(values) & (values > 0)]
    low, high = (positive.min(), positive.max()) if positive.size else (0.1, 1.0)
    return LogNorm(low, high * 1.001) if high > 5 * low else Normalize(0.0, high)


def heat_map(axes: Axes, values: NDArray[np.float64], norm: Normalize) -> None:
    """Draw rows by columns as coloured cells with their numbers."""
    shown = np.ma.masked_invalid(np.where(np.isposinf(values), norm.vmax or 1.0, values))
    edges_x, edges_y = np.arange(values.shape[1] + 1) - 0.5, np.arange(values.shape[0] + 1) - 0.5
    colours = mpl.colormaps["Blues"]
    depth: Any = norm(shown)  # 0 to 1, masked where there is no run
    axes.pcolormesh(edges_x, edges_y, shown, cmap=colours, norm=norm, edgecolors="white", lw=0.8)
    axes.set_ylim(values.shape[0] - 0.5, -0.5)
    digits = 3 if values.shape[1] <= UPRIGHT else 2
    for (row, column), value in np.ndenumerate(values):
        dark = bool(np.ma.filled(depth, 0.0)[row, column] > 0.6)
        text = style.number(float(value), digits)
        cell = axes.text(column, row, text, ha="center", va="center", color="white" if dark else "black")
        cell.set_in_layout(False)  # inside the axes anyway, and measuring hundreds of them takes seconds
