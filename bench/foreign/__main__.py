"""Attribution of ``harness trace`` on a plant of other hands: twelve cases, written, traced and scored.

``python -m bench.foreign --cases a h`` runs some cases, without ``--cases`` all (hours). What was written or traced
already is kept; ``--traced`` only scores. The folder holds every case and ``foreign.md``, the table of all that were
traced in it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from rich.console import Console
from rich.progress import track

from bench.foreign.cases import CASES
from bench.foreign.run import run_all
from bench.foreign.score import gathered, table
from harness.cli.options import answers_errors
from harness.common.arguments import Parser
from harness.common.errors import UserError, closest
from harness.common.files import write_files


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Write, trace, score, print.

    Raises:
        UserError: If there is no such case, or nothing was traced.
    """
    parser = Parser(
        prog="python -m bench.foreign", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--cases", nargs="+", default=list(CASES), metavar="CASE", help="their letters (all)")
    parser.add_argument("--jobs", type=int, default=1, help="processes (%(default)s, whose traces take all cores)")
    parser.add_argument("--traced", action="store_true", help="score what was traced already, and trace nothing")
    parser.add_argument("--out", type=Path, default=Path("results/foreign"), help="folder (%(default)s)")
    given = parser.parse_args(arguments)
    if unknown := [name for name in given.cases if name not in CASES]:
        raise UserError(f"--cases: there is no case '{unknown[0]}'{closest(unknown[0], list(CASES))}")
    if given.jobs < 1:
        raise UserError(f"--jobs: {given.jobs} processes cannot trace; give 1 or more")
    console = Console()
    if not given.traced:
        cases = list(dict.fromkeys(given.cases))
        for name, problem in track(run_all(cases, given.out, given.jobs), "tracing", len(cases), console=console):
            console.print(f"{name}: {problem or 'traced'}", markup=False, soft_wrap=True)
    scored = gathered(given.out)
    if not scored:
        raise UserError(f"{given.out}: holds no case that was traced; leave out --traced")
    write_files(given.out, {"foreign.md": table(scored)})
    console.print(table(scored), markup=False, soft_wrap=True)


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
