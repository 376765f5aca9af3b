"""Renew tables and figures of ``docs/attribution.md`` from the results of the proof.

``python -m bench.attribution.renew results/attribution/attribution.json``; ``make attribution-docs`` does it.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from bench.attribution.figures import caption, figures
from bench.attribution.score import load
from bench.attribution.tables import tables
from harness.cli.options import answers_errors
from harness.common.errors import UserError
from harness.common.files import renewed, write_files

PAGE = Path(__file__).parents[2] / "docs" / "attribution.md"
BEGIN, END = "<!-- written by python -m bench.attribution.renew -->", "<!-- end -->"


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Write the page and the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="?", default=Path("results/attribution/attribution.json"))
    given = parser.parse_args(arguments)
    if not given.results.exists():
        raise UserError(f"{given.results}: there is no such file; python -m bench.attribution writes it")
    scored = load(given.results)
    drawn = figures(scored)
    shown = "\n".join(f"![{caption(name)}]({PAGE.stem}/{name})\n" for name in drawn)
    content = f"{tables(scored)}\n## Figures\n\n{shown}"
    write_files(PAGE.parent, {PAGE.name: renewed(PAGE.read_text(encoding="utf-8"), content, BEGIN, END)})
    write_files(PAGE.parent / PAGE.stem, drawn)
    print(f"wrote {PAGE} and {len(drawn)} figures")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
