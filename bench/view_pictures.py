"""Pictures of ``harness view`` for the documentation, taken in Chromium from the results of docs/gallery.md."""

from __future__ import annotations

import importlib.util
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import typst

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
ARGUMENTS = [
    "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
IDLE = "window.Bokeh && Bokeh.documents.length && Bokeh.documents[0].is_idle"
_MOVED = """(time) => {
    const models = [...Bokeh.documents[0]._all_models.values()];
    models.find((m) => m.type === 'Slider' && m.title === 'Time in s').value = time;
}"""
_RUN = "?design=0&run=0.0.1.0.3&compared=0.1"


@dataclass(frozen=True)
class Shot:
    """A picture.

    Attributes:
        folders: Names of the result folders.
        query: Of the address.
        region: Section of the page, by its label; all that is seen without scrolling where it is empty.
        wait: Words that the page says when it is ready.
        time: Where the slider over time stands, s.
        width: Of the window in pixels.
    """

    folders: tuple[str, ...]
    query: str = ""
    region: str = ""
    wait: str = ""
    time: float | None = None
    width: int = 1280


_STORED = "The scores are those of the store"
SHOTS = {
    "view-boxes": Shot(("gallery",), _RUN, "Distribution of the score", _STORED),
    "view-above": Shot(("gallery",), _RUN, "From above", _STORED, 9.0),
    "view-factors": Shot(("gallery",), "?design=1", "Points of the design"),
    "view-studies": Shot(("gallery", "navigation", "tyre-brush"), "?run=1.0.1.1.0.3", "Distribution of the score"),
    "view-trace": Shot(("trace",), region="Before and after"),
    "view-check": Shot(("check",)),
    "view-phone": Shot(("gallery",), _RUN, "", _STORED, width=390),
}


@contextmanager
def served(*folders: Path) -> Iterator[str]:
    """Serve result folders and give their address."""
    command = [sys.executable, "-m", "harness", "view", *map(str, folders), "--no-browser"]
    environment = os.environ | {"PYTHONPATH": os.pathsep.join(sys.path)}
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True, env=environment, cwd=folders[0].parent) as server:
        assert server.stdout is not None
        try:
            yield server.stdout.readline().strip()
        finally:
            server.terminate()


def taken(folder: Path, names: Iterable[str]) -> dict[str, bytes]:
    """Return pictures as PNG by their name; without Chromium, Playwright and Bokeh each says that it is missing.

    Args:
        folder: That holds the results.
        names: Of ``SHOTS``.
    """
    wanted = list(names)
    if BROWSER is None or not all(map(importlib.util.find_spec, ("playwright", "bokeh"))):
        return {name: _missing() for name in wanted}
    from playwright.sync_api import sync_playwright

    found = {}
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=BROWSER, args=ARGUMENTS)
        for results in dict.fromkeys(SHOTS[n].folders for n in wanted):
            paths = [p for name in results for p in folder.rglob(name) if p.is_dir()]
            with served(*paths) as address:
                for name in (n for n in wanted if SHOTS[n].folders == results):
                    found[name] = _shot(chromium, address, SHOTS[name])
        chromium.close()
    return found


def _shot(chromium: Any, address: str, shot: Shot) -> bytes:
    """Return one picture."""
    page = chromium.new_page(viewport={"width": shot.width, "height": 900 if shot.width > 600 else 780})
    page.goto(address + shot.query)
    page.wait_for_function(IDLE, timeout=120_000)
    if shot.wait:
        page.get_by_text(shot.wait).first.wait_for(timeout=300_000)
    page.wait_for_timeout(3000)  # what comes after the first picture
    if shot.time is not None:
        page.evaluate(_MOVED, shot.time)
        page.wait_for_timeout(1000)
    if not shot.region:
        return bytes(page.screenshot())
    page.set_viewport_size({"width": shot.width, "height": page.evaluate("document.documentElement.scrollHeight")})
    page.wait_for_timeout(1500)
    page.evaluate("window.scrollTo(0, 0)")
    box = page.get_by_role("region", name=shot.region, exact=True).bounding_box()
    return bytes(page.screenshot(clip={**box, "height": min(box["height"], 1300)}))


def _missing() -> bytes:
    said = "This picture is taken where Chromium, Playwright and Bokeh are."
    text = f"#set page(width: 16cm, height: auto, margin: 5mm)\n{said}"
    return bytes(typst.compile(text.encode(), format="png", ppi=96))
