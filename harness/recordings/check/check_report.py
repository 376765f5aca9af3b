"""Console output and report of ``harness check``: the answer first, then every comparison, the axles and the signals.

Its figures show the signals over time, both sides of each comparison, and the curves of the axles.
"""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from rich.console import Console
from rich.table import Table
from rich.text import Text

from harness.common.arrays import Floats
from harness.common.files import json_text, write_files
from harness.common.series import packed, thinned
from harness.models.quantities import print_unit, quantity, words
from harness.models.signals import TRUTH
from harness.recordings.check import remedy
from harness.recordings.check.axle_curves import AxleCurve
from harness.recordings.check.run import CheckResult
from harness.recordings.motion.consistency import DISAGREES, in_report_unit
from harness.recordings.motion.pair_fit import Agreement
from harness.recordings.read.span import named
from harness.reporting import style
from harness.reporting.document import (
    Block,
    Bullets,
    Listing,
    Picture,
    Prose,
    Report,
    Section,
    Sheet,
    plain,
)
from harness.reporting.style import number

_PER_FIGURE = 6
_TALLEST = 4.7
"""Inches of the panels on the first page, below the findings."""
_BINS = 750
"""Parts of the time axis of which the figure of a signal keeps the extremes."""
_EXCERPT = 30.0
"""s of a comparison that are shown: those with most going on."""
_MEASURED, _COMPUTED = "#0072B2", "#D55E00"
_DOTS = 3000


def signal_figures(recording: xr.Dataset) -> list[Picture]:
    """Draw every signal over time, gaps shaded; six panels to a figure."""
    names = [str(n) for n in recording.data_vars]
    chunks = [names[k : k + _PER_FIGURE] for k in range(0, len(names), _PER_FIGURE)]
    return [_signal_figure(recording, chunk, n + 1, len(chunks)) for n, chunk in enumerate(chunks)]


def _signal_figure(recording: xr.Dataset, names: Sequence[str], which: int, count: int) -> Picture:
    time = recording["time"].values
    part = f" ({which} of {count})" if count > 1 else ""
    with style.drawing():
        fig = style.figure(0.9 + 1.1 * len(names))
        panels = fig.subplots(len(names), 1, sharex=True, squeeze=False)[:, 0]
        gaps = False
        for axes, name in zip(panels, names, strict=True):
            shown = quantity(name.removeprefix(TRUTH))
            values = recording[name].values * shown.scale
            rows = thinned([values], 0, len(time), _BINS)
            axes.plot(time[rows], values[rows], color=_MEASURED, lw=0.7)
            gaps |= _shade_gaps(axes, time, values)
            axes.set_ylabel(shown.unit or "–")
            axes.set_title(words(name), loc="left")
            axes.grid(axis="y")
            axes.margins(x=0)
        panels[-1].set_xlabel("time in s")
        handles = [Patch(facecolor=style.SHADE, label="no samples")] if gaps else []
        style.head(fig, f"What was recorded?{part}", handles)
        image = style.svg(fig)
    return Picture(image, f"Signals of the recording{part}, each on the common time base.", f"Signals over time{part}")


def _shade_gaps(axes: Axes, time: Floats, values: Floats) -> bool:
    """Shade where samples are missing; return whether any are."""
    missing = np.concatenate([[False], ~np.isfinite(values), [False]])
    edges = np.flatnonzero(np.diff(missing.astype(int)))
    for a, b in edges.reshape(-1, 2):
        axes.axvspan(time[a], time[min(b, len(time) - 1)], color=style.SHADE, lw=0, zorder=0)
    return edges.size > 0


def comparison_figures(fits: Sequence[Agreement]) -> list[Picture]:
    """Draw both sides of each exact comparison over its half minute of largest variance, those that disagree first."""
    exact = sorted((fit for fit in fits if fit.relation.exact), key=lambda fit: fit.verdict != DISAGREES)
    chunks = [exact[k : k + _PER_FIGURE] for k in range(0, len(exact), _PER_FIGURE)]
    return [_comparisons(chunk) for chunk in chunks]


def _comparisons(fits: Sequence[Agreement]) -> Picture:
    with style.drawing():
        fig = style.figure(0.9 + min(1.05 * len(fits), _TALLEST))
        panels = fig.subplots(len(fits), 1, squeeze=False)[:, 0]
        for axes, fit in zip(panels, fits, strict=True):
            scale, unit = in_report_unit(fit, 1.0)
            rows, step = _liveliest(fit), fit.step
            time = np.arange(len(fit.measured))[rows] * step
            axes.plot(time, fit.computed[rows] * scale, color=_COMPUTED, lw=1.6, alpha=0.9)
            axes.plot(time, fit.measured[rows] * scale, color=_MEASURED, lw=0.8)
            axes.set_ylabel(print_unit(unit))
            verdict = ", ".join(fit.reasons) if fit.verdict == DISAGREES else f"R² {fit.explained:.3f}"
            axes.set_title(f"{words(fit.relation.signal)} and {fit.relation.formula}: {verdict}", loc="left")
            axes.grid(axis="y")
            axes.margins(x=0)
        panels[-1].set_xlabel("time in s")
        handles = [
            Line2D([], [], color=_MEASURED, lw=0.8, label="measured"),
            Line2D([], [], color=_COMPUTED, lw=1.6, label="computed from the other signals"),
        ]
        style.head(fig, "Do the signals agree with each other?", handles)
        image = style.svg(fig)
    caption = "Both sides of each comparison, smoothed alike, over the 30 s in which the computed one varies most."
    return Picture(image, caption, "Measured and computed signals over time")


def _liveliest(fit: Agreement) -> slice:
    """Return the stretch in which the computed side varies most."""
    length = min(int(_EXCERPT / fit.step), len(fit.computed))
    starts = range(0, len(fit.computed) - length + 1, max(length // 4, 1))
    variation = [np.nansum(np.abs(np.diff(fit.computed[a : a + length]))) for a in starts]
    first = list(starts)[int(np.argmax(variation))]
    return slice(first, first + length)


def axle_figure(
    curves: Sequence[AxleCurve], line: str = "slope up to 0.4", title: str = "How stiff are the axles?"
) -> Picture:
    """Draw lateral force over load against slip angle for each axle, and a line through its beginning (3.16)."""
    with style.drawing():
        fig = style.figure(0.9 + 2.9 * len(curves))
        panels = fig.subplots(len(curves), 1, squeeze=False)[:, 0]
        for axes, axle in zip(panels, curves, strict=True):
            rows = np.flatnonzero(np.isfinite(axle.slip) & np.isfinite(axle.share))
            few = rows[:: max(len(rows) // _DOTS, 1)]
            axes.plot(np.degrees(axle.slip[few]), axle.share[few], ".", ms=2, color=_MEASURED, alpha=0.4, mew=0)
            if axle.slope is not None and len(few):
                reach = np.nanmax(np.abs(axle.share[few]))
                ends = min(0.4, reach) * np.array([-1.0, 1.0])
                axes.plot(np.degrees(ends / axle.slope.value + axle.slope.offset), ends, color=_COMPUTED, lw=1.6)
            axes.set_ylabel("lateral force over load")
            axes.set_xlabel("slip angle in °")
            axes.set_title(f"{axle.name} axle", loc="left")
            axes.grid()
        handles = [
            Line2D([], [], ls="", marker=".", color=_MEASURED, label="from the measured motion"),
            Line2D([], [], color=_COMPUTED, lw=1.6, label=line),
        ]
        style.head(fig, title, handles)
        image = style.svg(fig)
    caption = (
        "Axle forces from the balance of forces and moments, slip angles from the velocities (Sun 2015, figure 3.16)."
    )
    return Picture(image, caption, "Lateral force over load against slip angle, one panel per axle")


MAP = "mended.toml"
"""File next to the report with the whole map as it should be."""

RECORD, SIGNALS_FILE = "check.json", "signals.npz"
"""Files next to the report with what was found, and the signals and both sides of every comparison over time."""


def _overview(recording: xr.Dataset) -> str:
    """Return the size of a recording in words."""
    time = recording["time"].values
    step = float(time[1] - time[0])
    return f"{len(recording.data_vars)} signals over {time[-1]:.2f} s at {1 / step:.6g} Hz, {len(time)} samples"


def _read(recording: xr.Dataset) -> str:
    """Return the file, or part of one, and the title of the channel map: that is no recording's name."""
    title = recording.attrs["title"]
    return f"{named(recording)}: {_overview(recording)}" + (f"; channel map: {title}" if title else "")


CONTENT = ("signal", "channel", "unit", "new at", "smallest", "largest", "missing", "longest gap", "delay")


def content_rows(recording: xr.Dataset) -> list[list[str]]:
    """Return a row per signal, in the units of reports, in the order of ``CONTENT``."""
    rows = []
    for name, signal in recording.data_vars.items():
        shown = quantity(str(name).removeprefix(TRUTH))
        values, about = signal.values * shown.scale, signal.attrs
        finite = values[np.isfinite(values)]
        delay = f"{number(about.get('delay', 0.0) * 1e3)} ms" if about.get("delay") else "–"
        if about.get("delay_std"):
            delay = f"{about['delay'] * 1e3:.1f} ± {about['delay_std'] * 1e3:.1f} ms"
        rows.append(
            [
                words(str(name)),
                str(about.get("channel", "derived")),
                shown.unit or "–",
                f"{about['rate']:.4g} Hz",
                number(finite.min()) if finite.size else "–",
                number(finite.max()) if finite.size else "–",
                f"{100 * about.get('missing_share', 1 - finite.size / values.size):.2f} %",
                f"{about['longest_gap']:.3g} s" if about.get("gaps") else "–",
                delay,
            ]
        )
    return rows


AGREEMENT = ("signal", "against", "verdict", "slope", "offset", "delay", "lever arm", "R²")


def agreement_rows(fits: tuple[Agreement, ...]) -> list[list[str]]:
    """Return a row per comparison in the order of ``AGREEMENT``; values with one standard error."""
    rows = []
    for fit in fits:
        offset, unit = in_report_unit(fit, fit.offset)
        spread, _ = in_report_unit(fit, fit.offset_std)
        exact = fit.relation.exact and np.isfinite(fit.delay)
        rows.append(
            [
                words(fit.relation.signal),
                fit.relation.formula,
                fit.verdict,
                f"{fit.slope:.4g} ± {fit.slope_std:.1g}" if np.isfinite(fit.slope) else "–",
                f"{number(offset, 2)} ± {number(spread, 1)} {print_unit(unit)}" if np.isfinite(fit.offset) else "–",
                f"{fit.delay * 1e3:.1f} ± {fit.delay_std * 1e3:.1f} ms" if exact else "too calm" if fit.calm else "–",
                f"{fit.arm:.2f} ± {fit.arm_std:.2f} m" if np.isfinite(fit.arm) else "–",
                f"{fit.explained:.3f}" if np.isfinite(fit.explained) else "–",
            ]
        )
    return rows


def print_findings(result: CheckResult, console: Console) -> None:
    """Print what the recording holds, how its signals agree, what is wrong, and the lines that mend the map."""
    console.print(Text(_read(result.recording), style="bold"))
    tables = ((CONTENT, content_rows(result.recording)), (AGREEMENT, agreement_rows(result.fits)))
    for header, rows in tables:
        if rows:
            table = Table(*header, box=None)
            for row in rows:
                table.add_row(*(Text(cell) for cell in row))
            console.print(table)
            console.print()
    for axle in result.axles:
        console.print(Text(_axle_sentence(axle)), soft_wrap=True)
    first, *rest = result.sentences
    agreed = not result.findings and bool(result.fits)
    console.print(Text(first, style="green" if agreed else "yellow"), soft_wrap=True)
    for warning in result.warnings:
        console.print(Text(f"warning: {warning}", style="yellow"), soft_wrap=True)
    if result.remedy is not None:
        console.print(Text("\n".join((*rest, *result.remedy.lines))), soft_wrap=True)


def _axle_sentence(axle: AxleCurve) -> str:
    if axle.slope is None:
        return (
            f"{axle.name} axle: no line through lateral force over slip angle; check signs, offsets and the point "
            "where the lateral velocity is measured"
        )
    return (
        f"{axle.name} axle: lateral force over load rises by {axle.slope.value:.2f} per rad, through zero at "
        f"{np.degrees(axle.slope.offset):.2f}° (correlation {axle.slope.correlation:.3f}, {axle.slope.samples} samples)"
    )


def report(result: CheckResult) -> Report:
    """Return the report."""
    sections = [
        Section(lambda: _finding_blocks(result), "What was found?", headed=False),
        Section(lambda: _comparison_blocks(result), "Do the signals agree?", headed=False),
        Section(lambda: _axle_blocks(result), "What do the axles do?"),
        Section(lambda: _content_blocks(result), "What the file holds"),
    ]
    return Report(f"Check of {Path(named(result.recording)).name}", sections)


def write_check(result: CheckResult, out: Path) -> list[Path]:
    """Write ``check.html``, ``check.pdf``, ``check.json`` and ``signals.npz``, and the mended map where there is one.

    Returns:
        The files written.

    Raises:
        UserError: If the folder cannot be written.
    """
    written = report(result).write(out, "check")
    written += write_files(out, {RECORD: json_text(_record(result)), SIGNALS_FILE: _over_time(result)})
    if result.remedy is not None:
        written += write_files(out, {MAP: remedy.map_text(result.remedy.content)})
    return written


def _record(result: CheckResult) -> dict[str, Any]:
    """Return ``check.json``: what was found in words, the signals each of it concerns, and the comparisons."""
    attrs = result.recording.attrs
    return {
        "title": Path(named(result.recording)).name,
        "read": _overview(result.recording),
        "answer": result.sentences,
        "warnings": [str(w) for w in attrs["warnings"]],
        "findings": [
            {"kind": f.kind, "signals": list(f.signals), "words": f.words, "evidence": f.evidence, "mends": f.mends}
            | {k: v if np.isfinite(v) else None for k, v in (("value", f.value), ("std", f.std))}
            for f in result.findings
        ],
        "mended": [] if result.remedy is None else list(result.remedy.lines),
        "comparisons": [_compared(fit) for fit in result.fits],
    }


def _compared(fit: Agreement) -> dict[str, Any]:
    """Return a comparison; slope, offset and delay as ``Agreement`` has them, in the unit that is compared."""
    scale, unit = in_report_unit(fit, 1.0)
    values = {name: getattr(fit, name) for name in ("slope", "offset", "delay", "explained")}
    return {
        "signal": fit.relation.signal,
        "signals": list(fit.relation.signals),
        "name": fit.name,
        "verdict": fit.verdict,
        "reasons": list(fit.reasons),
        "exact": fit.relation.exact,
        "unit": unit,
        "scale": float(scale),
        **{name: float(value) if np.isfinite(value) else None for name, value in values.items()},
    }


def _over_time(result: CheckResult) -> bytes:
    """Return ``signals.npz``: series ``recording`` with all signals, SI, and one for each comparison by its number."""
    recording = result.recording
    time = recording["time"].values.astype(float)
    signals = {str(n): v.values.astype(float) for n, v in recording.data_vars.items() if v.dims == ("time",)}
    series = {"recording": {"time": time, **signals}}
    for i, fit in enumerate(result.fits):
        if len(fit.measured) == len(time):
            series[f"comparison {i}"] = {"time": time, "measured": fit.measured, "computed": fit.computed}
    return packed(series)


def _finding_blocks(result: CheckResult) -> list[Block]:
    attrs, warnings = result.recording.attrs, result.warnings
    first, *rest = result.sentences
    read = plain(f"{_read(result.recording)}. {attrs['source']}")
    blocks: list[Block] = [Prose(read), Prose(plain(first))]
    if warnings:
        blocks.append(Bullets([plain(w) for w in warnings]))
    if result.remedy is not None:
        blocks += [Prose(plain(" ".join(rest))), Listing("\n".join(result.remedy.lines))]
    return blocks


def _comparison_blocks(result: CheckResult) -> list[Block]:
    if not result.fits:
        return []
    rows = agreement_rows(result.fits)
    return [*comparison_figures(result.fits), Sheet(AGREEMENT, rows, _AGREEMENT_CAPTION, left=3)]


def _axle_blocks(result: CheckResult) -> list[Block]:
    if not result.axles:
        return []
    sentences = Bullets([plain(_axle_sentence(axle)) for axle in result.axles])
    return [sentences, axle_figure(result.axles)]


def _content_blocks(result: CheckResult) -> list[Block]:
    rows = content_rows(result.recording)
    sheet = Sheet(CONTENT, rows, _CONTENT_CAPTION, left=3)
    return [*signal_figures(result.recording), sheet]


_AGREEMENT_CAPTION = (
    "Each signal, explained by what kinematics makes of the others: slope, offset, delay (positive: the signal is "
    "late) and the lever arm between the sensors, with one standard error."
)
_CONTENT_CAPTION = (
    "Signals on the common time base; new at: how often the channel delivered a new value; missing: share of what it "
    "should have delivered in the file, before short gaps are bridged."
)
