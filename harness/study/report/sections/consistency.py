"""Consistency: is the covariance that an estimator states as large as its errors are?"""

from __future__ import annotations

import numpy as np
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from harness.models.quantities import words
from harness.reporting import style
from harness.reporting.document import Block, Picture, Prose, Sheet, plain
from harness.study.report.analysis import Analysis, Findings
from harness.study.report.sections.boxes import foot, label_levels

_SCORES = {"nees": "NEES", "nis": "NIS"}


def blocks(analysis: Analysis) -> list[Block]:
    """Return figure and tables of the first design; nothing if no estimator states a covariance."""
    findings = analysis.main
    if not findings.with_covariance:
        return []
    return [
        Prose(_explain(findings)),
        _picture(analysis, findings),
        *blocks_by_drive(findings),
        _table(findings),
    ]


def _explain(findings: Findings) -> str:
    design = findings.design
    silent = [e for k, e in enumerate(design.estimators) if k not in findings.with_covariance]
    text = (
        "NEES weighs the state error, NIS the innovation, with the covariance the estimator states. A consistent "
        f"estimator has an average NEES of {design.state_dimension} (states) and an average NIS of "
        f"{design.output_dimension} (outputs); both are shown divided by that. Above its bounds an estimator is "
        "over-confident: its errors are larger than it says. Below, it is cautious. The bounds are two-sided at 95 %. "
        "Those of NIS rest on all updates of a level, and are so narrow that a small misfit shows; its size is what "
        "matters. Those of NEES rest on the number of runs, as state errors are correlated over time, and err on the "
        "safe side."
    )
    if silent:
        text += f" No covariance, hence no row: {', '.join(silent)}."
    return plain(text)


def _picture(analysis: Analysis, findings: Findings) -> Picture:
    design = findings.design
    with style.drawing():
        fig = style.figure(5.7 + foot(design))
        rows = fig.subplots(3, 1, sharex=True)
        _ratios(rows[0], analysis, findings, "nees")
        _ratios(rows[1], analysis, findings, "nis")
        _shares(rows[2], analysis, findings)
        label_levels(rows[2], design)
        handles = []
        for e in findings.with_covariance:
            look = analysis.looks[design.estimators[e]]
            label = design.estimators[e]
            handles.append(Line2D([], [], color=look.colour, marker=look.marker, ls="", label=label))
        handles.append(Line2D([], [], color="black", lw=5, alpha=0.25, label="95 % bounds"))
        style.head(fig, "Are the stated covariances as large as the errors?", handles)
        svg = style.svg(fig)
    caption = (
        f"Average NEES and NIS over their expectation, design “{design.name}”, with the bounds within which a "
        "consistent estimator stays, and the share of samples inside the 95 % region (filled: NEES; open: NIS)."
    )
    return Picture(svg, caption, "NEES and NIS per level and estimator with their bounds")


def _place(findings: Findings, number: int) -> float:
    count = len(findings.with_covariance)
    return (number - (count - 1) / 2) * 0.8 / max(count, 2)


def _ratios(axes: Axes, analysis: Analysis, findings: Findings, score: str) -> None:
    design = findings.design
    style.mark_matched(axes, design.matched)
    axes.axhline(1.0, color="black", lw=0.8)
    half = 0.32 / max(len(findings.with_covariance), 2)
    extremes = [1.0]
    for number, e in enumerate(findings.with_covariance):
        look = analysis.looks[design.estimators[e]]
        per_band = [findings.consistency(score, band, e) for band in range(len(design.bands))]
        ratios, lower, upper = np.array([(c.ratio, c.lower, c.upper) for c in per_band]).T
        finite = np.isfinite(ratios)
        places = np.arange(len(per_band))[finite] + _place(findings, number)
        heights = (upper - lower)[finite]
        with style.series(axes, design.estimators[e]):
            axes.bar(places, heights, 2.2 * half, bottom=lower[finite], color="black", alpha=0.25, lw=0)
            axes.plot(places, ratios[finite], look.marker, ms=5.5, color=look.colour, mec="black", mew=0.4)
        extremes += [*ratios[finite], *lower[finite], *upper[finite]]
    name = _SCORES[score]
    axes.set_title(f"{name}: above the bounds over-confident, below cautious", loc="left")
    axes.set_ylabel(f"{name} / expectation")
    if max(extremes) > 4 * max(min(extremes), 1e-12):
        style.logarithmic(axes, min(extremes), max(extremes))
    else:
        room = 0.12 * max(max(extremes) - min(extremes), 1e-3)
        axes.set_ylim(min(extremes) - room, max(extremes) + room)
    axes.grid(axis="y")


def _shares(axes: Axes, analysis: Analysis, findings: Findings) -> None:
    design = findings.design
    style.mark_matched(axes, design.matched)
    axes.axhline(95.0, color="black", lw=0.8)
    for number, e in enumerate(findings.with_covariance):
        look = analysis.looks[design.estimators[e]]
        for score, face in (("nees", look.colour), ("nis", "white")):
            shares = [100 * findings.consistency(score, b, e).inside for b in range(len(design.bands))]
            places = np.arange(len(shares)) + _place(findings, number)
            points = axes.plot(places, shares, look.marker, ms=5.5, mec=look.colour, mfc=face)
            style.mark(points, design.estimators[e], f"{design.estimators[e]}, {_SCORES[score]}")
    axes.set_title("samples inside the 95 % region (filled: NEES, open: NIS)", loc="left")
    axes.set_ylabel("share in %")
    axes.set_ylim(-3, 103)
    axes.grid(axis="y")


def _table(findings: Findings) -> Sheet:
    design = findings.design
    rows = []
    for band, label in enumerate(design.bands):
        for number, e in enumerate(findings.with_covariance):
            high, runs = findings.alone(band, e)
            row = ["" if number else label, design.estimators[e], str(runs)]
            for score in _SCORES:
                c = findings.consistency(score, band, e)
                inside = f"{100 * c.inside:.1f} %" if np.isfinite(c.ratio) else "–"
                row += [style.number(c.ratio), inside, c.verdict]
            rows.append([*row[:5], str(high), *row[5:], str(findings.repairs(band, e))])
    header = ["level", "estimator", "runs", "NEES", "inside", "runs above", "verdict", "NIS", "inside", "verdict"]
    caption = (
        f"NEES and NIS over their expectation, design “{design.name}”. Inside: share of samples in the 95 % region; "
        "runs above: those whose own average NEES is beyond the 95 % bound of a single run; repairs: steps at which a "
        "covariance factor had to be repaired, over all runs."
    )
    return Sheet([*header, "repairs"], rows, caption, left=2)


def blocks_by_drive(findings: Findings) -> list[Block]:
    """Return the median NEES of each drive where plant and belief agree; nothing for a single drive."""
    design, home = findings.design, findings.design.matched
    if home is None or len(design.drives) < 2:
        return []
    nees = design.per_run("nees")[home] / max(design.state_dimension, 1)
    rows = []
    for e in findings.with_covariance:
        values = [nees[e, drive][np.isfinite(nees[e, drive])] for drive in range(len(design.drives))]
        rows.append([design.estimators[e], *(style.number(float(np.median(v))) if v.size else "–" for v in values)])
    caption = (
        f"Median over the runs of a drive of NEES over its expectation, {design.bands[home]}: where the plant is "
        f"{design.matched_is}, a large number is the estimator's own."
    )
    return [Sheet(["estimator", *(words(d) for d in design.drives)], rows, caption)]
