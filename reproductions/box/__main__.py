"""Search the box of what the dissertation leaves open, and report.

``python -m reproductions.box --out results/reproduce-box`` keeps every point in ``points/`` as soon as it is
computed and goes on from there, then writes ``report.html`` and ``.pdf``, ``box.json`` and, for the nearest point,
``nearest.toml`` and ``nearest_drives.toml``. With a page it renews that and ``reproductions/campaign/box.json``.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path

import joblib
import numpy as np

from harness.cli.options import answers_errors
from harness.common.arguments import Parser
from harness.common.errors import UserError
from harness.common.files import json_text, read_text, renewed, write_files
from reproductions.box import nearest, report, search
from reproductions.box.analysis import exclusions, most_findings, survivals
from reproductions.box.evidence import evidence_of
from reproductions.box.points import Folder, sequence
from reproductions.campaign import box

PAGE = Path("docs/tables/unpublished.md")
BEGIN, END = "<!-- written by make reproduce-box -->", "<!-- end -->"

LEAST = 32
"""Points below which neither shares nor indices say anything."""


def _arguments() -> argparse.ArgumentParser:
    parser = Parser(prog="python -m reproductions.box", description="Which findings survive what is not published?")
    parser.add_argument("--out", type=Path, required=True, help="folder to write to, and to go on from")
    parser.add_argument("--points", type=int, default=256, help="points of the Sobol sequence, a power of two")
    parser.add_argument("--generations", type=int, default=8, help="generations of the search for the nearest point")
    parser.add_argument("--page", type=Path, help=f"page to renew, {PAGE}, and with it {box.COMMITTED.name}")
    parser.add_argument("--jobs", type=int, default=joblib.cpu_count(), help="threads")
    return parser


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Compute what is not there yet, and write the report."""
    chosen = _arguments().parse_args(arguments)
    if chosen.points < LEAST or chosen.points & (chosen.points - 1):
        raise UserError(f"--points {chosen.points}: give a power of two of at least {LEAST}")
    if min(chosen.generations, chosen.jobs - 1) < 0:
        raise UserError("--generations must be at least 0 and --jobs at least 1")
    page = "" if chosen.page is None else read_text(chosen.page)
    for marks in ((BEGIN, END), (nearest.BEGIN, nearest.END)):
        if page:
            renewed(page, "", *marks)  # fails now rather than in an hour
    begin = time.perf_counter()

    def report_progress(line: str) -> None:
        print(f"{line}, {(time.perf_counter() - begin) / 60:.1f} min", file=sys.stderr, flush=True)

    folder = Folder(chosen.out / "points")
    points = list(folder.points(sequence(chosen.points), 0, chosen.jobs, report_progress))
    evidence = joblib.Parallel(chosen.jobs)(joblib.delayed(evidence_of)(point) for point in points)
    more, more_evidence = search.refine(folder, points, evidence, chosen.generations, chosen.jobs, report_progress)
    everyone, all_evidence = [*points, *more], [*evidence, *more_evidence]
    best = int(np.argmin([search.score(p, s) for p, s in zip(everyone, all_evidence, strict=True)]))
    chosen_point = everyone[best]
    richest = most_findings(everyone, all_evidence)
    result = report.BoxResult(
        points,
        evidence,
        survivals(points, evidence, chosen.jobs),
        len(more),
        chosen_point,
        all_evidence[best],
        everyone[richest],
        all_evidence[richest],
        exclusions(evidence),
        nearest.at_printed_point(chosen_point.number, chosen_point.at, chosen.jobs),
        f"python -m reproductions.box {shlex.join(arguments)}",
    )
    report.report(result).write(chosen.out)
    data = report.as_json(result, folder.code)
    write_files(
        chosen.out, {"box.json": json_text(data), **nearest.as_toml(result.nearest_as_printed.at, result.command)}
    )
    if chosen.page is not None:
        for content, marks in (
            (report.markdown(result), (BEGIN, END)),
            (nearest.markdown(result.nearest_as_printed, result.command), (nearest.BEGIN, nearest.END)),
        ):
            page = renewed(page, content, *marks)
        write_files(chosen.page.parent, {chosen.page.name: page})
        write_files(box.COMMITTED.parent, {box.COMMITTED.name: json_text(box.summary(data))})
    print(f"wrote {chosen.out}/report.html")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
