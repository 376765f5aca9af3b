"""Box plots in the form of Bild 5.9 of Ziaukas 2023, and the table behind them."""

from __future__ import annotations

import re
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from harness.common.statistics import Summary
from harness.reporting import style
from harness.reporting.document import Block, Heading, Picture, Prose, Sheet, plain
from harness.reporting.style import Look
from harness.study.report.analysis import Analysis, Findings
from harness.study.report.levels import NAMED, varied
from harness.study.results import Design
from harness.study.score_names import PENDING

UPRIGHT = 9  # levels whose labels fit side by side; more are turned
_OPENING = 5.0  # inches of the first page that the answer in words leaves to a figure
_LOWEST = 1.35  # inches per target where that keeps a figure on the first page
_LABEL = 80  # characters of an axis label that fit the width of the page
_LINES = {"bound": (0, (4, 2)), "smoother": (0, (1, 1.5))}
_SIDE_BY_SIDE = 40  # boxes across the page whose hatches can still be told apart
_DECADE = 10.0  # largest median over the smallest from which a linear axis would flatten the small boxes
_FAR = 30.0  # largest error over the typical one from which it would flatten all
FEW = 20
"""Runs below which a box is drawn as its runs: quartiles of fewer say less, and are often too near to be seen."""


def blocks(analysis: Analysis) -> list[Block]:
    """Return figures and tables of all designs, but for the figure of the first where the answer has it."""
    content: list[Block] = []
    for number, findings in enumerate(analysis.levelled):
        if number or analysis.one_factor_each:
            content += [Heading(heading(findings.design)), Prose(plain(_explain(findings.design)))]
            content += pictures(analysis, findings)
        content += [table(findings, target) for target in range(len(findings.design.targets))]
    return content


def _explain(design: Design) -> str:
    """Say what a further design adds to the first."""
    samples = design.status.shape[3]
    text = f"The design “{design.name}” has {design.planned} runs per level and estimator. "
    if design.sampled:
        names = " and ".join(f.words for f in design.factors)
        text += (
            f"Within each band {names} takes {samples} values of a Sobol sequence, so a box also shows what small "
            "departures from the centre of the band do."
        )
    return text


def heading(design: Design) -> str:
    """Return the question a design answers."""
    if not design.factors:
        return "How large is the error?"
    where = "in each band of" if design.sampled else "at each level of"
    if design.whole:
        where = f"over the {design.whole} of"
    return f"How large is the error {where} {varied(design)}?"


def factors_of(design: Design) -> str:
    """Return what the levels of a design are of, e.g. ``trailer mass of the plant``."""
    owners = {"plant": " of the plant", "belief": " believed", "both": " of plant and belief"}
    if len({f.of for f in design.factors}) == 1:
        return varied(design) + owners[design.factors[0].of]
    if len(design.factors) > NAMED:
        return varied(design)
    return ", ".join(f.words + owners[f.of] for f in design.factors) or design.name


def factor_label(design: Design) -> str:
    """Return the label of the axis of levels in as many lines as it needs."""
    label = factors_of(design)
    if design.matched is not None:
        label += f" (grey: {design.matched_is})"
    return textwrap.fill(label, _LABEL)


def tick_labels(design: Design) -> list[str]:
    """Return what stands under each level: its name, the runs of each box, those that diverged or are in no box."""
    labels = []
    for band, name in enumerate(design.bands):
        lines = [_broken(name), f"n {design.compared(band)}"]
        counts = [design.diverged(e, band) for e in range(len(design.estimators))]
        if max(counts):
            lines.append(f"div. {max(counts)}" if min(counts) == max(counts) else f"div. {min(counts)}–{max(counts)}")
        if out := int(design.out_of_control[band].sum()):
            lines.append(f"out {out}")
        labels.append(("\n" if len(design.bands) <= UPRIGHT else " · ").join(lines))
    return labels


def _broken(label: str) -> str:
    label = re.sub(r"(?<!\w)-(?=\d)", "−", label)
    return label.replace(", ", ",\n") if len(label) > 12 else label


def label_levels(axes: Axes, design: Design) -> None:
    """Write the levels, the runs and the losses under an axis."""
    turn: dict[str, Any] = {} if len(design.bands) <= UPRIGHT else {"rotation": 90}
    axes.set_xticks(range(len(design.bands)), tick_labels(design), **turn)
    axes.tick_params(axis="x", length=0)
    axes.set_xlim(-0.5, len(design.bands) - 0.5)
    axes.set_xlabel(factor_label(design))


def foot(design: Design) -> float:
    """Return the inches that the labels of the levels need below the panels."""
    return 0.35 + _names(design) + 0.16 * factor_label(design).count("\n")


def _names(design: Design) -> float:
    """Return the inches that the names of the levels need below a panel."""
    return 0.55 if len(design.bands) <= UPRIGHT else 1.55


@dataclass(frozen=True)
class Panel:
    """One target at levels that stand side by side."""

    target: int
    levels: range


def arranged(design: Design, side_by_side: int, opening: bool = False) -> tuple[list[list[Panel]], float]:
    """Return the panels of each figure of a design, as many as fit on a page, and the height of a panel in inches.

    Args:
        design: The design.
        side_by_side: Boxes that a panel has room for; a target with more has several panels, of some levels each.
        opening: Whether the first figure shares its page with the answer in words.
    """
    count = len(design.bands)
    rows = -(-count // max(1, side_by_side // len(design.estimators)))
    size = -(-count // rows)
    levels = [range(first, min(first + size, count)) for first in range(0, count, size)]
    own = _names(design) if len(levels) > 1 else 0.0
    tall = own + (1.65 if len(design.estimators) <= 3 else 2.3)  # more where many boxes stand side by side
    room = (_OPENING if opening else style.TALLEST - 0.45) - 0.25 - foot(design)
    fitting = max(1, int((room + own) // (own + _LOWEST if opening else tall)))
    if fitting > len(levels):
        fitting -= fitting % len(levels)  # the panels of a target stay together
    panels = [Panel(target, some) for target in range(len(design.targets)) for some in levels]
    height = min(tall, (room + own) / min(fitting, len(panels)))
    return [panels[k : k + fitting] for k in range(0, len(panels), fitting)], height


def framed(
    findings: Findings,
    panels: Sequence[Panel],
    height: float,
    draw: Callable[[Axes, Panel], None],
    title: str,
    legend: Sequence[Any],
) -> bytes:
    """Return a figure of panels above the names of their levels, as SVG.

    Args:
        findings: Of a design.
        panels: From ``arranged``.
        height: Of a panel, likewise.
        draw: Draws a panel.
        title: The question that the figure answers.
        legend: Handles of the legend.
    """
    design = findings.design
    with style.drawing():
        fig = style.figure(0.25 + foot(design) + height * len(panels))
        rows = fig.subplots(len(panels), 1, squeeze=False)[:, 0]
        wide = max(len(panel.levels) for panel in panels)
        for axes, panel in zip(rows, panels, strict=True):
            style.mark_matched(axes, design.matched if design.matched in panel.levels else None)
            draw(axes, panel)
            label_levels(axes, design)
            axes.set_xlim(panel.levels.start - 0.5, panel.levels.start + wide - 0.5)
            axes.grid(axis="y")
            if axes is not rows[-1]:
                axes.set_xlabel("")
                axes.tick_params(labelbottom=wide < len(design.bands))
        style.head(fig, title, legend)
        return style.svg(fig)


def pictures(analysis: Analysis, findings: Findings, opening: bool = False) -> list[Picture]:
    """Return the box plots of a design, as many targets in a figure as fit on a page.

    Args:
        analysis: Looks of the estimators.
        findings: The design.
        opening: Whether the figure shares the first page with the answer in words.
    """
    figures, height = arranged(findings.design, _SIDE_BY_SIDE, opening)
    return [_picture(analysis, findings, panels, height) for panels in figures]


def _picture(analysis: Analysis, findings: Findings, panels: list[Panel], height: float) -> Picture:
    design = findings.design
    targets = dict.fromkeys(panel.target for panel in panels)
    best = _at_best(analysis, findings, panels[0].target)
    counts = {s.n for t in targets for row in findings.summaries[t] for s in row if s.n}
    handles: list[Any] = style.patches(design.estimators, analysis.looks)
    if not counts or max(counts) < FEW:
        handles = style.markers(design.estimators, analysis.looks)
    handles += [Line2D([], [], color="black", ls=_LINES[name], label=name) for name in best]
    svg = framed(
        findings,
        panels,
        height,
        lambda axes, panel: _boxes(axes, analysis, findings, panel),
        heading(design),
        handles,
    )
    names = " and ".join(design.targets[t].words for t in targets)
    caption = f"RMSE of {names}."
    if counts and max(counts) >= FEW:
        caption += (
            " Box: quartiles; line: median; thick bar: its 95 % bootstrap interval; whiskers: smallest and largest run."
        )
    if counts and min(counts) < FEW:
        scope = f" of a box with fewer than {FEW}" if max(counts) >= FEW else ""
        caption += f" Points: the runs{scope}; line: their median."
    caption += " n: runs of each estimator at a level, the same ones for all."
    if any(design.diverged(e) for e in range(len(design.estimators))):
        caption += " div.: of these, runs in which an estimator diverged; they count as larger than any other."
    if design.out_of_control.any():
        caption += " out: runs in which the vehicle went out of control, in no box."
    if "bound" in best:
        caption += (
            " Dashed: the posterior Cramér-Rao bound (Tichavsky et al. 1998), median over the drives: the smallest "
            "RMSE of anyone who knows the vehicle, with these sensors and the belief's noise of unknown inputs."
        )
    if "smoother" in best:
        caption += " Dotted: a smoother that knows the same, and all measurements of a run at every sample."
    return Picture(svg, caption, f"Box plots of the RMSE of {names} per level and estimator")


def _boxes(axes: Axes, analysis: Analysis, findings: Findings, panel: Panel) -> None:
    design, target = findings.design, panel.target
    summaries = findings.summaries[target]
    best = _at_best(analysis, findings, target)
    top = scale_errors(axes, findings.medians[target], np.append(design.errors[target], list(best.values())))
    style.rescalable(axes)
    count = len(design.estimators)
    width = 0.8 / count
    for e, name in enumerate(design.estimators):
        for band in panel.levels:
            s, place, look = summaries[band][e], band + (e - (count - 1) / 2) * width, analysis.looks[name]
            if not s.n:
                continue
            parts: Artist | list[Artist]
            if not np.isfinite(s.median.value):
                parts = style.at_edge(axes, place, "diverged", look)
            elif s.n < FEW:
                parts = _points(axes, s, design.errors[target, band, e], place, 0.82 * width, look)
            else:
                parts = _box(axes, s, place, 0.82 * width, look, 2 * top)
            style.mark(parts, name, _in_words(findings, target, band, e))
    quantity = design.targets[target]
    axes.set_ylabel(f"RMSE of ${quantity.symbol}${style.in_unit(quantity.unit)}", parse_math=True)
    axes.set_title(quantity.words, loc="left")
    for name, values in best.items():
        start, right = ([band + side for band in range(len(values))] for side in (-0.45, 0.45))
        style.mark(axes.hlines(values, start, right, color="black", ls=_LINES[name], lw=1.0), "", name)


def _box(axes: Axes, s: Summary, place: float, width: float, look: Look, most: float) -> list[Artist]:
    """Draw a box; what is infinite ends at ``most``, beyond the panel, so that it is open above."""
    low, high, upper, largest = np.minimum([s.median.lower, s.median.upper, s.upper_quartile, s.maximum], most)
    start, right, gap = place - width / 2, place + width / 2, np.nan
    ends = [place - width / 4, place + width / 4, gap]
    box = Rectangle((start, s.lower_quartile), width, upper - s.lower_quartile, fc=look.tint, ec=look.line, zorder=2)
    box.set_hatch(look.hatch)
    axes.add_patch(box)
    return [
        box,
        *axes.plot(
            [*ends, place, place, gap, place, place, gap, *ends],
            [s.minimum, s.minimum, gap, s.minimum, s.lower_quartile, gap, upper, largest, gap, largest, largest, gap],
            color=look.line,
            lw=0.8,
        ),
        *axes.plot([start, right], [s.median.value] * 2, color="black", lw=1.0),
        *axes.plot([place, place], [low, high], color="white", lw=3.6, solid_capstyle="butt"),
        *axes.plot([place, place], [low, high], color="black", lw=2.2, solid_capstyle="butt"),
    ]


def _points(
    axes: Axes, s: Summary, values: NDArray[np.float64], place: float, width: float, look: Look
) -> list[Artist]:
    """Draw the runs of a box side by side, and the line of their median."""
    runs = values[np.isfinite(values)]
    places = place + width * (np.arange(runs.size) + 0.5 - runs.size / 2) / runs.size
    return [
        *axes.plot(places, runs, look.marker, ms=3.4, color=look.face, mec=look.line, mew=0.5),
        *axes.plot(place + width * np.array([-0.5, 0.5]), [s.median.value] * 2, color="black", lw=0.8),
    ]


def _at_best(analysis: Analysis, findings: Findings, target: int) -> dict[str, np.ndarray]:
    """Return in each band the smallest RMSE possible, and what a smoother reaches, in report units, where asked for."""
    quantity, design = findings.design.targets[target], findings.design.name
    kept = {"bound": analysis.store.bounds, "smoother": analysis.store.smoothed}
    rows = {name: some.get(design, {}).get(quantity.name) for name, some in kept.items()}
    return {n: np.array(v, dtype=float) * quantity.scale for n, v in rows.items() if v is not None}


def scale_errors(axes: Axes, medians: NDArray[np.float64], errors: NDArray[np.float64]) -> float:
    """Let an axis of errors begin at zero, or be logarithmic where that would flatten what it shows; return its top."""
    middle, seen = (x[np.isfinite(x) & (x > 0)] for x in (medians, errors))
    if middle.size and (middle.max() > _DECADE * middle.min() or seen.max() > _FAR * np.median(seen)):
        style.logarithmic(axes, float(seen.min()), float(seen.max()))
    else:
        axes.set_ylim(0.0, 1.05 * float(seen.max()) if seen.size else 1.0)
    return axes.get_ylim()[1]


def _in_words(findings: Findings, target: int, band: int, e: int) -> str:
    """Return what a box says, for a reader on screen."""
    design, s = findings.design, findings.summaries[target][band][e]
    unit = design.targets[target].unit
    where = f", {design.bands[band]}" if len(design.bands) > 1 else ""
    interval = "" if np.isnan(s.median.lower) else f" ({style.span(s.median.lower, s.median.upper, unit)})"
    quartiles = f", quartiles {style.span(s.lower_quartile, s.upper_quartile, unit)}" if s.n >= FEW else ""
    return (
        f"{design.estimators[e]}{where}: median {style.with_unit(s.median.value, unit)}{interval}{quartiles}, smallest "
        f"{style.with_unit(s.minimum, unit)}, largest {style.with_unit(s.maximum, unit)}, {s.n} runs"
    )


def table(findings: Findings, target: int) -> Sheet:
    """Return the numbers behind the boxes of a target: levels down, estimators across."""
    design = findings.design
    out = design.out_of_control.sum(axis=(1, 2, 3))
    rows = [
        [
            label + (f"\n{out[band]} out of control" if out[band] else ""),
            *(_cell(findings, target, band, e) for e in range(len(design.estimators))),
        ]
        for band, label in enumerate(design.bands)
    ]
    quantity = design.targets[target]
    caption = (
        f"RMSE of {quantity.words}{style.in_unit(quantity.unit)}, design “{design.name}”: median, its 95 % interval, "
        f"largest; {design.planned} runs of each estimator at a level"
        + (", less those in which the vehicle went out of control." if out.any() else ".")
    )
    return Sheet(["level", *design.estimators], rows, caption)


def _cell(findings: Findings, target: int, band: int, e: int) -> str:
    """Return the lines of a cell; what did not happen has none."""
    s = findings.summaries[target][band][e]
    lines = [style.number(s.median.value)]
    if not np.isnan(s.median.lower):
        lines.append(f"{style.number(s.median.lower)}–{style.number(s.median.upper)}")
    if s.n > 1:
        lines.append(f"max {style.number(s.maximum)}")
    design = findings.design
    counts = {"diverged": design.diverged(e, band), "not run": design.count(PENDING, band, e)}
    return "\n".join(lines + [f"{count} {name}" for name, count in counts.items() if count])
