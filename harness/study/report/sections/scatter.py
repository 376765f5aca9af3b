"""Within a band: error over the actual value of the factor in each run."""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator

from harness.reporting import style
from harness.reporting.document import Block, Picture, Prose, plain
from harness.study.report.analysis import Analysis, Findings
from harness.study.report.sections.boxes import scale_errors
from harness.study.results import Design, Factor

_ROW = 2.2
_AS_PIXELS_FROM = 4000  # points from which vectors make the file large and slow
_MOST = 100_000
"""Runs of an estimator that a panel draws at most: more only cover each other, and cost a drawing's memory each."""


def blocks(analysis: Analysis) -> list[Block]:
    """Return a figure per factor for each design whose factors vary within their bands."""
    content: list[Block] = []
    per_page = int((style.TALLEST - 1.3) // _ROW)
    for findings in analysis.findings:
        if not findings.design.sampled:
            continue
        targets = range(len(findings.design.targets))
        for k in range(len(findings.design.factors)):
            for start in range(0, len(targets), per_page):
                content.append(_picture(analysis, findings, k, list(targets[start : start + per_page])))
    if not content:
        return []
    text = (
        "Each run of a band has an exact value of its own. Over that value it shows whether the error grows steadily, "
        "from which value on, and how much of a box is the factor and how much the drive."
    )
    return [Prose(plain(text)), *content]


def _picture(analysis: Analysis, findings: Findings, number: int, targets: list[int]) -> Picture:
    design = findings.design
    factor = design.factors[number]
    with style.drawing():
        height = 1.1 + _ROW * len(targets)  # rather a little less than one figure to a page
        fig = style.figure(style.HALF if style.HALF < height < 1.4 * style.HALF else height)
        rows = fig.subplots(len(targets), 1, sharex=True, squeeze=False)[:, 0]
        for axes, t in zip(rows, targets, strict=True):
            _panel(axes, analysis, findings, factor, t)
        rows[-1].set_xlabel(f"{factor.words}{style.in_unit(factor.unit)}")
        rows[-1].xaxis.set_major_locator(MaxNLocator(9))
        handles = []
        for name in design.estimators:
            look = analysis.looks[name]
            label = name
            handles.append(Line2D([], [], color=look.colour, marker=look.marker, ls="", label=label))
        if np.isfinite(factor.nominal):
            handles.append(Line2D([], [], color="black", ls="--", lw=1.0, label=design.nominal_is))
        style.head(fig, f"How does the error change with the actual {factor.words}?", handles)
        svg = style.svg(fig)
    names = " and ".join(design.targets[t].words for t in targets)
    caption = (
        f"RMSE of {names} over the actual {factor.words}, design “{design.name}”, {_counted(design)}. Small and pale: "
        "one run each; large: median over the drives and repeats at one Sobol point. Grey: the bands; dashed: what "
        "the estimators believe."
    )
    return Picture(svg, caption, f"RMSE of {names} over {factor.words}")


def _counted(design: Design) -> str:
    """Say how many runs there are, and which are not drawn."""
    some = ", ".join(f"{name} {n}" for e, name in enumerate(design.estimators) if (n := design.diverged(e)))
    runs = f"{design.compared()} runs of each estimator"
    runs = f"{runs}, less those that diverged ({some})" if some else runs
    points, drawn = design.factors[0].values.shape[1], _drawn(design)
    return runs if drawn == points else f"{runs}, of which the first {drawn} of {points} points of each band are drawn"


def _drawn(design: Design) -> int:
    """Return how many points of each band are drawn; the first ones of a Sobol sequence fill the band as all do."""
    points = design.factors[0].values.shape[1]
    runs = design.planned * len(design.bands) // points
    return max(1, min(points, _MOST // runs))


def _panel(axes: Axes, analysis: Analysis, findings: Findings, factor: Factor, target: int) -> None:
    design = findings.design
    for low, high in sorted({(float(a), float(b)) for a, b in zip(factor.lower, factor.upper, strict=True)}):
        axes.axvspan(low, high, color=style.SHADE, lw=0, zorder=0)
    if np.isfinite(factor.nominal):
        axes.axvline(factor.nominal, color="black", ls="--", lw=1.0, zorder=1)
    values = np.where(np.isinf(design.errors[target]), np.nan, design.errors[target])[
        :, :, :, : _drawn(design)
    ]  # band, estimator, drive, sample, repeat
    actual = factor.values[:, : _drawn(design)]
    pixels = bool(values.size > _AS_PIXELS_FROM)
    x = np.broadcast_to(actual[:, None, :, None], values[:, 0].shape)
    for e, name in enumerate(design.estimators):
        look = analysis.looks[name]
        runs = values[:, e]
        with style.series(axes, name):
            axes.plot(
                x.ravel(),
                runs.ravel(),
                look.marker,
                ms=2.2,
                mew=0,
                color=look.colour,
                alpha=0.35,
                rasterized=pixels,
            )
        points = np.moveaxis(runs, 2, 1).reshape(*actual.shape, -1)
        some = np.isfinite(points).any(axis=-1)
        middle = np.nanmedian(points[some], axis=-1)
        with style.series(axes, name):
            axes.plot(actual[some], middle, look.marker, ms=3.4, color=look.colour, mec=look.line, mew=0.4)
    quantity = design.targets[target]
    axes.set_ylabel(f"RMSE of ${quantity.symbol}${style.in_unit(quantity.unit)}", parse_math=True)
    axes.set_title(quantity.words, loc="left")
    scale_errors(axes, findings.medians[target], values)
    axes.grid(axis="y")
