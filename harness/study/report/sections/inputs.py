"""How much of each estimator's error comes from the noise of its inputs: the same runs with exact ones next to them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from matplotlib.axes import Axes

from harness.common.arrays import Floats
from harness.models.quantities import listed
from harness.reporting import style
from harness.reporting.document import Block, Heading, Picture, Prose, Sheet, plain
from harness.study.report.analysis import Analysis, Findings
from harness.study.report.opening import at
from harness.study.report.sections.boxes import foot, label_levels

_HEIGHT = 1.9
"""Inches of a panel."""

_CAPTION = (
    "Share of the mean square error over all runs of a level that is there with noisy inputs and not with exact ones: "
    "1 − (mean square with exact inputs) / (mean square). Both see the same drives, process and measurement noise. "
    "Interval: 95 %, bootstrap over runs. Below zero the error is smaller with the noise."
)


def blocks(analysis: Analysis) -> list[Block]:
    """Return words, figure and table of every design with the noise of inputs and a level without any."""
    content: list[Block] = []
    for findings in analysis.findings:
        shares = findings.input_shares
        if shares is None:
            continue
        text = " ".join([*_by_target(findings, shares), _EXPLAINED])
        content += [Heading("How much of the error comes from the inputs?"), Prose(plain(text))]
        content += [_picture(analysis, findings, shares), *_tables(findings, shares)]
    return content


_EXPLAINED = (
    "The rest is there with exact inputs too: process noise, measurement noise and what the model does not hold. "
    "Noise that is known to the filter costs twice: the input itself is off, and the filter trusts its model less."
)


def in_short(findings: Findings) -> list[str]:
    """Return one sentence for the answer; nothing where the design does not tell."""
    return [] if findings.input_shares is None else [" ".join(_by_target(findings, findings.input_shares))]


def _by_target(findings: Findings, shares: Floats) -> list[str]:
    """Say for each target what the inputs make up where plant and belief are as stated, and at most."""
    design, sentences = findings.design, []
    home = design.matched
    for t, quantity in enumerate(design.targets):
        finite = np.where(np.isfinite(shares[t, :, :, 0]), shares[t, :, :, 0], -np.inf)
        bands = [b for b in (home, int(finite.max(axis=1).argmax())) if b is not None and np.isfinite(finite[b].max())]
        parts = [f"{_range(design.estimators, shares[t, b])} {at(design, b)}" for b in dict.fromkeys(bands)]
        if parts:
            sentences.append(
                f"Of the mean square error of the {quantity.words}, the noise of the inputs makes up {listed(parts)}."
            )
    return sentences


def _range(names: Sequence[str], shares: Floats) -> str:
    """Return the share of one estimator with its interval, of several the smallest and the largest."""
    value, lower, upper = 100 * shares.T
    least, most = int(np.nanargmin(value)), int(np.nanargmax(value))
    if f"{value[least]:.0f}" == f"{value[most]:.0f}":
        low, high = np.nanmin(lower), np.nanmax(upper)
        return f"{value[most]:.0f} % ({low:.0f} to {high:.0f} %{', with all estimators' if len(names) > 1 else ''})"
    return f"{value[least]:.0f} % ({names[least]}) to {value[most]:.0f} % ({names[most]})"


def _picture(analysis: Analysis, findings: Findings, shares: Floats) -> Picture:
    design, question = findings.design, "How much of the error comes from the inputs?"
    with style.drawing():
        fig = style.figure(0.25 + foot(design) + _HEIGHT * len(design.targets))
        rows = fig.subplots(len(design.targets), 1, sharex=True, squeeze=False)[:, 0]
        for axes, t in zip(rows, range(len(design.targets)), strict=True):
            _panel(axes, analysis, findings, 100 * shares[t])
            axes.set_title(design.targets[t].words, loc="left")
        label_levels(rows[-1], design)
        style.head(fig, question, style.patches(design.estimators, analysis.looks))
        svg = style.svg(fig)
    return Picture(svg, _CAPTION, question)


def _panel(axes: Axes, analysis: Analysis, findings: Findings, percent: Floats) -> None:
    design = findings.design
    style.mark_matched(axes, design.matched)
    axes.axhline(0.0, color="black", lw=0.8)
    width = 0.8 / len(design.estimators)
    for e, name in enumerate(design.estimators):
        look = analysis.looks[name]
        places = np.arange(len(design.bands)) + (e - (len(design.estimators) - 1) / 2) * width
        value, low, high = percent[:, e].T
        axes.bar(places, value, 0.9 * width, facecolor=look.tint, edgecolor=look.line, hatch=look.hatch)
        axes.vlines(places, low, high, color="black", lw=1.2)
    axes.set_ylabel("share of the\nmean square error [%]")
    axes.grid(axis="y")


def _tables(findings: Findings, shares: Floats) -> list[Sheet]:
    design = findings.design
    sheets = []
    for t, quantity in enumerate(design.targets):
        rows = [
            [label, *(_cell(shares[t, b, e]) for e in range(len(design.estimators)))]
            for b, label in enumerate(design.bands)
        ]
        caption = f"Share of the mean square error of the {quantity.words} that comes from the inputs, with interval."
        sheets.append(Sheet(["level", *design.estimators], rows, caption, left=1))
    return sheets


def _cell(share: Floats) -> str:
    value, low, high = 100 * share
    return "–" if not np.isfinite(value) else f"{value:.1f} % ({low:.1f} to {high:.1f})"
