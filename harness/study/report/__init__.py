"""Stage *report*: a finished result folder becomes ``report.html`` and ``report.pdf``; nothing is run again.

``harness.study.results`` reads, ``analysis`` computes every number once, each file of ``sections`` writes one part,
``harness.reporting`` turns the list of content blocks into both files.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial
from pathlib import Path

from harness.common.places import place
from harness.reporting.document import Block, Report, Section
from harness.study.report.analysis import Analysis
from harness.study.report.opening import answer_in_short
from harness.study.report.sections import (
    answer,
    boxes,
    certainty,
    consistency,
    drives,
    exceedance,
    history,
    inputs,
    made,
    over_time,
    paired,
    scatter,
    sensitivity,
    shares,
    tolerance,
    trust,
    weights,
)
from harness.study.report.sections.made import NOT_VERIFIABLE as NOT_VERIFIABLE
from harness.study.results import read

_SECTIONS = {
    "How large are the errors?": boxes.blocks,
    "How much of the error comes from the inputs?": inputs.blocks,
    "Which parameter drives the error?": sensitivity.blocks,
    "How often is a limit exceeded in the population?": exceedance.blocks,
    "Which factors make the error vary in the population?": shares.blocks,
    "How far may the vehicle drift in all factors at once?": tolerance.blocks,
    "Which parameter causes the error, and when?": over_time.blocks,
    "Which estimator is better, run by run?": paired.blocks,
    "What do runs look like over time?": history.blocks,
    "How much weight does a measurement get?": weights.blocks,
    "When is the drive informative?": certainty.blocks,
    "Are the stated covariances consistent?": consistency.blocks,
    "Does the filter say when it is not to be trusted?": trust.blocks,
    "On which drives are the estimators wrong?": drives.blocks,
    "How does the error depend on the actual value?": scatter.blocks,
    "How was this made?": made.blocks,
}
"""The sections of a report behind the answer, in their order."""

_OWN_HEADINGS = (boxes.blocks, inputs.blocks, history.blocks)
"""Sections whose headings depend on the study."""


def report(analysis: Analysis, opening: Sequence[Block] = ()) -> Report:
    """Return the report of a study, with blocks that follow the sentence that it opens with."""
    attributes = analysis.store.attributes
    question = str(attributes.get("title") or attributes.get("study_name") or analysis.store.directory.name)
    sections = [Section(partial(answer.blocks, analysis, opening), "Answer")]
    sections += [
        Section(partial(blocks, analysis), title, headed=blocks not in _OWN_HEADINGS)
        for title, blocks in _SECTIONS.items()
    ]
    return Report(question, sections)


def analyse(directory: Path) -> Analysis:
    """Return the analysis of a finished study, from which its headline and its report are made.

    Args:
        directory: Folder with ``scores.zarr`` and, if there is one, ``run.json``.

    Raises:
        UserError: If the folder holds no finished study, or files of it are missing or damaged.
    """
    return Analysis(read(place(directory)))


def headline(analysis: Analysis) -> str:
    """Return the answer of a study in some sentences, as its report opens."""
    return answer_in_short(analysis)


def write_report(analysis: Analysis, opening: Sequence[Block] = ()) -> list[Path]:
    """Write the report of a study next to its scores.

    Args:
        analysis: Of the study.
        opening: Blocks that follow the sentence that the report opens with.

    Returns:
        The files written: HTML, then PDF. The same store always gives the same bytes.

    Raises:
        UserError: If the folder cannot be written to.
    """
    return report(analysis, opening).write(analysis.store.directory)
