"""The report of ``harness monitor``: the answer in sentences, curves of detection, counts, bounds, and its making."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np
from matplotlib.lines import Line2D

from harness.common.files import write_files
from harness.models.quantities import capital, listed, quantity, words
from harness.remedy.monitor.answer import beyond, limit_of, share, speaks
from harness.remedy.monitor.bounds import independent
from harness.remedy.monitor.counts import Counts, roc
from harness.remedy.monitor.outcome import BLIND, Counted, Level
from harness.reporting import style
from harness.reporting.document import Block, Bullets, Drawing, Listing, Prose, Report, Section, Sheet, plain, strong
from harness.reporting.style import number, percent, span, with_unit
from harness.runner.monitor import REASONS

MONITOR = "monitor.toml"


def report(counted: Counted, command: str) -> Report:
    """Return the report.

    Args:
        counted: The monitor.
        command: The command that is running, for the record.
    """
    estimator = counted.study.estimators[0].name
    sections = [
        Section(lambda: _answer(counted), "Answer"),
        Section(lambda: _counts(counted), "How often is it right?"),
        Section(lambda: _bounds(counted), "What does it compare, and with what?"),
        Section(lambda: _made(counted, command), "How was this made?"),
    ]
    return Report(f"When does {estimator} of study {counted.study.name} say that it is not to be trusted?", sections)


def write_monitor(counted: Counted, out: Path, command: str) -> list[Path]:
    """Write monitor and report into a folder; return the files.

    Raises:
        UserError: If the folder cannot be written to.
    """
    return [*report(counted, command).write(out), *write_files(out, {MONITOR: counted.monitor.text})]


def _answer(counted: Counted) -> list[Block]:
    first, *further = counted.monitor.says
    blocks: list[Block] = (
        [Prose(strong(first)), Bullets([plain(text) for text in further])] if further else [Prose(strong(first))]
    )
    for t, target in enumerate(counted.targets):
        if _drawn(counted, t):
            caption = (
                "Share of the samples in error that have more evidence against the belief than a bound, over the share "
                "of those without where all is as believed, for every bound; point: the bound of the monitor. On the "
                "dashed line evidence says nothing. Whether an alarm follows within some seconds does not count here."
            )
            alt = f"Detection of errors of the {quantity(target).words} over false alarms"
            blocks.append(Drawing(partial(_draw, counted, t), caption, alt))
    return blocks


def _drawn(counted: Counted, t: int) -> list[Level]:
    """Return the levels of a figure: those with errors of the first design that has any."""
    levels = [level for level in counted.levels if speaks(level, t)]
    return [level for level in levels if level.design == levels[0].design]


def _draw(counted: Counted, t: int) -> bytes:
    """Draw a curve for each level."""
    levels = _drawn(counted, t)
    names = [level.label for level in levels]
    looks = style.looks(names)
    with style.drawing():
        fig = style.figure(style.HALF)
        axes = fig.subplots()
        for level, name in zip(levels, names, strict=True):
            false, right = roc(counted.believed[t], level.counts[t])
            at = len(false) // 2  # of the bound: evidence is 1
            look, where = looks[name], level.areas[t]
            text = f"{name}: area {number(where.value, 2)} ({span(where.lower, where.upper)})"
            with style.series(axes, name):
                axes.plot(false, right, color=look.line, ls=look.dashes)
                (point,) = axes.plot(false[at], right[at], marker=look.marker, color=look.face, mec=look.line, ls="")
                style.mark(point, name, text)
        axes.plot([0, 1], [0, 1], color=style.MEASURED, ls=(0, (4, 3)), zorder=0)
        axes.set_xlim(-0.01, 1.01)
        axes.set_ylim(-0.01, 1.01)
        axes.set_xlabel("share of samples without error, as believed")
        axes.set_ylabel("share of samples in error")
        axes.grid()
        handles = [
            Line2D([], [], color=looks[n].line, ls=looks[n].dashes, marker=looks[n].marker, mfc=looks[n].face, label=n)
            for n in names
        ]
        style.head(fig, f"Do the innovations show that {beyond(counted, t)}?", handles)
        return style.svg(fig)


def _counts(counted: Counted) -> list[Block]:
    within = f"{counted.asked.within:g} s"
    header = ["design", "level", "in error", f"said within {within}", "not trusted", "delay", "area",
              "alarm, no error"]  # fmt: skip
    blocks: list[Block] = []
    for t, target in enumerate(counted.targets):
        shown = quantity(target)
        rows = [["–", "as believed, within limits", *_row(counted, counted.kept[t], "–")]] if counted.kept else []
        rows.append(["–", "as believed", *_row(counted, counted.believed[t], "–")])
        for level in counted.levels:
            a = level.areas[t]
            around = (
                f"{number(a.value, 2)} ({number(a.lower, 2)} to {number(a.upper, 2)})" if a.value == a.value else "–"
            )
            rows.append([level.design, level.label, *_row(counted, level.counts[t], around)])
        caption = (
            f"{capital(shown.words)}, of which an error above {limit_of(counted, t)} matters: share of the samples in "
            f"error; of these, at which an alarm stands or begins within {within}, and at which the estimate is not "
            "trusted at once for any reason (level 1 or 2); delay of the first alarm behind the first error, median "
            "over runs; area under the curve with its interval at 95 % (whole runs drawn with replacement); and share "
            "of the samples without error that are in an alarm."
        )
        blocks.append(Sheet(header, rows, caption, left=2))
    blocks.append(_reasons(counted))
    return blocks


def _row(counted: Counted, counts: Counts, around: str) -> list[str]:
    delay = counted.delay(counts)
    warned = counts.warned.sum() / counts.wrong.sum() if counts.wrong.sum() else float("nan")
    shares = [counts.wrong_share, counts.said_share, float(warned)]
    return [*map(share, shares), _delay(delay), around, share(counts.false_share)]


def _delay(seconds: float) -> str:
    return "–" if np.isnan(seconds) else with_unit(seconds, "s") if np.isfinite(seconds) else "never"


def _reasons(counted: Counted) -> Sheet:
    """Return how often each reason was given, as believed and at each level."""
    rows = [
        [design, label, *(percent(share) for share in counts.reasons.sum(axis=0) / max(counts.samples.sum(), 1.0))]
        for design, label, counts in (
            ("–", "as believed", counted.believed[0]),
            *((level.design, level.label, level.counts[0]) for level in counted.levels),
        )
    ]
    meanings = "; ".join(f"{bit}: {text.partition(':')[0]}" for bit, text in REASONS.items())
    return Sheet(["design", "level", *map(str, REASONS)], rows, f"Share of the samples by reason. {meanings}.", left=2)


def _bounds(counted: Counted) -> list[Block]:
    monitor, calibration = counted.monitor, counted.calibrated
    nis, bias = independent(monitor.window, len(monitor.bias), counted.asked.per_hour, monitor.step)
    rows = [
        ["NIS", f"{number(monitor.nis[0])} to {number(monitor.nis[1])}", f"{number(nis[0])} to {number(nis[1])}"],
        *([f"innovation of the {words(n)}", f"± {number(b)}", f"± {number(bias)}"] for n, b in monitor.bias.items()),
    ]
    text = (
        f"Averages over the last {monitor.window} samples, whose weights fall exponentially (Roberts 1959). Windows "
        "overlap and the innovations are not white, so the bounds are not those of independent samples: they are what "
        f"{calibration.alarms} alarms exceed in the {number(calibration.hours)} h of the runs as believed that keep "
        f"the limits, for {number(counted.asked.per_hour)} an hour that are allowed."
    )
    groups = (("", monitor.inputs, ""), ("rate of ", monitor.rates, "/s"), ("measured ", monitor.measurements, ""),
              ("estimated ", monitor.estimates, ""))  # fmt: skip
    ranges = []
    for before, group, behind in groups:
        for name, (low, high) in group.items():
            unit = quantity(name)
            ranges.append(
                [f"{before}{words(name)}", number(low * unit.scale), number(high * unit.scale), unit.unit + behind]
            )
    kept, lost = counted.drives
    never = f" None of {listed(lost)} does." if lost else ""
    envelope = f"Level 1 beyond what was driven as believed in runs that keep the limits: {listed(kept)}.{never}"
    return [
        Prose(plain(text)),
        Sheet(["average", "bounds", "if independent"], rows, "In standard deviations of an average of white noise."),
        Prose(plain(envelope)),
        Sheet(["signal", "from", "to", "unit"], ranges, "The envelope, noise of measurements included."),
    ]


def _made(counted: Counted, command: str) -> list[Block]:
    text = (
        f"{command}. {MONITOR} is the monitor: harness export --monitor prints it beside the estimator. An error shows "
        f"where the area under its curve is {number(BLIND, 2)} or more."
    )
    return [Prose(plain(text)), Listing(counted.study.text.rstrip("\n"), "toml")]
