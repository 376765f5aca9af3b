"""Errors per drive: drives differ in what they ask of an estimator, and a box hides that."""

from __future__ import annotations

from typing import Any

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize
from numpy.typing import NDArray

from harness.report import style
from harness.report.analysis import Analysis, Findings
from harness.report.document import Block, Heading, Picture, Prose, plain
from harness.report.sections.boxes import UPRIGHT, factor_label
from harness.report.store import words

_LINE = 0.225  # inches per drive


def blocks(analysis: Analysis) -> list[Block]:
    """Return a map of the medians per drive and level for each target of the first design."""
    findings = analysis.main
    design = findings.design
    if len(design.drives) < 2:
        return []
    found: list[Block] = [
        Heading("On which drives are the estimators wrong?"),
        Prose(
            plain(
                "Drives differ in speed and steadiness, hence in what they ask of an estimator, and a box mixes them. "
                "Here each has a number of its own."
            )
        ),
    ]
    height = 0.42 + _LINE * len(design.drives)
    per_page = max(1, int((style.TALLEST - 1.6) // height))
    count = len(design.estimators)
    for target in range(len(design.targets)):
        for start in range(0, count, per_page):
            chosen = list(range(start, min(start + per_page, count)))
            found.append(_picture(findings, target, chosen, height))
    return found


def medians(findings: Findings, target: int) -> NDArray[np.float64]:
    """Return the median RMSE over samples and repeats, ``(band, estimator, drive)``; NaN without a run."""
    values = findings.design.rmse[target]
    flat = values.reshape(*values.shape[:3], -1)
    result = np.full(flat.shape[:3], np.nan)
    some = np.isfinite(flat).any(axis=-1)
    result[some] = np.nanmedian(flat[some], axis=-1)
    return result


def _picture(findings: Findings, target: int, chosen: list[int], height: float) -> Picture:
    design = findings.design
    quantity = design.targets[target]
    values = medians(findings, target)
    positive = values[np.isfinite(values) & (values > 0)]
    low, high = (positive.min(), positive.max()) if positive.size else (0.1, 1.0)
    norm: Normalize = LogNorm(low, high * 1.001) if high > 5 * low else Normalize(0.0, high)
    with style.drawing():
        fig = style.figure((0.85 if len(design.bands) <= UPRIGHT else 1.5) + height * len(chosen))
        rows = fig.subplots(len(chosen), 1, sharex=True, squeeze=False)[:, 0]
        for axes, e in zip(rows, chosen, strict=True):
            _map(axes, values[:, e].T, norm)
            axes.set_title(design.estimators[e], loc="left")
            axes.set_yticks(range(len(design.drives)), [words(d) for d in design.drives])
            axes.tick_params(length=0)
            axes.spines[:].set_visible(False)
        turn = 90 if len(design.bands) > UPRIGHT else 0
        rows[-1].set_xticks(range(len(design.bands)), design.bands, rotation=turn)
        rows[-1].set_xlabel(factor_label(design).replace("grey", "framed"))
        if design.matched is not None:
            for axes in rows:
                _frame(axes, design.matched, len(design.drives))
        style.head(fig, f"On which drives is the {quantity.words} hard to estimate?")
        svg = style.svg(fig)
    unit = style.in_unit(quantity.unit)
    caption = f"Median RMSE of {quantity.words}{unit} per drive and level; darker is worse, – means no run was ok."
    return Picture(svg, caption, f"Median RMSE of {quantity.words} per drive, level and estimator")


def _map(axes: Axes, values: NDArray[np.float64], norm: Normalize) -> None:
    """Draw drives by levels as coloured cells with their numbers."""
    shown = np.ma.masked_invalid(values)
    edges_x, edges_y = np.arange(values.shape[1] + 1) - 0.5, np.arange(values.shape[0] + 1) - 0.5
    colours = mpl.colormaps["Blues"]
    depth: Any = norm(shown)  # 0 to 1, masked where there is no run
    axes.pcolormesh(edges_x, edges_y, shown, cmap=colours, norm=norm, edgecolors="white", lw=0.8)
    axes.invert_yaxis()
    digits = 3 if values.shape[1] <= UPRIGHT else 2
    for (row, column), value in np.ndenumerate(values):
        dark = bool(np.ma.filled(depth, 0.0)[row, column] > 0.6)
        text = style.number(float(value), digits)
        cell = axes.text(column, row, text, ha="center", va="center", color="white" if dark else "black")
        cell.set_in_layout(False)  # inside the axes anyway, and measuring hundreds of them takes seconds


def _frame(axes: Axes, band: int, drives: int) -> None:
    axes.add_patch(mpl.patches.Rectangle((band - 0.5, -0.5), 1, drives, fill=False, ec="black", lw=1.2, zorder=5))
