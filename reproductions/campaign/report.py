"""The report of the campaign: the answer, the findings of the dissertation on our data, its figures."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from harness.common.files import write_files
from harness.models.quantities import words
from harness.realtime import report as realtime
from harness.reporting.document import Block, Heading, Linked, Prose, Report, Section, Sheet, plain
from harness.reporting.style import number
from harness.study.report.sections import boxes, drives
from reproductions.campaign import box, on_study, trust
from reproductions.campaign.answer import answer
from reproductions.campaign.claims import ANGLE, FORCE, MEDIANS, Finding, findings
from reproductions.campaign.evidence import Evidence, Verdict
from reproductions.campaign.results import Results

RECORD = "campaign.json"
"""What ``harness view`` reads of a campaign."""

FIGURES = {
    "ideal": "5.6",
    "process-noise": "5.8",
    "mass": "5.9",
    "cog": "5.11",
    "friction": "5.12",
    "tyre": "5.13",
}
"""Figures of the dissertation, by the study that repeats them."""


def write_campaign(results: Path, out: Path) -> list[Path]:
    """Write the report of the campaign.

    Args:
        results: Folder with the results of the studies.
        out: Where ``report.html``, ``report.pdf`` and ``campaign.json`` go.

    Returns:
        The files written.

    Raises:
        UserError: If a study is missing.
    """
    campaign = Results(Path(results))
    tested = findings(campaign)
    sections = [
        Section(lambda: answer(campaign, tested), "Answer"),
        Section(lambda: _findings(campaign, tested, Path(out)), "What the dissertation found, tested on our data"),
        Section(lambda: _figures(campaign), "The dissertation's figures from our data"),
        Section(lambda: drives.blocks(campaign.analyses["ideal"]), "On which drives are the estimators wrong?"),
        Section(lambda: trust.blocks(campaign, Path(out)), "Do the filters say when they are not to be trusted?"),
        Section(lambda: _made(campaign), "How it was made"),
    ]
    title = "Which estimator can be trusted, within which envelope, and what drives its error?"
    record = json.dumps({"title": title, "findings": _recorded(tested)}, indent=1) + "\n"
    return [*Report(title, sections).write(Path(out)), *write_files(Path(out), {RECORD: record})]


def _recorded(tested: Sequence[Finding]) -> list[dict[str, Any]]:
    """Return the findings for programs."""
    return [
        {
            "finding": f.claim.text,
            "place": f.claim.place,
            "verdict": f.verdict.value,
            "ours": _in_short(f.evidence),
            "studies": list(f.claim.studies),
        }
        for f in tested
    ]


def _figures(campaign: Results) -> list[Block]:
    """Return the figures of the dissertation, drawn from our data; each caption says which one it is."""
    text = "Levels across, targets down, as there, with every estimator of a study. Each study has a report of its own."
    blocks: list[Block] = [Prose(plain(text))]
    for study, number_there in FIGURES.items():
        analysis = campaign.analyses[study]
        for picture in boxes.pictures(analysis, analysis.findings[0]):
            blocks.append(replace(picture, caption=f"Bild {number_there} ({words(study)}). {picture.caption}"))
    times = realtime.figure(campaign.times)
    return [*blocks, replace(times, caption=f"Bild 6.9 (computing time). {times.caption}")]


def _report_of(results: Path, studies: Sequence[str], out: Path) -> str | Linked:
    """Return the link to the figure of the study that a finding is tested on; of several studies their number."""
    if len(studies) > 1:
        return f"{len(studies)} studies"
    return on_study.linked(words(studies[0]), results / studies[0] / "report.html", out, "figure-1")


def _findings(campaign: Results, tested: list[Finding], out: Path) -> list[Block]:
    """Return the table of verdicts, the reasons, and the numbers behind every verdict."""
    shares = box.read(campaign.folder)
    rows = [
        [
            str(k),
            f.claim.text,
            f.claim.place,
            f.verdict.value,
            _report_of(campaign.folder, f.claim.studies, out),
            on_study.share_of(shares, f.claim.text, out),
            _in_short(f.evidence),
        ]
        for k, f in enumerate(tested, 1)
    ]
    counts = {v: sum(f.verdict is v for f in tested) for v in Verdict}
    opening = (
        f"Of {len(tested)} findings, {counts[Verdict.REPRODUCED]} are reproduced, {counts[Verdict.NOT_REPRODUCED]} are "
        f"not, {counts[Verdict.UNDECIDED]} cannot be decided. A finding is reproduced if every number behind it lies, "
        "with its whole 95 % interval, where the finding puts it; one number that lies outside with its whole interval "
        "refutes it. The dissertation says “marginal”, “hardly”, “clearly”; the limits used for these words are given "
        "below."
    )
    blocks: list[Block] = [
        Prose(plain(opening)),
        Sheet(
            ["", "finding", "Ziaukas 2023", "verdict", "report", "in the box", "ours"],
            rows,
            f"Findings and verdicts. Report: the figure in that of the study. {on_study.what_share_means(shares)}",
            left=6,
        ),
        Heading("Why a finding is not reproduced", 2),
        Prose(plain(_much_closer(campaign))),
    ]
    for k, f in enumerate(tested, 1):
        if f.verdict is not Verdict.REPRODUCED:
            blocks.append(Prose(plain(f"{k}. {f.claim.reason}")))
    blocks.append(Heading("The numbers behind the verdicts", 2))
    rows = [
        ["" if i else str(k), e.what, str(e.n), number(e.value.value), _interval(e), number(e.theirs), _wanted(e)]
        for k, f in enumerate(tested, 1)
        for i, e in enumerate(f.evidence)
    ]
    header = ["", "ratio of medians", "n", "ours", "95 % interval", "theirs", "claim holds in"]
    caption = (
        "Ratios of median errors with percentile bootstrap intervals: drives kept, runs that share drive and noise "
        "drawn together. Shares have exact intervals. n: runs behind a number; a run that diverged has no error."
    )
    blocks.append(Sheet(header, rows, caption, left=2))
    return blocks


def _much_closer(campaign: Results) -> str:
    """Say how large the errors of the ideal case are here and there, since all growth is counted from them."""
    ours = [float(np.nanmedian(campaign.errors("ideal", None, "EKF", target))) for target in (FORCE, ANGLE)]
    force, angle = ours
    theirs = [MEDIANS["EKF", target] for target in (FORCE, ANGLE)]
    return (
        f"With everything as believed our EKF is off by {number(force)} kN and {number(angle)}°, the dissertation's by "
        f"{number(theirs[0])} kN and {number(theirs[1])}°: {number(theirs[0] / force, 2)} and "
        f"{number(theirs[1] / angle, 2)} times as much. The same change "
        "of the vehicle is therefore a larger part of our error."
    )


def _in_short(evidence: list[Evidence]) -> str:
    """Return the range of the numbers behind a claim."""
    values = sorted(e.value.value for e in evidence if e.n)
    if not values:
        return "–"
    return number(values[0]) if len(values) == 1 else f"{number(values[0])} to {number(values[-1])}"


def _interval(e: Evidence) -> str:
    return f"{number(e.value.lower)} to {number(e.value.upper)}"


def _wanted(e: Evidence) -> str:
    low, high = e.region
    return f"{number(low)} to {number(high)}" if high < 1e6 else f"above {number(low)}"


def _made(campaign: Results) -> list[Block]:
    rows = []
    for name, store in campaign.stores.items():
        runs = sum(d.status.size for d in store.designs)
        rows.append([name, str(store.attributes.get("study_hash", "–"))[:12], str(store.seed), str(runs)])
    return [
        Sheet(["study", "hash of its text", "seed", "runs"], rows, "Studies of the campaign."),
    ]
