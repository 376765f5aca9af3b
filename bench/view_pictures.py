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

BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
ARGUMENTS = [
    "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip
WIDTH = 960
"""Of the window in pixels: what it shows can be read where a picture is 800 pixels wide."""

IDLE = "window.Bokeh && Bokeh.documents.length && Bokeh.documents[0].is_idle"


@dataclass(frozen=True)
class Shot:
    """A picture.

    Attributes:
        folders: Names of the result folders.
        query: Of the address.
        region: Section of the page, by its label.
        wait: Words that the page says when it is ready.
    """

    folders: tuple[str, ...]
    query: str = ""
    region: str = ""
    wait: str = ""


_STORED = "The scores are those of the store"
SHOTS = {
    "view-boxes": Shot(("gallery",), "?design=0&run=0.0.1.0.3&compared=0.1", "Distribution of the score", _STORED),
    "view-above": Shot(("mass-quick",), "?design=0&run=0.0.0.0.3&compared=1.6", "From above", _STORED),
    "view-factors": Shot(("gallery",), "?design=1", "Points of the design"),
    "view-studies": Shot(("gallery", "navigation", "tyre-brush"), "?run=1.0.1.1.0.3", "Distribution of the score"),
    "view-trace": Shot(("trace",), region="Before and after"),
    "view-check": Shot(("check",), region="Signals over time"),
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
    """Return pictures as PNG by their name; none without Chromium, Playwright and Bokeh.

    Args:
        folder: That holds the results.
        names: Of ``SHOTS``.
    """
    wanted = list(names)
    if BROWSER is None or not all(map(importlib.util.find_spec, ("playwright", "bokeh"))):
        return {}
    from playwright.sync_api import sync_playwright

    pictures = {}
    with sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=BROWSER, args=ARGUMENTS)
        for results in dict.fromkeys(SHOTS[n].folders for n in wanted):
            paths = [p for name in results for p in folder.rglob(name) if p.is_dir()]
            browser = chromium.new_context(viewport={"width": WIDTH, "height": 900})
            with served(*paths) as address:
                for name in (n for n in wanted if SHOTS[n].folders == results):
                    address, pictures[name] = _shot(browser, address, SHOTS[name])
        chromium.close()
    return pictures


def _shot(browser: Any, address: str, shot: Shot) -> tuple[str, bytes]:
    """Return the address for further ones, since the first opens once, and one picture."""
    page = browser.new_page()
    page.goto(address + shot.query)
    page.wait_for_function(IDLE, timeout=120_000)
    if shot.wait:
        page.get_by_text(shot.wait).first.wait_for(timeout=120_000)
    page.wait_for_timeout(3000)  # what comes after the first picture
    page.set_viewport_size({"width": WIDTH, "height": page.evaluate("document.documentElement.scrollHeight")})
    page.wait_for_timeout(1500)
    page.evaluate("window.scrollTo(0, 0)")
    box = page.get_by_role("region", name=shot.region, exact=True).bounding_box()
    picture = page.screenshot(clip={"x": 0, "y": box["y"], "width": WIDTH, "height": box["height"]})
    return page.url.partition("?")[0], bytes(picture)
