"""What a study of the dissertation says of the findings tested on it, for the first page of its report."""

from __future__ import annotations

import os
from pathlib import Path

from harness.campaign import box
from harness.campaign.claims import CLAIMS, Finding
from harness.campaign.results import Results
from harness.common.errors import UserError
from harness.reporting.document import Block, Linked, Section, Sheet
from harness.reporting.style import percent
from harness.study.report.analysis import Analysis
from harness.study.results import StudyResults
from harness.study.scores import PENDING


class _OfOne(Results):
    """The groups of runs of one study."""

    def __init__(self, store: StudyResults, name: str) -> None:
        self.folder = store.directory
        self.__dict__["stores"] = {name: store}  # in place of the reading of all


def first_page(analysis: Analysis) -> list[Block]:
    """Return the findings that are tested on a study, with verdict and share of the box; nothing of other studies.

    A finding is left out where the study lacks a level, an estimator or a target that it compares.
    """
    store = analysis.store
    name = str(store.attributes.get("study_name", ""))
    claims = [(number, c) for number, c in enumerate(CLAIMS, 1) if c.studies == (name,)]
    if not claims or any(d.count(PENDING) for d in store.designs[:1]):
        return []
    return [Section(lambda: _table(store, name), "What the dissertation found")]


def _table(store: StudyResults, name: str) -> list[Block]:
    groups, folder = _OfOne(store, name), Path(store.directory)
    shares = box.read(folder.parent)
    rows = []
    for number, claim in enumerate(CLAIMS, 1):
        if claim.studies == (name,):
            try:
                verdict = Finding(claim, claim.test(groups)).verdict.value
            except UserError:
                continue
            rows.append([str(number), claim.text, verdict, share_of(shares, claim.text, folder)])
    if not rows:
        return []
    caption = (
        "Findings of the dissertation (Ziaukas 2023) that are tested on this study, by their number in the report of "
        f"the campaign. {what_share_means(shares)}"
    )
    return [Sheet(["", "finding", "verdict", "in the box"], rows, caption, left=4)]


def linked(text: str, target: Path, folder: Path) -> str | Linked:
    """Return a text that leads from a report in a folder to a file, or the text alone where there is none."""
    return Linked(text, Path(os.path.relpath(target, folder)).as_posix()) if target.is_file() else text


def share_of(shares: box.Box, finding: str, folder: Path) -> str | Linked:
    """Return the share of the box in which a finding holds with its interval, a link where the box has a report."""
    share = shares.share(finding)
    if share is None:
        return "–"
    text = f"{percent(share.value)} ({percent(share.lower)} to {percent(share.upper)})"
    return text if shares.report is None else linked(text, shares.report, folder)


def what_share_means(shares: box.Box) -> str:
    """Say what the shares are of."""
    return (
        "In the box: share of what the dissertation does not publish in which the finding holds, with its 95 % "
        f"interval, from {shares.points} points of {shares.made} (docs/unpublished.md)."
    )
