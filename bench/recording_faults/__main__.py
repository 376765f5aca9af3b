"""``make check-proof``: plant faults in recordings, and count what ``harness check`` names and mends.

Foreign drives, whose plant shares nothing with the program (``--foreign``), simulated drives of a car and a semitrailer
(``--seeds``), and the measured drives that are there. Seeds below 1000 are those that thresholds were set with; the
tables of docs/tables/check.md are from others. Every check is kept as soon as it is done: the same command goes on
where it stopped.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.progress import track

from bench.recording_faults.foreign import PLANTED
from bench.recording_faults.foreign_run import coverage
from bench.recording_faults.foreign_run import run as run_foreign
from bench.recording_faults.foreign_run import table as table_of_foreign
from bench.recording_faults.run import CLEAN, Scored, run
from harness.common.arguments import Parser

RECALL, FALSE_ALARMS = 0.95, 0.02


def table(scores: Sequence[Scored]) -> str:
    """Return the table of docs/tables/check.md: a row per kind."""
    rows = ["| planted | checks | named | mended map passes | a further finding |", "|---|--:|--:|--:|--:|"]
    kinds = sorted({s.kind for s in scores} - {CLEAN})
    for kind in kinds:
        own = [s for s in scores if s.kind == kind]
        counts = [len(own), *(sum(getattr(s, what) > 0 for s in own) for what in ("named", "passes", "further"))]
        rows.append(f"| {kind} | {' | '.join(map(str, counts))} |")
    return "\n".join(rows)


def summary(scores: Sequence[Scored], measured: bool) -> tuple[str, float, float]:
    """Return a sentence on the simulated or the measured drives, the recall and the share of false alarms."""
    own = [s for s in scores if s.measured == measured]
    faults, clean = [s for s in own if s.kind != CLEAN], [s for s in own if s.kind == CLEAN]
    if not own:
        return "", 1.0, 0.0
    recall = sum(s.named for s in faults) / max(len(faults), 1)
    alarms = sum(not s.named for s in clean) / max(len(clean), 1)
    mended, further = (sum(getattr(s, what) > 0 for s in faults) for what in ("passes", "further"))
    seconds = float(np.nanmedian([s.seconds for s in own]))
    words = (
        f"{'measured' if measured else 'simulated'} drives: {sum(s.named for s in faults)} of {len(faults)} faults "
        f"named ({recall:.1%}), mended map passes in {mended}, a further finding in {further}; "
        f"{sum(not s.named for s in clean)} of {len(clean)} drives without a planted fault have a finding; "
        f"median {seconds:.1f} s a check"
    )
    return words, recall, alarms


def main(arguments: list[str] | None = None) -> int:
    """Run the command line; return the exit status: 0 if recall and false alarms are as they should be."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", default="1000:1010", help="first and last (excluded) seed of the simulated drives")
    parser.add_argument("--foreign", default="1000:1050", help="first and last (excluded) seed of the foreign drives")
    parser.add_argument("--jobs", type=int, default=2, help="processes")
    parser.add_argument("--no-measured", action="store_true", help="leave the measured drives out")
    parser.add_argument("--out", type=Path, default=Path("results/check-proof"))
    given = parser.parse_args(arguments)
    first, last = (int(n) for n in given.seeds.split(":"))
    console = Console(soft_wrap=True)
    first_foreign, last_foreign = (int(n) for n in given.foreign.split(":"))
    progress = Console(stderr=True)
    seeds = range(first_foreign, last_foreign)
    alone = run_foreign(seeds, given.jobs, given.out / "foreign.jsonl")
    total = len(seeds) * len(PLANTED)
    scores = list(track(alone, "foreign drives", total=total, console=progress, disable=not total))
    written = f"{table_of_foreign(scores)}\n\n{coverage(scores)}\n" if scores else ""
    console.print(written, markup=False)
    (given.out / "foreign.md").write_text(written, encoding="utf-8")
    scored: list[Scored] = []
    batches = run(range(first, last), given.jobs, given.out / "checks.jsonl", not given.no_measured)
    for each in track(batches, "drives", total=None, console=progress):
        scored += each
    (given.out / "table.md").write_text(table(scored) + "\n", encoding="utf-8")
    console.print(table(scored), markup=False)
    enough = True
    for measured in (False, True):
        words, recall, alarms = summary(scored, measured)
        console.print(words, markup=False)
        enough &= measured or (recall >= RECALL and alarms <= FALSE_ALARMS)
    return 0 if enough else 1


if __name__ == "__main__":
    sys.exit(main())
