"""Figures of the box; each returns SVG."""

from __future__ import annotations

import textwrap
from collections.abc import Sequence

import numpy as np
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from harness.reporting import style
from reproductions.box.analysis import Survival
from reproductions.box.evidence import IN_BOX, PUBLISHED, PointEvidence, PointResults
from reproductions.box.factors import FACTORS
from reproductions.box.points import Point
from reproductions.box.studies import EKF, NARX, UKF
from reproductions.campaign.claims import ANGLE, FORCE, MEDIANS

BLUE, ORANGE, GREEN = "#0072B2", "#D55E00", "#009E73"
READINGS = ((1e-5, "of the wheel"), (5.3e-3, "of the road wheels"))
"""Variances of the steering wheel in rad² per step, by what (5.3) is read as."""


def shares(survivals: Sequence[Survival]) -> bytes:
    """Draw the share of the box in which each finding holds."""
    with style.drawing():
        fig = style.figure(0.42 * len(survivals) + 1.4)
        axes = fig.subplots()
        for k, survival in enumerate(survivals):
            for value, shift, colour, marker in (
                (survival.share, -0.16, BLUE, "o"),
                (survival.filters, 0.16, ORANGE, "s"),
            ):
                axes.hlines(k + shift, value.lower, value.upper, color=colour, lw=2.2)
                axes.plot(value.value, k + shift, marker, color=colour, ms=5)
        axes.set_yticks(
            range(len(survivals)), [textwrap.fill(f"{k}. {c.text}", 62) for k, c in enumerate(IN_BOX, 1)], size=7
        )
        axes.invert_yaxis()
        axes.set_xlim(-0.02, 1.02)
        axes.set_xlabel("share of the box in which the finding holds")
        axes.xaxis.set_major_formatter(lambda value, _: f"{100 * value:.0f} %")
        axes.grid(axis="x")
        handles = [
            Line2D([], [], color=BLUE, marker="o", lw=2.2, label="all estimators, 95 % interval"),
            Line2D([], [], color=ORANGE, marker="s", lw=2.2, label="without the network, 95 % interval"),
        ]
        style.head(fig, "Which findings survive what the dissertation does not publish?", handles)
        return style.svg(fig)


def medians(nearest: Point, trained: Point) -> bytes:
    """Draw the box plots of the ideal case beside the published medians (Bild 5.6).

    Args:
        nearest: With the network of the project.
        trained: The same point with the network that was trained there.
    """
    looks = style.looks([EKF, UKF, NARX])
    shown = (
        ("EKF", EKF, nearest),
        ("UKF", UKF, nearest),
        ("network\nof the project", NARX, nearest),
        ("network\ntrained there", NARX, trained),
    )
    with style.drawing():
        fig = style.figure(5.2)
        for axes, target, label in zip(
            fig.subplots(2, 1, sharex=True),
            (FORCE, ANGLE),
            ("force of axle 21 in kN", "articulation angle in °"),
            strict=True,
        ):
            for place, (_, estimator, point) in enumerate(shown):
                errors = PointResults(point).errors("ideal", None, estimator, target)
                box = axes.boxplot(errors[np.isfinite(errors)], positions=[place], widths=0.5, patch_artist=True,
                                   whis=(0, 100), medianprops={"color": "black"})  # fmt: skip
                look = looks[estimator]
                box["boxes"][0].set(facecolor=look.tint, edgecolor=look.line, hatch=look.hatch)
                axes.plot(place, MEDIANS[estimator, target], "D", color="black", ms=6, zorder=5)
            axes.set_xticks(range(len(shown)), [name for name, _, _ in shown])
            axes.tick_params(axis="x", length=0)
            axes.set_ylabel(f"RMSE of the {label}")
            axes.set_ylim(bottom=0)
            axes.grid(axis="y")
        handles = [
            Line2D([], [], color="black", marker="D", ls="", label="median of Bild 5.6"),
            Patch(facecolor="white", edgecolor="black", label="ours: quartiles, median and range"),
        ]
        style.head(fig, "How near does the ideal case come to Bild 5.6?", handles)
        return style.svg(fig)


def steering(points: Sequence[Point], evidence: Sequence[PointEvidence]) -> bytes:
    """Draw the delay of the input estimate and the distance of the numbers over the variance of the steering wheel."""
    names = [f.name for f in FACTORS]
    column = names.index("steering_variance")
    variance = np.array([FACTORS[column].value(p.place[column]) for p in points])
    delay, off = np.array([p.delay for p in points]), np.array([s.off() for s in evidence])
    with style.drawing():
        fig = style.figure(5.0)
        above, below = fig.subplots(2, 1, sharex=True)
        above.plot(variance, delay, "o", ms=3.5, color=BLUE, alpha=0.7, mew=0)
        published = next(p.theirs for p in PUBLISHED if p.words.startswith("delay"))
        above.axhline(published, color="black", ls="--", lw=1.0)
        above.set_ylabel("delay in s")
        below.plot(variance, off, "o", ms=3.5, color=ORANGE, alpha=0.7, mew=0)
        below.set_ylabel("distance (1: factor of 2)")
        below.set_xlabel("variance of the steering wheel's random walk in rad² per step")
        for axes in (above, below):
            axes.set_xscale("log")
            axes.xaxis.set_major_formatter(lambda value, _: f"{value:.0e}")
            axes.set_ylim(bottom=0)
            axes.grid()
            for (value, _), dashes in zip(READINGS, (":", "-."), strict=True):
                axes.axvline(value, color="0.4", ls=dashes, lw=1.2)
        handles = [
            Line2D([], [], color="black", ls="--", label="0.7 s (5.3)"),
            *(
                Line2D([], [], color="0.4", ls=dashes, label=f"1e-5 rad² {words}")
                for (_, words), dashes in zip(READINGS, (":", "-."), strict=True)
            ),
        ]
        style.head(fig, "Which steering noise goes with the published delay and errors?", handles)
        return style.svg(fig)
