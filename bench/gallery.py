"""The pictures of docs/gallery.md, made by the commands that it shows, and those of docs/view.md from its results.

``python -m bench.gallery build/docs`` writes the files of the page into an empty folder, runs its commands there, and
puts every picture that the page shows beside the page: ``![words](gallery/boxes.svg)`` is the figure of these words in
a report that was written, ``![words](gallery/trace-page-1.png)`` the first page of ``trace/report.pdf``, and
``![words](gallery/view-above.png)`` a picture of ``bench.view_pictures``.
"""

from __future__ import annotations

import argparse
import html
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import typst
from rich.console import Console
from rich.text import Text

from bench import view_pictures
from support.documented import parts

PAGE, PAGES = "docs/gallery.md", ("gallery.md", "view.md")
SHOWN = re.compile(r"!\[([^\]]+)\]\(gallery/([\w-]+)\.(svg|png)\)")
FIGURE = re.compile(r'<svg role="img" aria-label="([^"]*)"(.*?</svg>)', re.DOTALL)
SIZE = re.compile(r'viewBox="0 0 ([\d.]+) ([\d.]+)"')
PAGE_OF = re.compile(r"([\w-]+)-page-(\d+)")
FINENESS = 110.0
"""Pixels per inch of a page of a report."""


def run_commands(folder: Path, console: Console) -> None:
    """Write the files of the page into a folder and run its commands there.

    Raises:
        SystemExit: If one fails, with what it said.
    """
    for part in parts(PAGE):
        if part.kind == "file":
            (folder / part.name).write_text(part.text, encoding="utf-8")
        elif part.kind == "sh":
            began = time.monotonic()
            environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
            words = [sys.executable, "-m", *shlex.split(part.text)]
            done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
            if done.returncode:
                raise SystemExit(f"{PAGE}: {part.text}\n{done.stdout}{done.stderr}")
            console.print(Text(f"{time.monotonic() - began:4.0f} s  {part.text[:110]}"), soft_wrap=True)


def figures_in(folder: Path) -> dict[str, bytes]:
    """Return the figures of all reports below a folder by their words."""
    found: dict[str, bytes] = {}
    for report in sorted(folder.rglob("*.html")):
        for words, rest in FIGURE.findall(report.read_text(encoding="utf-8")):
            width, height = SIZE.search(rest).groups()
            head = f'<svg width="{width}pt" height="{height}pt" style="stroke-linejoin: round" '
            found.setdefault(html.unescape(words), (head + rest).encode())
    return found


def page_of(folder: Path, name: str) -> bytes:
    """Return a page of a report as PNG.

    Raises:
        SystemExit: If the name is none of a page, or there is no report.
    """
    named = PAGE_OF.fullmatch(name)
    reports = [] if named is None else [p for p in folder.rglob("*.pdf") if p.parent.name == named[1]]
    if named is None or len(reports) != 1:
        raise SystemExit(f"{PAGE}: {name}.png is no page of a report; write FOLDER-page-NUMBER")
    text = (
        f'#set page(width: auto, height: auto, margin: 0pt)\n#image("{reports[0].name}", page: {named[2]}, width: 21cm)'
    )
    (reports[0].parent / "page.typ").write_text(text, encoding="utf-8")
    return typst.compile(reports[0].parent / "page.typ", format="png", ppi=FINENESS)


def write_pictures(folder: Path, docs: Path) -> list[Path]:
    """Write every picture that the page shows beside the page; return their paths.

    Raises:
        SystemExit: If no report has a figure of these words.
    """
    there, written = figures_in(folder), []
    (docs / "gallery").mkdir(exist_ok=True)
    shown = [s for page in PAGES for s in SHOWN.findall((docs / page).read_text(encoding="utf-8"))]
    in_browser = view_pictures.taken(folder, [name for _, name, _ in shown if name in view_pictures.SHOTS])
    for words, name, suffix in shown:
        if suffix == "svg" and words not in there:
            raise SystemExit(f"{PAGE}: no report has a figure “{words}”; there are {sorted(there)}")
        written.append(docs / "gallery" / f"{name}.{suffix}")
        drawn = there[words] if suffix == "svg" else in_browser.get(name) or page_of(folder, name)
        written[-1].write_bytes(drawn)
    return written


def main() -> None:
    """Run the commands and write the pictures."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("docs", type=Path, help="folder that holds the page")
    chosen = parser.parse_args()
    console = Console(stderr=True)
    with tempfile.TemporaryDirectory(prefix="gallery-") as folder:
        run_commands(Path(folder), console)
        written = write_pictures(Path(folder), chosen.docs)
    console.print(f"{len(written)} pictures in {chosen.docs / 'gallery'}")


if __name__ == "__main__":
    main()
