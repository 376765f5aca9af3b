"""``harness check``: what a recording holds, whether its signals agree, and pictures of both."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import xarray as xr
from rich.console import Console
from rich.table import Table
from rich.text import Text

from harness.config.parameter_set import load_set
from harness.models.quantities import print_unit, quantity, words
from harness.models.signals import TRUTH
from harness.recordings import check_figures
from harness.recordings.axle_curves import Axle, axles_of, signals_of
from harness.recordings.consistency import Agreement, check, in_report_unit
from harness.recordings.load import load_recording
from harness.reporting.document import (
    Block,
    Bullets,
    Document,
    Heading,
    Prose,
    Section,
    Sheet,
    plain,
    write,
)
from harness.reporting.style import number


@dataclass(frozen=True)
class Findings:
    """What a check found.

    Attributes:
        recording: As ``load_recording`` returns it.
        fits: Comparisons of signals with what the others make of them.
        axles: Lateral force over load against slip angle, if the parameters of the car were given.
    """

    recording: xr.Dataset
    fits: list[Agreement]
    axles: list[Axle]

    @property
    def warnings(self) -> list[str]:
        """All irregularities, with the evidence."""
        return [*self.recording.attrs["warnings"], *(finding for fit in self.fits for finding in fit.findings)]


def check_recording(file: str | Path, channels: Path | None = None, parameters: str | None = None) -> Findings:
    """Read a recording and compare its signals with each other.

    Args:
        file: Recording.
        channels: Channel map, if its columns are no signals in SI units.
        parameters: Parameter set or parameter file of a car, for the curves of its axles.

    Raises:
        UserError: If anything cannot be read, or the axle curves lack a signal or parameter.
        ModelError: If there is no such parameter set.
    """
    recording = load_recording(file, channels)
    axles = []
    if parameters is not None:
        values = load_set(parameters, Path(), "--parameters").values
        axles = axles_of([recording], values, f"--parameters {parameters}")
    return Findings(recording, agreement(recording), axles)


def agreement(recording: xr.Dataset) -> list[Agreement]:
    """Compare the signals of a recording with what kinematics makes of the others; derived ones need no check."""
    signals = signals_of(recording)
    derived = [n for n in signals if recording[n].attrs["derived"]]
    return check(signals, float(recording["time"][1] - recording["time"][0]), derived)


def _overview(recording: xr.Dataset) -> str:
    """Say in one sentence what was read."""
    time = recording["time"].values
    step = float(time[1] - time[0])
    return f"{len(recording.data_vars)} signals over {time[-1]:.2f} s at {1 / step:.6g} Hz, {len(time)} samples"


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
                f"{100 * (1 - known.size / values.size):.2f} %",
                f"{about['longest_gap']:.3g} s" if about.get("gaps") else "–",
                delay,
            ]
        )
    return rows


AGREEMENT = ("signal", "against", "slope", "offset", "delay", "lever arm", "R²")


def agreement_rows(fits: list[Agreement]) -> list[list[str]]:
    """Return a row per comparison in the order of ``AGREEMENT``; values with one standard error."""
    rows = []
    for fit in fits:
        offset, unit = in_report_unit(fit, fit.offset)
        spread, _ = in_report_unit(fit, fit.offset_std)
        exact = fit.relation.exact
        rows.append(
            [
                words(fit.relation.signal),
                fit.relation.formula,
                "positive" if fit.relation.sign_only and fit.slope > 0 else f"{fit.slope:.3f} ± {fit.slope_std:.3f}",
                f"{number(offset, 2)} ± {number(spread, 1)} {print_unit(unit)}" if exact else "–",
                f"{round(fit.delay * 1e3)} ± {fit.delay_std * 1e3:.0f} ms" if exact else "–",
                f"{fit.arm:.2f} ± {fit.arm_std:.2f} m" if np.isfinite(fit.arm) else "–",
                f"{fit.explained:.3f}",
            ]
        )
    return rows


def print_findings(findings: Findings, console: Console) -> None:
    """Print what the recording holds, how its signals agree, and every warning."""
    attrs = findings.recording.attrs
    console.print(Text(f"{attrs['title'] or attrs['file']}: {_overview(findings.recording)}", style="bold"))
    tables = ((CONTENT, content_rows(findings.recording)), (AGREEMENT, agreement_rows(findings.fits)))
    for header, rows in tables:
        if rows:
            table = Table(*header, box=None)
            for row in rows:
                table.add_row(*row)
            console.print(table)
            console.print()
    for axle in findings.axles:
        console.print(Text(_axle_sentence(axle)), soft_wrap=True)
    for warning in findings.warnings:
        console.print(Text(f"warning: {warning}", style="yellow"), soft_wrap=True)
    if not findings.warnings:
        console.print(Text("no irregularity was found", style="green"))


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
    """Write ``check.html`` and ``check.pdf``.

    Returns:
        The files written.

    Raises:
        UserError: If the folder cannot be written.
    """
    attrs = findings.recording.attrs
    sections = [
        Section(lambda: _found(findings), "What was found?"),
        Section(lambda: _agreement(findings), "Do the signals agree?"),
        Section(lambda: _axles(findings), "What do the axles do?"),
        Section(lambda: _content(findings), "What the file holds"),
    ]
    return write(Document(f"Check of {attrs['title'] or Path(attrs['file']).name}", sections), out, "check")


def _found(findings: Findings) -> list[Block]:
    attrs, warnings = findings.recording.attrs, findings.warnings
    read = Prose(plain(f"{attrs['file']}: {_overview(findings.recording)}.") + (plain(f" {attrs['source']}")))
    if warnings:
        return [read, Bullets([plain(w) for w in warnings])]
    return [
        read,
        Prose(plain("No irregularity was found: no gaps, spikes or repeated samples, and the signals agree.")),
    ]


def _agreement(findings: Findings) -> list[Block]:
    if not findings.fits:
        return []
    rows = agreement_rows(findings.fits)
    return [*check_figures.agreement(findings.fits), Sheet(AGREEMENT, rows, _AGREEMENT_CAPTION, left=2)]


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
_CONTENT_CAPTION = "Signals on the common time base; new at: how often the channel delivered a new value."
