"""Renew tables and figures of ``docs/tables/attribution.md`` from the results of the proof.

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
from harness.common.arguments import Parser
from harness.common.errors import UserError
from harness.common.files import renewed, write_files

PAGE = Path(__file__).parents[2] / "docs" / "tables" / "attribution.md"
FIGURES = "attribution"
"""Folder of the figures, beside the page."""
MARKS = {
    "clean": ("<!-- written by python -m bench.attribution.renew -->", "<!-- end -->"),
    "field": ("<!-- field: written by python -m bench.attribution.renew -->", "<!-- end of field -->"),
    "bus": ("<!-- bus: written by python -m bench.attribution.renew -->", "<!-- end of bus -->"),
}
"""Lines between which the tables of each quality of recordings stand; the figures are of the clean ones."""


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Write the page and the figures."""
    parser = Parser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="?", default=Path("results/attribution/attribution.json"))
    given = parser.parse_args(arguments)
    if not given.results.exists():
        raise UserError(f"{given.results}: there is no such file; python -m bench.attribution writes it")
    scored = load(given.results)
    if len({s.quality for s in scored}) > 1:
        raise UserError(f"{given.results}: holds cases of several qualities; keep each in a folder of its own")
    quality = scored[0].quality if scored else "clean"
    drawn = figures(scored) if quality == "clean" else {}
    shown = "\n".join(f"![{caption(name)}]({FIGURES}/{name})\n" for name in drawn)
    content = tables(scored) + (f"\n## Figures\n\n{shown}" if drawn else "")
    content = content if quality == "clean" else content.replace("\n#", "\n##").replace("## Against", "### Against", 1)
    write_files(PAGE.parent, {PAGE.name: renewed(PAGE.read_text(encoding="utf-8"), content, *MARKS[quality])})
    write_files(PAGE.parent / FIGURES, drawn)
    print(f"wrote {PAGE} and {len(drawn)} figures")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
