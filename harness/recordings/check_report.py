"""What ``harness check`` prints and writes: the answer first, then every comparison, the axles and the signals."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import xarray as xr
from rich.console import Console
from rich.table import Table
from rich.text import Text

from harness.common.files import json_text, write_files
from harness.common.series import packed
from harness.models.quantities import print_unit, quantity, words
from harness.models.signals import TRUTH
from harness.recordings import check_figures, remedy
from harness.recordings.axle_curves import Axle
from harness.recordings.check import Findings
from harness.recordings.consistency import DISAGREES, in_report_unit, verdicts
from harness.recordings.pair_fit import Agreement
from harness.recordings.span import named
from harness.reporting.document import (
    Block,
    Bullets,
    Document,
    Heading,
    Listing,
    Prose,
    Section,
    Sheet,
    plain,
    write,
)
from harness.reporting.style import number

MAP = "mended.toml"
"""File beside the report with the whole map as it should be."""

RECORD, SIGNALS_FILE = "check.json", "signals.npz"
"""Files beside the report with what was found, and the signals and both sides of every comparison over time."""


def _overview(recording: xr.Dataset) -> str:
    """Say in a few words what was read."""
    time = recording["time"].values
    step = float(time[1] - time[0])
    return f"{len(recording.data_vars)} signals over {time[-1]:.2f} s at {1 / step:.6g} Hz, {len(time)} samples"


def _read(recording: xr.Dataset) -> str:
    """Say which file, or part of one, was read, and by which map: the title of a map is no recording's name."""
    title = recording.attrs["title"]
    return f"{named(recording)}: {_overview(recording)}" + (f"; channel map: {title}" if title else "")


CONTENT = ("signal", "channel", "unit", "new at", "smallest", "largest", "missing", "longest gap", "delay")


def content_rows(recording: xr.Dataset) -> list[list[str]]:
    """Return a row per signal, in the units of reports, in the order of ``CONTENT``."""
    rows = []
    for name, signal in recording.data_vars.items():
        shown = quantity(str(name).removeprefix(TRUTH))
        values, about = signal.values * shown.scale, signal.attrs
        known = values[np.isfinite(values)]
        delay = f"{number(about.get('delay', 0.0) * 1e3)} ms" if about.get("delay") else "–"
        if about.get("delay_std"):
            delay = f"{about['delay'] * 1e3:.1f} ± {about['delay_std'] * 1e3:.1f} ms"
        rows.append(
            [
                words(str(name)),
                str(about.get("channel", "derived")),
                shown.unit or "–",
                f"{about['rate']:.4g} Hz",
                number(known.min()) if known.size else "–",
                number(known.max()) if known.size else "–",
                f"{100 * about.get('missing_share', 1 - known.size / values.size):.2f} %",
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


def answer(findings: Findings) -> list[str]:
    """Return the answer in sentences: what was compared, what is wrong, and what the mended map comes to."""
    said = [f"{findings.summary}."]
    if findings.remedy is not None:
        after = findings.remedy.fits
        wrong = sum(f.verdict == DISAGREES for f in after)
        before = any(f.verdict == DISAGREES for f in findings.fits)
        rest = "nothing disagrees any more" if before else "nothing disagrees either"
        if wrong:
            rest = f"{wrong} {'still ' if before else ''}do{'es' if wrong == 1 else ''} not agree"
        said.append(f"With the lines below {rest}: {verdicts(after)}.")
    return said


def print_findings(findings: Findings, console: Console) -> None:
    """Print what the recording holds, how its signals agree, what is wrong, and the lines that mend the map."""
    console.print(Text(_read(findings.recording), style="bold"))
    tables = ((CONTENT, content_rows(findings.recording)), (AGREEMENT, agreement_rows(findings.fits)))
    for header, rows in tables:
        if rows:
            table = Table(*header, box=None)
            for row in rows:
                table.add_row(*(Text(cell) for cell in row))
            console.print(table)
            console.print()
    for axle in findings.axles:
        console.print(Text(_axle_sentence(axle)), soft_wrap=True)
    first, *rest = answer(findings)
    agreed = not findings.found and bool(findings.fits)
    console.print(Text(first, style="green" if agreed else "yellow"), soft_wrap=True)
    for warning in findings.warnings:
        console.print(Text(f"warning: {warning}", style="yellow"), soft_wrap=True)
    if findings.remedy is not None:
        console.print(Text("\n".join((*rest, *findings.remedy.lines))), soft_wrap=True)


def _axle_sentence(axle: Axle) -> str:
    if axle.slope is None:
        return (
            f"{axle.name} axle: no line through lateral force over slip angle; check signs, offsets and the point "
            "where the lateral velocity is measured"
        )
    return (
        f"{axle.name} axle: lateral force over load rises by {axle.slope.value:.2f} per rad, through zero at "
        f"{np.degrees(axle.slope.offset):.2f}° (correlation {axle.slope.correlation:.3f}, {axle.slope.samples} samples)"
    )


def write_check(findings: Findings, out: Path) -> list[Path]:
    """Write ``check.html``, ``check.pdf``, ``check.json`` and ``signals.npz``, and the mended map where there is one.

    Returns:
        The files written.

    Raises:
        UserError: If the folder cannot be written.
    """
    sections = [
        Section(lambda: _found(findings), "What was found?"),
        Section(lambda: _agreement(findings), "Do the signals agree?"),
        Section(lambda: _axles(findings), "What do the axles do?"),
        Section(lambda: _content(findings), "What the file holds"),
    ]
    written = write(Document(f"Check of {Path(named(findings.recording)).name}", sections), out, "check")
    written += write_files(out, {RECORD: json_text(_record(findings)), SIGNALS_FILE: _over_time(findings)})
    if findings.remedy is not None:
        written += write_files(out, {MAP: remedy.map_text(findings.remedy.content)})
    return written


def _record(findings: Findings) -> dict[str, Any]:
    """Return ``check.json``: what was found in words, the signals each of it concerns, and the comparisons."""
    attrs = findings.recording.attrs
    return {
        "title": Path(named(findings.recording)).name,
        "read": _overview(findings.recording),
        "answer": [str(line) for line in answer(findings)],
        "warnings": [str(w) for w in attrs["warnings"]],
        "findings": [
            {"kind": f.kind, "signals": list(f.signals), "words": f.words, "evidence": f.evidence, "mends": f.mends}
            | {k: v if np.isfinite(v) else None for k, v in (("value", f.value), ("std", f.std))}
            for f in findings.found
        ],
        "mended": [] if findings.remedy is None else list(findings.remedy.lines),
        "comparisons": [_compared(fit) for fit in findings.fits],
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


def _over_time(findings: Findings) -> bytes:
    """Return ``signals.npz``: series ``recording`` with all signals, SI, and one for each comparison by its number."""
    recording = findings.recording
    time = recording["time"].values.astype(float)
    signals = {str(n): v.values.astype(float) for n, v in recording.data_vars.items() if v.dims == ("time",)}
    found = {"recording": {"time": time, **signals}}
    for i, fit in enumerate(findings.fits):
        if len(fit.measured) == len(time):
            found[f"comparison {i}"] = {"time": time, "measured": fit.measured, "computed": fit.computed}
    return packed(found)


def _found(findings: Findings) -> list[Block]:
    attrs, warnings = findings.recording.attrs, findings.warnings
    first, *rest = answer(findings)
    read = plain(f"{_read(findings.recording)}. {attrs['source']}")
    blocks: list[Block] = [Prose(read), Prose(plain(first))]
    if warnings:
        blocks.append(Bullets([plain(w) for w in warnings]))
    if findings.remedy is not None:
        blocks += [Prose(plain(" ".join(rest))), Listing("\n".join(findings.remedy.lines))]
    return blocks


def _agreement(findings: Findings) -> list[Block]:
    if not findings.fits:
        return []
    rows = agreement_rows(findings.fits)
    return [*check_figures.agreement(findings.fits), Sheet(AGREEMENT, rows, _AGREEMENT_CAPTION, left=3)]


def _axles(findings: Findings) -> list[Block]:
    if not findings.axles:
        return []
    sentences = Bullets([plain(_axle_sentence(axle)) for axle in findings.axles])
    return [Heading("What do the axles do?"), sentences, check_figures.axles(findings.axles)]


def _content(findings: Findings) -> list[Block]:
    rows = content_rows(findings.recording)
    sheet = Sheet(CONTENT, rows, _CONTENT_CAPTION, left=3)
    return [Heading("What the file holds"), *check_figures.signals(findings.recording), sheet]


_AGREEMENT_CAPTION = (
    "Each signal, explained by what kinematics makes of the others: slope, offset, delay (positive: the signal is "
    "late) and the lever arm between the sensors, with one standard error."
)
_CONTENT_CAPTION = (
    "Signals on the common time base; new at: how often the channel delivered a new value; missing: share of what it "
    "should have delivered in the file, before short gaps are bridged."
)
