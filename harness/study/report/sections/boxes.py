"""Box plots in the form of Bild 5.9 of Ziaukas 2023, and the table behind them."""

from __future__ import annotations

import textwrap
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from harness.common.statistics import Summary
from harness.reporting import style
from harness.reporting.document import Block, Heading, Picture, Prose, Sheet, plain
from harness.study.report.analysis import Analysis, Findings
from harness.study.report.levels import NAMED, varied
from harness.study.results import Design
from harness.study.scores import PENDING

UPRIGHT = 9  # levels whose labels fit side by side; more are turned
_OPENING = 5.8  # inches of the first page that the answer in words leaves to a figure
_LOWEST = 1.35  # inches per target where that keeps a figure on the first page
_LABEL = 80  # characters of an axis label that fit the width of the page
_LINES = {"bound": (0, (4, 2)), "smoother": (0, (1, 1.5))}
_LOGARITHMIC_FROM = 30.0  # largest error over typical error from which a linear axis would show nothing


def blocks(analysis: Analysis) -> list[Block]:
    """Return the tables of the first design, whose figure is in the answer, and figures and tables of the others."""
    found: list[Block] = []
    for number, findings in enumerate(analysis.levelled):
        if number:
            found += [Heading(heading(findings.design)), Prose(plain(_explain(findings.design)))]
            found += pictures(analysis, findings)
        found += [table(findings, target) for target in range(len(findings.design.targets))]
    return found


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
    if design.sampling == "saltelli":
        where = "over the whole box of"
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
    return (0.9 if len(design.bands) <= UPRIGHT else 1.9) + 0.16 * factor_label(design).count("\n")


def row_height(design: Design) -> float:
    """Return the inches a target needs: more where many boxes stand side by side."""
    return 1.65 if len(design.estimators) <= 3 else 2.3


def pictures(analysis: Analysis, findings: Findings, opening: bool = False) -> list[Picture]:
    """Return the box plots of a design, as many targets in a figure as fit on a page.

    Args:
        analysis: Looks of the estimators.
        findings: The design.
        opening: Whether the figure shares the first page with the answer in words.
    """
    design = findings.design
    room = (_OPENING if opening else style.TALLEST - 0.45) - 0.25 - foot(design)
    per_figure = max(1, int(room // (_LOWEST if opening else row_height(design))))
    height = min(row_height(design), room / min(per_figure, len(design.targets)))
    starts = range(0, len(design.targets), per_figure)
    return [_picture(analysis, findings, list(range(len(design.targets)))[k : k + per_figure], height) for k in starts]


def _picture(analysis: Analysis, findings: Findings, targets: list[int], height: float) -> Picture:
    design = findings.design
    with style.drawing():
        fig = style.figure(0.25 + foot(design) + height * len(targets))
        rows = fig.subplots(len(targets), 1, sharex=True, squeeze=False)[:, 0]
        for axes, t in zip(rows, targets, strict=True):
            _boxes(axes, analysis, findings, t)
        label_levels(rows[-1], design)
        handles: list[Any] = style.patches(design.estimators, analysis.looks)
        for name in _at_best(analysis, findings, targets[0]):
            handles.append(Line2D([], [], color="black", ls=_LINES[name], label=name))
        style.head(fig, heading(design), handles)
        svg = style.svg(fig)
    names = " and ".join(design.targets[t].words for t in targets)
    caption = (
        f"RMSE of {names}. Box: quartiles; line: median; thick bar: its 95 % bootstrap interval; whiskers: smallest "
        "and largest run. n: runs of each box, the same for all estimators."
    )
    if any(design.diverged(e) for e in range(len(design.estimators))):
        caption += " div.: of these, runs in which an estimator diverged; they count as larger than any other."
    if design.out_of_control.any():
        caption += " out: runs in which the vehicle went out of control, in no box."
    shown = _at_best(analysis, findings, targets[0])
    if "bound" in shown:
        caption += (
            " Dashed: the posterior Cramér-Rao bound (Tichavsky et al. 1998), median over the drives: the smallest "
            "RMSE of anyone who knows the vehicle, with these sensors and the belief's noise of unknown inputs."
        )
    if "smoother" in shown:
        caption += " Dotted: a smoother that knows the same, and all measurements of a run at every sample."
    return Picture(svg, caption, f"Box plots of the RMSE of {names} per level and estimator")


def _boxes(axes: Axes, analysis: Analysis, findings: Findings, target: int) -> None:
    design = findings.design
    style.mark_matched(axes, design.matched)
    count = len(design.estimators)
    width = 0.8 / count
    for e, name in enumerate(design.estimators):
        look = analysis.looks[name]
        bands = [band for band in range(len(design.bands)) if findings.summaries[target][band][e].n]
        if not bands:
            continue
        places = [band + (e - (count - 1) / 2) * width for band in bands]
        boxes = [_statistics(findings.summaries[target][band][e]) for band in bands]
        drawn = axes.bxp(
            boxes,
            positions=places,
            widths=0.82 * width,
            showfliers=False,
            patch_artist=True,
            manage_ticks=False,
            boxprops={"facecolor": look.tint, "edgecolor": look.line, "hatch": look.hatch},
            whiskerprops={"color": look.line, "linewidth": 0.8},
            capprops={"color": look.line, "linewidth": 0.8},
            medianprops={"color": "black", "linewidth": 1.0},
        )
        for number, band in enumerate(bands):
            parts = [drawn[kind][number] for kind in ("boxes", "medians")]
            parts += [drawn[kind][2 * number + side] for kind in ("whiskers", "caps") for side in range(2)]
            style.mark(parts, name, _in_words(findings, target, band, e))
        low, high = [b["low"] for b in boxes], [b["high"] for b in boxes]
        style.mark(axes.vlines(places, low, high, color="white", lw=3.6, zorder=5), name)
        style.mark(axes.vlines(places, low, high, color="black", lw=2.2, zorder=6), name)
    quantity = design.targets[target]
    axes.set_ylabel(f"RMSE of ${quantity.symbol}${style.in_unit(quantity.unit)}", parse_math=True)
    axes.set_title(quantity.words, loc="left")
    shown = design.errors[target]
    for name, values in _at_best(analysis, findings, target).items():
        left, right = ([band + side for band in range(len(values))] for side in (-0.45, 0.45))
        style.mark(axes.hlines(values, left, right, color="black", ls=_LINES[name], lw=1.0), "", name)
        shown = np.append(shown, values)
    scale_errors(axes, shown)
    axes.grid(axis="y")


def _at_best(analysis: Analysis, findings: Findings, target: int) -> dict[str, np.ndarray]:
    """Return in each band the smallest RMSE possible, and what a smoother reaches, in report units, where asked for."""
    quantity, design = findings.design.targets[target], findings.design.name
    kept = {"bound": analysis.store.bounds, "smoother": analysis.store.smoothed}
    found = {name: some.get(design, {}).get(quantity.name) for name, some in kept.items()}
    return {n: np.array(v, dtype=float) * quantity.scale for n, v in found.items() if v is not None}


def scale_errors(axes: Axes, errors: np.ndarray) -> None:
    """Begin at zero; where errors span more than a decade and a half, use a logarithmic axis."""
    finite = errors[np.isfinite(errors) & (errors > 0)]
    if finite.size and finite.max() > _LOGARITHMIC_FROM * np.median(finite):
        style.logarithmic(axes, float(finite.min()), float(finite.max()))
    else:
        axes.set_ylim(bottom=0)


def _in_words(findings: Findings, target: int, band: int, e: int) -> str:
    """Return what a box says, for a reader on screen."""
    design, s = findings.design, findings.summaries[target][band][e]
    unit = design.targets[target].unit
    where = f", {design.bands[band]}" if len(design.bands) > 1 else ""
    return (
        f"{design.estimators[e]}{where}: median {style.with_unit(s.median.value, unit)} "
        f"({style.span(s.median.lower, s.median.upper, unit)}), quartiles "
        f"{style.span(s.lower_quartile, s.upper_quartile, unit)}, smallest {style.with_unit(s.minimum, unit)}, largest "
        f"{style.with_unit(s.maximum, unit)}, {s.n} runs"
    )


def _statistics(s: Summary) -> dict[str, Any]:
    return {
        "med": s.median.value,
        "q1": s.lower_quartile,
        "q3": s.upper_quartile,
        "whislo": s.minimum,
        "whishi": s.maximum,
        "low": s.median.lower,
        "high": s.median.upper,
    }


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
    if s.n:
        lines += [f"{style.number(s.median.lower)}–{style.number(s.median.upper)}", f"max {style.number(s.maximum)}"]
    design = findings.design
    counts = {"diverged": design.diverged(e, band), "not run": design.count(PENDING, band, e)}
    return "\n".join(lines + [f"{count} {name}" for name, count in counts.items() if count])
