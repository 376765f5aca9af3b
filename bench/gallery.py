"""The pictures of README, docs/gallery.md and docs/view.md, drawn by the commands that docs/gallery.md shows.

``python -m bench.gallery docs`` writes the files of that page into an empty folder, runs its commands there, and
renews ``docs/pictures``: ``![words](pictures/boxes.png)`` is the figure of these words in a report that was written,
``![words](pictures/trace-page-1.png)`` the first page of ``trace/report.pdf``, and
``![words](pictures/view-above.png)`` a picture of ``bench.view_pictures``. A picture whose new form looks the same is
not written, so its bytes stay.
"""

from __future__ import annotations

import html
import io
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
from pathlib import Path

import typst
from PIL import Image, ImageChops
from rich.console import Console
from rich.text import Text

from bench import view_pictures
from harness.common.arguments import Parser
from support.documented import parts

PAGE, PAGES = "docs/gallery.md", ("gallery.md", "view.md")
SHOWN = re.compile(r"!\[([^\]]+)\]\(pictures/([\w-]+)\.png\)")
FIGURE = re.compile(r'<svg role="img" aria-label="([^"]*)"(.*?</svg>)', re.DOTALL)
SIZE = re.compile(r'viewBox="0 0 ([\d.]+) ([\d.]+)"')
PAGE_OF = re.compile(r"([\w-]+)-page-(\d+)")
WIDTH = 1000
"""Pixels that a figure or a page of a report is wide."""

COLOURS = 64
"""Of the palette of a picture, for its size."""

SAME = 64
"""Difference of a channel, of 255, up to which two pixels look the same: a palette or a processor may shift them a
little, another digit or line shifts some of them by more."""


def run_commands(page: Path, folder: Path, console: Console) -> None:
    """Write the files of a page into a folder and run its commands there.

    Raises:
        SystemExit: If one fails, with what it said.
    """
    for part in parts(str(page.resolve())):
        if part.kind == "file":
            (folder / part.name).write_text(part.text, encoding="utf-8")
        elif part.kind == "sh":
            began = time.monotonic()
            environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
            words = [sys.executable, "-m", *shlex.split(part.text)]
            done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True, check=False)
            if done.returncode:
                raise SystemExit(f"{page}: {part.text}\n{done.stdout}{done.stderr}")
            console.print(Text(f"{time.monotonic() - began:4.0f} s  {part.text[:110]}"), soft_wrap=True)


def figures_in(folder: Path) -> dict[str, bytes]:
    """Return the figures of all reports below a folder as SVG by their words."""
    figures: dict[str, bytes] = {}
    for report in sorted(folder.rglob("*.html")):
        for words, rest in FIGURE.findall(report.read_text(encoding="utf-8")):
            width, height = SIZE.search(rest).groups()
            head = f'<svg width="{width}pt" height="{height}pt" style="stroke-linejoin: round" '
            figures.setdefault(html.unescape(words), (head + rest).encode())
    return figures


def drawn(image: Path, page: int = 1) -> Image.Image:
    """Return an SVG, or a page of a PDF, ``WIDTH`` pixels wide; drawn twice as fine, where no thin stroke breaks."""
    text = (
        "#set page(width: 21cm, height: auto, margin: 3mm, fill: white)\n"
        f'#image("{image.name}", page: {page}, width: 100%)'
    )
    source = image.with_suffix(".typ")
    source.write_text(text, encoding="utf-8")
    return Image.open(io.BytesIO(typst.compile(source, format="png", ppi=2 * WIDTH / 21 * 2.54))).reduce(2)


def report_picture(folder: Path, words: str, name: str) -> Image.Image:
    """Return a page or a figure of a report below a folder.

    Raises:
        SystemExit: If there is no such report, or no figure of these words.
    """
    named = PAGE_OF.fullmatch(name)
    if named is not None:
        reports = [p for p in folder.rglob("*.pdf") if p.parent.name == named[1]]
        if len(reports) != 1:
            raise SystemExit(f"{name}.png: {len(reports)} reports are named {named[1]}/*.pdf; write FOLDER-page-NUMBER")
        return drawn(reports[0], int(named[2]))
    figures = figures_in(folder)
    if words not in figures:
        raise SystemExit(f"{name}.png: no report has a figure “{words}”; there are {sorted(figures)}")
    (folder / "figure.svg").write_bytes(figures[words])
    return drawn(folder / "figure.svg")


def renewed(path: Path, full: Image.Image) -> bool:
    """Write a picture with a small palette unless the one there looks the same; return whether it was written."""
    picture = full.convert("RGB").quantize(COLOURS, Image.Quantize.MAXCOVERAGE, kmeans=2)
    if path.exists():
        with Image.open(path) as there:
            old, new = there.convert("RGB"), picture.convert("RGB")
        if old.size == new.size and max(high for _, high in ImageChops.difference(old, new).getextrema()) <= SAME:
            return False
    path.parent.mkdir(exist_ok=True)
    picture.save(path, optimize=True)
    return True


def renew_pictures(folder: Path, docs: Path, console: Console) -> None:
    """Renew every picture that the pages show from the results in a folder; say which were written."""
    pages = [docs / page for page in PAGES if (docs / page).exists()]
    shown = {name: words for page in pages for words, name in SHOWN.findall(page.read_text(encoding="utf-8"))}
    in_browser = [name for name in shown if name in view_pictures.SHOTS]
    taken = view_pictures.taken(folder, in_browser)
    pictures = {name: Image.open(io.BytesIO(png)) for name, png in taken.items()}
    if len(pictures) < len(in_browser):
        console.print("Chromium, Playwright or Bokeh is missing, so these stay as they are: " + ", ".join(in_browser))
    pictures |= {name: report_picture(folder, shown[name], name) for name in shown if name not in in_browser}
    written = [name for name, full in pictures.items() if renewed(docs / "pictures" / f"{name}.png", full)]
    console.print(f"{len(written)} of {len(shown)} pictures written to {docs / 'pictures'} {' '.join(written)}".strip())


def main() -> None:
    """Run the commands and renew the pictures."""
    parser = Parser(description=__doc__)
    parser.add_argument("docs", type=Path, help="folder that holds gallery.md")
    docs = parser.parse_args().docs
    console = Console(stderr=True)
    with tempfile.TemporaryDirectory(prefix="gallery-") as folder:
        run_commands(docs / Path(PAGE).name, Path(folder), console)
        renew_pictures(Path(folder), docs, console)


if __name__ == "__main__":
    main()
