"""Compare every number that the five documents publish with ours: ``python -m reproductions.reproduce``.

``make reproduce`` computes what takes seconds, reads the rest from the stored results of the long commands, and renews
``docs/tables/reproduction.md``, ``reproduction.json`` and the report as HTML and PDF. A result that is missing, or
older than the code that decides it, is said to be so.
"""

from __future__ import annotations

import argparse
import sys
import time
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from rich.console import Console

from harness.cli.options import answers_errors
from harness.common.arguments import Parser
from harness.common.errors import UserError
from harness.common.files import json_text, read_text, renewed, write_files
from harness.common.stages import showing
from reproductions.published import (
    kit,
    lex,
    li,
    page,
    report,
    sun,
    wording,
    ziaukas_ideal,
    ziaukas_model,
    ziaukas_ramps,
    ziaukas_robustness,
    ziaukas_vehicle,
)
from reproductions.published.record import Row, answer
from reproductions.published.results import Origin, Stored, network_origin
from reproductions.published.wording import Chapter

CHAPTERS: dict[str, Any] = {
    "ziaukas-model": ziaukas_model,
    "ziaukas-ideal": ziaukas_ideal,
    "ziaukas-ramps": ziaukas_ramps,
    "ziaukas-robustness": ziaukas_robustness,
    "ziaukas-vehicle": ziaukas_vehicle,
    "sun": sun,
    "li": li,
    "kit": kit,
    "lex": lex,
}
"""The documents, in the order of the page."""

PAGE = Path("docs/tables/reproduction.md")
BEGIN, END = "<!-- written by make reproduce -->", "<!-- end -->"
WHOLE = "reproductions.reproduce"


def chapters(stored: Stored, names: Sequence[str], console: Console) -> list[Chapter]:
    """Answer the records of some documents."""
    answered = []
    for name in names:
        begin, module = time.perf_counter(), CHAPTERS[name]
        rows: list[Row] = []
        records = module.records()
        with showing(console, module.TITLE) as show:
            for number, record in enumerate(records, start=1):
                show(f"{module.TITLE}: {number} of {len(records)}, {record.quantity}")
                rows.append(answer(record, stored))
        answered.append(Chapter(module.TITLE, module.NOTE, rows))
        console.print(f"{module.TITLE}: {len(rows)} records in {time.perf_counter() - begin:.0f} s")
    return answered


def origins(stored: Stored, answered: Sequence[Chapter]) -> list[Origin]:
    """Return where the results come from that the records need, and the network that the studies use."""
    names = dict.fromkeys(name for chapter in answered for row in chapter.rows for name in row.record.needs.split())
    listed = [stored.origin(name) for name in names]
    return [*listed, network_origin()] if "ideal" in names else listed


def as_json(answered: Sequence[Chapter], listed: Sequence[Origin], made: str) -> dict[str, Any]:
    """Return everything as plain data."""
    return {
        "made": made,
        "results": [vars(o) for o in listed],
        "documents": [
            {
                "title": chapter.title,
                "rows": [
                    {
                        "place": row.record.place,
                        "what": row.record.quantity,
                        "kind": row.record.kind.value,
                        "theirs": row.record.theirs,
                        "unit": row.record.unit,
                        "verdict": row.outcome.value,
                        "old": row.old,
                        "missing": row.missing,
                        "command": wording.source(row),
                        "reason": row.record.reason,
                        "ours": [
                            {
                                "what": e.what,
                                "value": e.value.value,
                                "interval": [e.value.lower, e.value.upper],
                                "holds in": list(e.region),
                                "theirs": e.theirs,
                                "n": e.n,
                            }
                            for e in row.evidence
                        ],
                    }
                    for row in chapter.rows
                ],
            }
            for chapter in answered
        ],
    }


def _arguments() -> argparse.ArgumentParser:
    parser = Parser(prog=f"python -m {WHOLE}", description="Compare published numbers with ours.")
    parser.add_argument("--results", type=Path, default=Path("results"), help="folder of the stored results")
    parser.add_argument("--out", type=Path, default=Path("results/reproduction"), help="folder to write to")
    parser.add_argument("--page", type=Path, default=PAGE, help="page to renew between its marks")
    parser.add_argument("--only", nargs="+", choices=sorted(CHAPTERS), help="some documents; the page is left alone")
    return parser


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Compare, and write page, data and report."""
    chosen, console = _arguments().parse_args(arguments), Console(stderr=True)
    before = None if chosen.only else read_text(chosen.page)
    if before is not None:
        renewed(before, "", BEGIN, END)  # fails now rather than in five minutes
    if not chosen.results.is_dir():
        raise UserError(f"{chosen.results}: there is no such folder; --results names that of the stored results")
    begin = time.perf_counter()
    stored = Stored(chosen.results, chosen.out)
    answered = chapters(stored, chosen.only or list(CHAPTERS), console)
    listed = origins(stored, answered)
    made = datetime.now(UTC).date().isoformat()
    write_files(chosen.out, {"reproduction.json": json_text(as_json(answered, listed, made))})
    report.report(answered, listed).write(chosen.out)
    if before is not None:
        content = page.content(answered, listed, made)
        write_files(chosen.page.parent, {chosen.page.name: renewed(before, content, BEGIN, END)})
    print(wording.sentence([row for chapter in answered for row in chapter.rows]))
    missing = [o.command for o in listed if o.state == "missing"]
    if missing:
        print(f"missing results, made by: {', '.join(missing)}")
    print(f"wrote {chosen.out}/report.html in {time.perf_counter() - begin:.0f} s")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
