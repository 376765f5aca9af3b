"""The report of ``harness monitor``: the answer in sentences, curves of detection, counts, bounds, and its making."""

from __future__ import annotations

from pathlib import Path

from harness.common.files import write_files
from harness.models.quantities import listed, quantity, words
from harness.remedy.monitor.answer import in_short, valued
from harness.remedy.monitor.bounds import independent
from harness.remedy.monitor.of_study import trust_of
from harness.remedy.monitor.outcome import Counted
from harness.reporting.document import Block, Bullets, Listing, Prose, Report, Section, Sheet, plain, strong
from harness.reporting.style import number, percent
from harness.runner.monitor import REASON_NAMES, REASONS
from harness.study.report.sections.trust import figures, tables
from harness.study.trust_file import BLIND, StudyTrust

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
    first, *further = in_short(counted)
    blocks: list[Block] = [Prose(strong(first)), Bullets([plain(text) for text in further])]
    return [*blocks, *figures(_trust(counted))]


def _trust(counted: Counted) -> StudyTrust:
    return StudyTrust(counted.asked.within, (trust_of(counted),))


def _counts(counted: Counted) -> list[Block]:
    return [*tables(_trust(counted)), _reasons(counted)]


def _reasons(counted: Counted) -> Sheet:
    """Return how often each reason was given, as believed and at each level."""
    rows = [
        [design, label, *(percent(share) for share in counts.reasons.sum(axis=0) / max(counts.samples.sum(), 1.0))]
        for design, label, counts in (
            ("–", "as believed", counted.believed[0]),
            *((each.design, valued(counted.study, each.design, each.label), each.counts[0]) for each in counted.levels),
        )
    ]
    meanings = "; ".join(f"{bit}: {text.partition(':')[0]}" for bit, text in REASONS.items())
    names = [name.lower().replace("nis", "NIS").replace("_", " ") for name in REASON_NAMES]
    caption = f"Share of the samples by reason. Bits of the reasons: {meanings}."
    return Sheet(["design", "level", *names], rows, caption, left=2)


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
    groups = (("", monitor.inputs), ("rate of ", monitor.rates), ("measured ", monitor.measurements),
              ("estimated ", monitor.estimates))  # fmt: skip
    ranges = []
    for before, group in groups:
        for name, (low, high) in group.items():
            shown = quantity(name)
            unit = per_second(shown.unit) if group is monitor.rates else shown.unit
            ranges.append(
                [f"{before}{words(name)}", number(low * shown.scale), number(high * shown.scale), unit or "–"]
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


def per_second(unit: str) -> str:
    """Write a printed unit over a second."""
    for less, more in (("/s²", "/s³"), ("/s", "/s²")):
        if unit.endswith(less):
            return unit.removesuffix(less) + more
    return f"{unit or '1'}/s"


def _made(counted: Counted, command: str) -> list[Block]:
    text = (
        f"{command}. {MONITOR} is the monitor: harness export --monitor prints it with the estimator. An error shows "
        f"where the area under its curve is {number(BLIND, 2)} or more."
    )
    return [Prose(plain(text)), Listing(counted.study.text.rstrip("\n"), "toml")]
