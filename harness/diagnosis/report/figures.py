"""Figures of a trace, as SVG in the look of all reports."""

from __future__ import annotations

import math

import numpy as np

from harness.diagnosis.criteria import BIC_NEEDED
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, CHANNEL_DELAYS, SENSOR_DRIFTS
from harness.diagnosis.selection.acceptance import Round
from harness.models.quantities import words
from harness.reporting import style

SHOWN = 15
"""Hypotheses drawn per round."""


def called(name: str) -> str:
    """Return a hypothesis in words."""
    several = {
        ALL_PARAMETERS: "many parameters at once",
        CHANNEL_DELAYS: "delays of the channels",
        SENSOR_DRIFTS: "drifts of the gyroscopes",
    }
    if name in several:
        return several[name]
    effect, _, place = name.partition("@")
    return f"{words(effect)}, {words(place)}" if place else words(effect)


def ranking(found: Round, number: int) -> bytes:
    """Return the gain of each of the best hypotheses of a round: predicted by the score test, or fitted."""
    shown = sorted(found.candidates, key=lambda c: c.bic, reverse=True)[:SHOWN]
    # Compared with a model that leaves its range every gain is infinite: drawn to the edge.
    end = 2.0 * max([BIC_NEEDED, *(c.bic for c in shown if math.isfinite(c.bic))])
    predicted, fitted = style.looks(["predicted", "fitted"]).values()
    with style.drawing():
        fig = style.figure(1.2 + 0.24 * len(shown))
        axes = fig.subplots()
        at = np.arange(len(shown))[::-1]
        for y, c in zip(at, shown, strict=True):
            look = predicted if c.fitted is None else fitted
            width = min(max(c.bic, 1.0), end)
            axes.barh(y, width, height=0.7, facecolor=look.tint, edgecolor=look.line, hatch=look.hatch)
        axes.axvline(BIC_NEEDED, color=style.TRUTH, ls=":", lw=0.9)
        axes.set_xscale("log")
        axes.set_xlim(1.0, end)
        axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
        axes.set_yticks(at, [called(c.hypothesis.name) for c in shown])
        axes.set_xlabel("gain in BIC (dotted: least gain of an addition)")
        axes.grid(True, axis="x")
        handles = style.patches(["predicted", "fitted"], {"predicted": predicted, "fitted": fitted})
        style.head(fig, f"Round {number}: what explains the fitted drives?", handles)
        return style.svg(fig)
