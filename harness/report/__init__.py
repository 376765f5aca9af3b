"""Stage *report*: a finished result folder becomes ``report.html`` and ``report.pdf``; nothing is run again.

The parts: ``store`` reads, ``analysis`` computes every number once, each file of ``sections`` writes one part,
``document`` turns the list of content blocks into both files, ``style`` says how everything looks.
"""

from __future__ import annotations

from pathlib import Path

from harness.report.analysis import Analysis
from harness.report.document import Document, write
from harness.report.opening import answer_in_short
from harness.report.sections import (
    answer,
    boxes,
    certainty,
    consistency,
    drives,
    history,
    made,
    over_time,
    paired,
    scatter,
    sensitivity,
    tolerance,
    weights,
)
from harness.report.sections.made import NOT_VERIFIABLE as NOT_VERIFIABLE
from harness.report.store import read

_SECTIONS = (
    answer,
    boxes,
    sensitivity,
    tolerance,
    over_time,
    paired,
    history,
    weights,
    certainty,
    consistency,
    drives,
    scatter,
    made,
)


def analyse(directory: Path) -> Analysis:
    """Return the analysis of a finished study, from which its headline and its report are made.

    Args:
        directory: Folder with ``scores.zarr`` and, if there is one, ``run.json``.

    Raises:
        UserError: If the folder holds no finished study, or files of it are missing or damaged.
    """
    return Analysis(read(Path(directory)))


def headline(analysis: Analysis) -> str:
    """Return the answer of a study in one or two sentences, as its report opens."""
    return answer_in_short(analysis.main)


def write_report(analysis: Analysis) -> list[Path]:
    """Write the report of a study beside its scores.

    Returns:
        The files written: HTML, then PDF. The same store always gives the same bytes.

    Raises:
        UserError: If the folder cannot be written to.
    """
    store = analysis.store
    question = str(store.attributes.get("title") or store.attributes.get("study_name") or store.directory.name)
    document = Document(question, [block for section in _SECTIONS for block in section.blocks(analysis)])
    return write(document, store.directory)
