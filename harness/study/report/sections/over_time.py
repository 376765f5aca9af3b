"""Along a drive: which factor causes the error, and when?"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from numpy.typing import NDArray

from harness.models.quantities import listed
from harness.reporting import style
from harness.reporting.document import Block, Picture, Prose, plain
from harness.study.report.analysis import Analysis
from harness.study.report.ranking import Ranking
from harness.study.results import Design
from harness.study.score_names import ESTIMATOR_DIVERGED, PENDING
from harness.study.sobol_indices import sobol_indices

_SHOWN = 4  # factors drawn
_COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7")
_DASHES: tuple[Any, ...] = ("-", (0, (5, 1.5)), (0, (1.2, 1)), (0, (6, 1.5, 1, 1.5)))
_RESAMPLES = 100  # of intervals at a hundred windows, which are read together
_ROW = 1.7


def blocks(analysis: Analysis) -> list[Block]:
    """Return a figure per target for each design that keeps its errors over time; else nothing."""
    content: list[Block] = []
    for findings in analysis.findings:
        design = findings.design
        if "rmse_over_time" in design.data and not design.count(PENDING):
            ranking = findings.ranking
            content += [_picture(AlongDrive(ranking, t)) for t in range(len(design.targets)) if any(ranking.errors[t])]
    if not content:
        return []
    text = (
        "The same indices from the error in each window of one drive, for the estimator with the smallest median "
        "error. A diverged run has in the windows after its end the largest error that any run had there; there are no "
        "indices of windows in which the vehicle is out of control at some point."
    )
    return [Prose(plain(text)), *content]


class AlongDrive:
    """Sobol indices of one target's error in each window, for the estimator with the smallest median error."""

    def __init__(self, ranking: Ranking, target: int):
        self.design: Design = ranking.design
        self.seed, self.target, self.estimator = ranking.seed, target, ranking.best(target)

    @cached_property
    def errors(self) -> NDArray[np.float64]:
        """Error by point and window in report units, root mean square over repeats, ``(sample, window)``.

        NaN where the vehicle is out of control.
        """
        data = self.design.data["rmse_over_time"].isel(band=0, target=self.target)
        values = data.transpose("estimator", "sample", "repeat", "window").values.astype(float)
        finished = np.where(np.isfinite(values), values, -np.inf).max(axis=(0, 1, 2))
        largest = np.where(np.isfinite(finished), finished, np.nan)
        diverged = self.design.status[0, :, self.design.drives.index(self.drive)] == ESTIMATOR_DIVERGED
        scored = np.where(np.isnan(values) & diverged[..., None], largest, values)
        errors: NDArray[np.float64] = np.sqrt(np.mean(scored[self.estimator] ** 2, axis=1))
        return errors * self.design.targets[self.target].scale

    @property
    def drive(self) -> str:
        """Name of the drive."""
        return str(self.design.data.attrs["over_time_drive"])

    @cached_property
    def time(self) -> NDArray[np.float64]:
        """Middle of each window in s."""
        window = float(self.design.data.attrs["over_time_window"])
        return np.asarray(window * (np.arange(self.errors.shape[1]) + 0.5), dtype=np.float64)

    @cached_property
    def total(self) -> NDArray[np.float64]:
        """Total index with its interval by factor and window, NaN where it has none, ``(factor, window, 3)``."""
        factors = len(self.design.factors)
        table = np.full((factors, self.errors.shape[1], 3), np.nan)
        for k, outcome in enumerate(self.errors.T):
            if np.isfinite(outcome).all():
                indices = sobol_indices(outcome, factors, seed=self.seed, resamples=_RESAMPLES)
                if indices is not None:
                    table[:, k] = indices.total
        return table

    @cached_property
    def leading(self) -> list[int]:
        """Factors with the largest index, weighed with the variance of the windows."""
        weight = np.var(self.errors, axis=0)
        mean = np.nansum(self.total[:, :, 0] * weight, axis=1)
        return [int(i) for i in np.argsort(-mean, kind="stable")[:_SHOWN]]


def _picture(along: AlongDrive) -> Picture:
    design, quantity = along.design, along.design.targets[along.target]
    name = design.estimators[along.estimator]
    question = f"Which parameter causes the error of the {quantity.words}, and when?"
    with style.drawing():
        fig = style.figure(1.1 + 2 * _ROW)
        upper, lower = fig.subplots(2, 1, sharex=True)
        _shares(upper, along)
        low, middle, high = np.nanquantile(along.errors, [0.05, 0.5, 0.95], axis=0)
        lower.fill_between(along.time, low, high, color=style.SHADE, lw=0)
        lower.plot(along.time, middle, color="black")
        lower.set_ylabel(f"RMSE{style.in_unit(quantity.unit)}")
        lower.set_ylim(bottom=0.0)
        lower.set_xlabel("time in s")
        lower.set_title(f"{name}: median over the points, grey: 5 to 95 %", loc="left")
        lower.grid()
        handles = [
            Line2D([], [], color=_COLOURS[k], ls=_DASHES[k], label=design.factors[i].words)
            for k, i in enumerate(along.leading)
        ]
        style.head(fig, question, handles)
        svg = style.svg(fig)
    status = design.status[0, along.estimator, design.drives.index(along.drive)]
    diverged = int(np.sum(status == ESTIMATOR_DIVERGED))
    leader = [design.factors[i].words for i in along.leading[:2]]
    caption = (
        f"Total Sobol indices of the RMSE of {quantity.words} in windows of "
        f"{float(design.data.attrs['over_time_window']):g} s along the drive {along.drive}, {name}, n = "
        f"{len(along.errors)} points, diverged: {diverged}; shaded: 95 % interval. Most of the variance is that of "
        f"{listed(leader)}."
    )
    return Picture(svg, caption, question)


def _shares(axes: Axes, along: AlongDrive) -> None:
    for k, i in enumerate(along.leading):
        value, low, high = along.total[i].T
        axes.fill_between(along.time, low, high, color=_COLOURS[k], alpha=0.15, lw=0)
        axes.plot(along.time, value, color=_COLOURS[k], ls=_DASHES[k])
    axes.set_ylabel("total index")
    axes.set_ylim(0.0, max(1.05, 1.02 * float(np.nanmax(along.total[along.leading][:, :, 0], initial=0.0))))
    axes.grid()
