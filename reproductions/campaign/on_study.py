"""Evidence of a study or a measurement of times on the dissertation's findings, for its first page."""

from __future__ import annotations

import os
from pathlib import Path

import xarray as xr

from harness.common.errors import UserError
from harness.reporting.document import Block, Linked, Section, Sheet
from harness.reporting.style import percent
from harness.study.report.analysis import Analysis
from harness.study.results import StudyResults
from harness.study.score_names import PENDING
from reproductions.campaign import box
from reproductions.campaign.claims import CLAIMS, Finding
from reproductions.campaign.results import REALTIME, Results

_TITLE = "What the dissertation found"


class _OfOne(Results):
    """The groups of runs of one study, or the times alone."""

    def __init__(self, folder: Path, store: StudyResults | None = None, times: xr.Dataset | None = None) -> None:
        self.folder = folder
        self.study_names = () if store is None else (_name(store),)
        # in place of the reading of all
        self.__dict__["stores"] = {} if store is None else {_name(store): store}
        self.__dict__["times"] = times


def first_page(analysis: Analysis) -> list[Block]:
    """Return the findings that are tested on a study, with verdict and share of the box; nothing of other studies.

    A finding is left out where the study lacks a level, an estimator or a target that it compares.
    """
    store = analysis.store
    name = _name(store)
    if not any(name in c.studies for c in CLAIMS) or any(d.count(PENDING) for d in store.designs[:1]):
        return []
    return [Section(lambda: _table(_OfOne(store.directory, store), name), _TITLE, headed=False)]


def first_page_of_times(times: xr.Dataset, folder: Path) -> list[Block]:
    """Return the finding that is tested on what ``harness realtime`` measured.

    It is left out where an estimator is missing that it compares.

    Args:
        times: From ``harness.realtime.outcome.judge``.
        folder: Where its report goes.
    """
    return [Section(lambda: _table(_OfOne(folder, times=times), REALTIME), _TITLE, headed=False)]


def _name(store: StudyResults) -> str:
    return str(store.attributes.get("study_name", ""))


def _table(groups: Results, name: str) -> list[Block]:
    shares = box.read(groups.folder.parent)
    rows = []
    for number, claim in enumerate(CLAIMS, 1):
        if name in claim.studies:
            try:
                verdict = Finding(claim, claim.test(groups)).verdict.value
            except (UserError, KeyError):
                continue
            of_many = f", here (1 of {len(claim.studies)} studies)" if len(claim.studies) > 1 else ""
            rows.append([str(number), claim.text, verdict + of_many, share_of(shares, claim.text, groups.folder)])
    if not rows:
        return []
    caption = (
        "Findings of the dissertation (Ziaukas 2023) that are tested on this study, by their number in the report of "
        f"the campaign. {what_share_means(shares)}"
    )
    return [Sheet(["", "finding", "verdict", "in the box"], rows, caption, left=4)]


def linked(text: str, target: Path, folder: Path, anchor: str = "") -> str | Linked:
    """Return a text that leads from a report in a folder to a file, or the text alone where there is none.

    Args:
        text: The text.
        target: The file.
        folder: Of the report.
        anchor: A place in the file, ``figure-1`` for its first figure.
    """
    if not target.is_file():
        return text
    return Linked(text, Path(os.path.relpath(target, folder)).as_posix() + (f"#{anchor}" if anchor else ""))


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
