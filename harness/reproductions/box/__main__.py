"""Search the box of what the dissertation leaves open, and report.

``python -m harness.reproductions.box --out results/reproduce-box`` keeps every point in ``points/`` as soon as it is
computed and goes on from there, then writes ``report.html`` and ``.pdf``, ``box.json`` and, for the nearest point,
``nearest.toml`` and ``nearest_drives.toml``.
"""

from __future__ import annotations

import argparse
import shlex
import sys
import time
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import joblib
import numpy as np

from harness.cli.options import answers_errors
from harness.common.errors import UserError
from harness.common.files import json_text, read_text, renewed, toml_text, write_files
from harness.reporting.document import write
from harness.reproductions.box import report, search, studies
from harness.reproductions.box.analysis import exclusions, most_findings, survivals
from harness.reproductions.box.evidence import IN_BOX, PUBLISHED, told
from harness.reproductions.box.factors import FACTORS
from harness.reproductions.box.plausibility import plausibility
from harness.reproductions.box.points import Folder, Point, evaluate, sequence

PAGE = Path("docs/unpublished.md")
BEGIN, END = "<!-- written by make reproduce-box -->", "<!-- end -->"

LEAST = 32
"""Points below which neither shares nor indices say anything."""


def _arguments() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="python -m harness.reproductions.box", description="Which findings survive what is not published?"
    )
    parser.add_argument("--out", type=Path, required=True, help="folder to write to, and to go on from")
    parser.add_argument("--points", type=int, default=256, help="points of the Sobol sequence, a power of two")
    parser.add_argument("--generations", type=int, default=8, help="generations of the search for the nearest point")
    parser.add_argument("--page", type=Path, help=f"page to renew between its marks, such as {PAGE}")
    parser.add_argument(
        "--network", type=Path, help="network trained at the nearest point, to tell that one again with it"
    )
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
    page = "" if chosen.page is None else renewed(read_text(chosen.page), "", BEGIN, END)
    begin = time.perf_counter()

    def tell(line: str) -> None:
        print(f"{line}, {(time.perf_counter() - begin) / 60:.1f} min", file=sys.stderr, flush=True)

    folder = Folder(chosen.out / "points")
    points = list(folder.points(sequence(chosen.points), 0, chosen.jobs, tell))
    says = joblib.Parallel(chosen.jobs)(joblib.delayed(told)(point) for point in points)
    more, more_says = search.refine(folder, points, says, chosen.generations, chosen.jobs, tell)
    everyone, every_says = [*points, *more], [*says, *more_says]
    best = int(np.argmin([search.score(p, s) for p, s in zip(everyone, every_says, strict=True)]))
    nearest = everyone[best]
    again = None
    if chosen.network is not None:
        again = evaluate(nearest.number, nearest.place, chosen.jobs, str(chosen.network.resolve()))
    richest = most_findings(everyone, every_says)
    found = report.Found(
        points,
        says,
        survivals(points, says),
        len(more),
        nearest,
        every_says[best],
        plausibility(nearest.at),
        everyone[richest],
        every_says[richest],
        exclusions(says),
        again,
        f"python -m harness.reproductions.box {shlex.join(arguments)}",
    )
    write(report.document(found), chosen.out)
    write_files(chosen.out, {"box.json": json_text(as_json(found, folder.state)), **as_toml(nearest, found.command)})
    if page:
        write_files(chosen.page.parent, {chosen.page.name: renewed(page, report.markdown(found), BEGIN, END)})
    print(f"wrote {chosen.out}/report.html")


def as_json(found: report.Found, state: str) -> dict[str, Any]:
    """Return what was found as plain data: shares, hinges, numbers, the nearest point."""
    names = [f.name for f in FACTORS]
    findings = []
    for claim, survival, holds in zip(IN_BOX, found.survivals, found.told.holds(), strict=True):
        hinge = survival.hinge
        findings.append(
            {
                "finding": claim.text,
                "place": claim.place,
                "share": list(survival.share),
                "share_without_network": list(survival.filters),
                "holds_at_nearest": holds,
                "first_order": None if hinge is None else dict(zip(names, hinge.first, strict=True)),
                "first_order_error": None if hinge is None else dict(zip(names, hinge.error, strict=True)),
            }
        )
    numbers = [
        {"number": p.words, "place": p.place, "theirs": p.theirs, "ours": list(n)}
        for p, n in zip(PUBLISHED, found.told.numbers, strict=True)
    ]
    retrained = None if found.retrained is None else told(found.retrained)
    return {
        "code": state,
        "points": len(found.points),
        "searched": found.searched,
        "findings": findings,
        "nearest": {"number": found.nearest.number, "at": found.nearest.at, "distance": found.told.off(),
                    "numbers": numbers},
        "most_findings": {
            "number": found.richest.number,
            "at": found.richest.at,
            "holds": found.richest_told.holds(),
            "distance": found.richest_told.off(),
            "numbers": [list(n) for n in found.richest_told.numbers],
        },
        "retrained": None if retrained is None else {"holds": retrained.holds(), "distance": retrained.off(),
                                                     "numbers": [list(n) for n in retrained.numbers]},
        "command": found.command,
    }  # fmt: skip


def as_toml(nearest: Point, command: str) -> dict[str, str]:
    """Return parameter file and drives of the nearest point, which a study can name."""
    at = nearest.at
    spec = studies.study_at(at).plant
    process, measurement = studies.noise(at)
    heading = f"The point of the box nearest to Ziaukas 2023, chapter 5. Written by: {command}"
    values = {
        "vehicle": spec.vehicle,
        "tyre": spec.tyre,
        "sensors": spec.sensors,
        "values": spec.values,
        "process_noise": process,
        "measurement_noise": spec.measurement_noise | measurement,
    }
    title = "Drives of the described kinds at the point nearest to Ziaukas 2023"
    return {
        "nearest.toml": toml_text(values, heading),
        "nearest_drives.toml": toml_text({"title": title, "drive": studies.drives(at)}, heading),
    }


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
