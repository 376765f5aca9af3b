"""Figures of the proof, as SVG in the look of all reports."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap
from matplotlib.lines import Line2D

from bench.attribution.score import CURVE, NOTHING, PARAMETER, UNRESOLVED, Scored
from bench.attribution.tables import by_kind, effects_in, matrix, vehicles, wilson
from harness.models.quantities import words
from harness.reporting import style

Cases = Sequence[Scored]
RIGHT, WRONG = style.looks(["right", "wrong"]).values()
_SHADES = LinearSegmentedColormap.from_list("share", ["#ffffff", RIGHT.colour])
_NO_EFFECT = (PARAMETER, CURVE, NOTHING, UNRESOLVED, "failed")
_GAP_SHOWN = (-0.25, 1.25)
"""Range of the gap closed; what lies outside is drawn at its end."""


_SAYS = {
    "confusion": "What is true against what was claimed first",
    "shares": "Cases answered right, with 95 % intervals",
    "limits": "Size of every effect over the predicted limit, and whether it was found",
    "gap": "Share of the gap between nominal model and oracle that was closed",
}


def figures(scored: Cases) -> dict[str, bytes]:
    """Return all figures by file name; those that would show nothing are left out."""
    drawings: dict[str, Callable[[str, Cases], bytes | None]] = {
        "confusion": confusion,
        "shares": shares,
        "limits": limits,
        "gap": gaps,
    }
    files = {}
    for vehicle in vehicles(scored):
        own = [s for s in scored if s.vehicle == vehicle]
        for name, draw in drawings.items():
            with style.drawing():
                drawn = draw(words(vehicle), own)
            if drawn is not None:
                files[f"{name}-{vehicle}.svg"] = drawn
    return files


def confusion(vehicle: str, scored: Cases) -> bytes | None:
    """Return the matrix of what is true against what was claimed first, all magnitudes together."""
    rows = matrix(scored)
    claims = {claim for row in rows.values() for claim in row}
    columns = [n for n in rows if n in claims]
    columns += sorted(claims - {*columns, *_NO_EFFECT}) + [n for n in _NO_EFFECT if n in claims]
    if not rows:
        return None
    counts = np.array([[row[c] for c in columns] for row in rows.values()])
    fig = style.figure(2.4 + 0.185 * len(rows))
    axes = fig.subplots()
    axes.imshow(counts / counts.sum(axis=1, keepdims=True), cmap=_SHADES, vmin=0, vmax=1.4, aspect="auto")
    right = matrix([s for s in scored if s.right])
    for y, name in enumerate(rows):
        for x, claim in enumerate(columns):
            if counts[y, x]:
                bold = name in right and right[name][claim] > 0
                axes.text(x, y, str(counts[y, x]), ha="center", va="center", weight="bold" if bold else "normal")
    axes.set_xticks(range(len(columns)), [words(c) for c in columns], rotation=90)
    axes.set_yticks(range(len(rows)), [words(r) for r in rows])
    axes.set_xticks(np.arange(len(columns)) - 0.5, minor=True)
    axes.set_yticks(np.arange(len(rows)) - 0.5, minor=True)
    axes.grid(True, which="minor")
    axes.tick_params(which="both", length=0)
    axes.set_ylabel("what is true")
    axes.set_xlabel("what the trace claims first")
    style.head(fig, f"{vehicle.capitalize()}: what is claimed first? Number of cases, right ones bold")
    return style.svg(fig)


def shares(vehicle: str, scored: Cases) -> bytes | None:
    """Return the shares of right answers by kind and magnitude, with their intervals."""
    groups = by_kind(scored)
    fig = style.figure(1.2 + 0.26 * len(groups))
    axes = fig.subplots()
    for y, cases in enumerate(groups.values()):
        right = sum(s.right for s in cases)
        low, high = wilson(right, len(cases))
        axes.plot([100 * low, 100 * high], [y, y], color=RIGHT.line, lw=1.4, solid_capstyle="butt")
        axes.plot(100 * right / len(cases), y, RIGHT.marker, color=RIGHT.line, ms=5)
    axes.set_yticks(range(len(groups)), [f"{name} ({len(cases)})" for name, cases in groups.items()])
    axes.set_ylim(len(groups) - 0.4, -0.6)
    axes.set_xlim(0, 102)
    axes.set_xlabel("cases answered right in %, with 95 % intervals (Wilson)")
    axes.grid(True, axis="x")
    style.head(fig, f"{vehicle.capitalize()}: how often is the answer right?")
    return style.svg(fig)


def limits(vehicle: str, scored: Cases) -> bytes | None:
    """Return every effect's size over the predicted limit, and whether it was found."""
    own = [s for s in scored if s.kind == "effect" and math.isfinite(s.reach) and s.reach > 0]
    names = [n for n in effects_in(own) if any(s.true == (n,) for s in own)]
    if not names:
        return None
    fig = style.figure(1.3 + 0.22 * len(names))
    axes = fig.subplots()
    for look, flag in ((RIGHT, True), (WRONG, False)):
        some = [s for s in own if s.right is flag]
        face = look.line if flag else "none"
        at = [names.index(s.true[0]) for s in some]
        axes.plot([s.reach for s in some], at, look.marker, color=look.line, mfc=face, ms=5, ls="none")
    axes.axvline(1.0, color=style.TRUTH, ls=":", lw=0.9)
    axes.set_xscale("log")
    axes.xaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.set_yticks(range(len(names)), [words(n) for n in names])
    axes.set_ylim(len(names) - 0.4, -0.6)
    axes.set_xlabel("true size over the limit that the score test predicts (dotted: the limit)")
    axes.grid(True, axis="x")
    style.head(fig, f"{vehicle.capitalize()}: from which size on is an effect found?", _answers("found", "not found"))
    return style.svg(fig)


def _answers(right: str, wrong: str) -> list[Line2D]:
    return [
        Line2D([], [], marker=RIGHT.marker, color=RIGHT.line, ls="none", label=right),
        Line2D([], [], marker=WRONG.marker, color=WRONG.line, mfc="none", ls="none", label=wrong),
    ]


def gaps(vehicle: str, scored: Cases) -> bytes | None:
    """Return the share of the gap closed of every case that had one, by kind and magnitude."""
    groups = by_kind([s for s in scored if math.isfinite(s.closed)])
    if not groups:
        return None
    fig = style.figure(1.3 + 0.3 * len(groups))
    axes = fig.subplots()
    for y, cases in enumerate(groups.values()):
        _strip(axes, y, cases)
    axes.axvline(90, color=style.TRUTH, ls=":", lw=0.9)
    axes.set_yticks(range(len(groups)), [f"{name} ({len(cases)})" for name, cases in groups.items()])
    axes.set_ylim(len(groups) - 0.4, -0.6)
    axes.set_xlim(*(100 * v for v in _GAP_SHOWN))
    axes.set_xlabel("gap between nominal model and oracle that was closed in % (dotted: 90)")
    axes.grid(True, axis="x")
    style.head(
        fig,
        f"{vehicle.capitalize()}: how much of the error on held-out drives goes?",
        _answers("answered right", "wrong"),
    )
    return style.svg(fig)


def _strip(axes: Axes, y: int, cases: Cases) -> None:
    """Draw cases side by side on a line, spread a little so that none hides another."""
    spread = np.linspace(-0.25, 0.25, len(cases)) if len(cases) > 1 else [0.0]
    for dy, s in zip(spread, cases, strict=True):
        look = RIGHT if s.right else WRONG
        face = look.line if s.right else "none"
        at = 100 * float(np.clip(s.closed, *_GAP_SHOWN))
        axes.plot(at, y + dy, look.marker, color=look.line, mfc=face, ms=4, clip_on=False)


def caption(file: str) -> str:
    """Return what a figure shows."""
    name, _, vehicle = file.removesuffix(".svg").partition("-")
    return f"{_SAYS[name]}: {words(vehicle)}"
