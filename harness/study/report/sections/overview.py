"""All designs of a study at once: a map of the medians per estimator and level, where each design varies one factor."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from harness.models.quantities import listed
from harness.reporting import style
from harness.reporting.document import Picture
from harness.study.report.analysis import Analysis, Findings
from harness.study.report.levels import varied
from harness.study.report.sections.drives import colours_of, heat_map

_LINE = 0.225  # inches per estimator


def pictures(analysis: Analysis) -> list[Picture]:
    """Return the map of all targets; none where the study has no such designs."""
    shown = analysis.one_factor_each
    further = [f.design.name for f in analysis.findings if all(f is not each for each in shown)]
    return [_picture(shown, further)] if shown else []


def _picture(shown: Sequence[Findings], further: Sequence[str]) -> Picture:
    first = shown[0].design
    with style.drawing():
        fig = style.figure(0.75 + len(first.targets) * (0.55 + _LINE * len(first.estimators)))
        widths = [len(f.design.bands) for f in shown]
        grid = fig.subplots(len(first.targets), len(shown), squeeze=False, sharey=True, width_ratios=widths)
        for target, (row, quantity) in enumerate(zip(grid, first.targets, strict=True)):
            medians = [f.medians[target].T for f in shown]  # (estimator, level)
            colours = colours_of(np.concatenate(medians, axis=1))
            for axes, findings, values in zip(row, shown, medians, strict=True):
                heat_map(axes, values, colours)
                axes.set_xticks(range(len(findings.design.bands)), findings.design.bands)
                axes.set_xlabel(varied(findings.design))
                axes.tick_params(length=0)
                axes.spines[:].set_visible(False)
            row[0].set_yticks(range(len(first.estimators)), first.estimators)
            row[0].set_title(f"{quantity.words}{style.in_unit(quantity.unit)}", loc="left")
        style.head(fig, "How large is the error, and of what?")
        svg = style.svg(fig)
    names = " and ".join(quantity.words for quantity in first.targets)
    caption = f"Median RMSE of {names} per estimator and level of each design; darker is worse, ∞: most runs diverged."
    if further:
        caption += f" Of further designs, {listed(further)}, figures are below."
    return Picture(svg, caption, f"Median RMSE of {names} per estimator and level")
