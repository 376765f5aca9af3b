"""Renew tables and figures of ``docs/attribution.md``, or of another page, from the results of the proof.

``python -m bench.attribution.renew results/attribution/attribution.json``; ``make attribution-docs`` does it. With
``--page attribution-sizes.md --magnitudes small large`` the page of that name shows cases of these magnitudes alone.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

from bench.attribution.figures import caption, figures
from bench.attribution.score import MAGNITUDES, load
from bench.attribution.tables import tables
from harness.command_line import answers_errors
from harness.errors import UserError
from harness.folder import write_files

DOCS = Path(__file__).parents[2] / "docs"
PAGE = "attribution.md"
BEGIN, END = "<!-- written by python -m bench.attribution.renew -->", "<!-- end -->"


def renewed(page: str, content: str) -> str:
    """Return a page with other content between its marks.

    Raises:
        UserError: If a mark is missing.
    """
    before, begin, rest = page.partition(BEGIN)
    _, end, after = rest.partition(END)
    if not begin or not end:
        raise UserError(
            f"the page needs marks: put {BEGIN} and {END} on lines of their own around what is to be written"
        )
    return f"{before}{BEGIN}\n\n{content.strip()}\n\n{END}{after}"


@answers_errors
def main(arguments: Sequence[str]) -> None:
    """Write the page and the figures."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("results", type=Path, nargs="?", default=Path("results/attribution/attribution.json"))
    parser.add_argument("--page", default=PAGE, help="file in docs (%(default)s); its figures are beside it")
    parser.add_argument("--magnitudes", nargs="+", choices=MAGNITUDES, help="cases of these only; all if absent")
    given = parser.parse_args(arguments)
    if not given.results.exists():
        raise UserError(f"{given.results}: there is no such file; python -m bench.attribution writes it")
    page = DOCS / given.page
    if not page.exists():
        raise UserError(f"{page}: there is no such page; write one with {BEGIN} and {END} where the tables are to be")
    every = load(given.results)
    scored = [s for s in every if given.magnitudes is None or s.magnitude in given.magnitudes]
    drawn = figures(scored)
    shown = "\n".join(f"![{caption(name)}]({page.stem}/{name})\n" for name in drawn)
    content = f"{tables(scored)}\n## Figures\n\n{shown}"
    write_files(page.parent, {page.name: renewed(page.read_text(encoding="utf-8"), content)})
    write_files(page.parent / page.stem, drawn)
    print(f"wrote {page} and {len(drawn)} figures")


if __name__ == "__main__":
    sys.exit(main(sys.argv[1:]))
