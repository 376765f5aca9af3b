"""How fast is ``harness view``: first picture, clicks, a slider, memory; ``python -m bench.view results/mass``.

``--runs 100000`` makes a store of that many runs first, as ``bench.scale`` does. Every time is that of a browser, from
the reader's action until the page shows what belongs to it; the first click compiles and is told apart.
"""

from __future__ import annotations

import argparse
import os
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import numpy as np

from bench import scale
from bench.view_pictures import ARGUMENTS, BROWSER, IDLE

CLICKS, STEPS = 8, 12
SEARCH = "location.search"


def peak(process: int) -> float:
    """Return the largest memory that a process has had, in MiB (Linux)."""
    lines = Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines()
    return float(next(line.split()[1] for line in lines if line.startswith("VmHWM"))) / 1024


def spent(process: int) -> float:
    """Return the processor time that a process has had, in s (Linux)."""
    user, system = Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def until_changed(page: Any, before: str, doing: Any) -> float:
    """Do something and return how long it takes until the address of the page says so."""
    begin = time.perf_counter()
    doing()
    page.wait_for_function(f"{SEARCH} !== {before!r}", timeout=600_000, polling=5)
    return time.perf_counter() - begin


def measure(page: Any, address: str, server: int) -> dict[str, float]:
    """Return the times of a page in s; ``server`` is the process that serves it."""
    begin = time.perf_counter()
    page.goto(address)
    page.wait_for_function(IDLE, timeout=120_000, polling=5)
    found = {"first picture": time.perf_counter() - begin}
    boxes, rank = page.get_by_label("Box", exact=True), page.get_by_label("Its run")
    count = boxes.locator("option").count()
    clicks = []
    for k in range(CLICKS + 1):
        boxes.select_option(index=k % count)
        before = page.evaluate(SEARCH)
        if k == 1:
            begin = spent(server)
        clicks.append(until_changed(page, before, lambda k=k: rank.select_option(["largest", "median"][k % 2])))
        page.wait_for_timeout(1000)
    found["first click, with compilation"] = clicks[0]
    found["click (median)"], found["click (slowest)"] = float(np.median(clicks[1:])), max(clicks[1:])
    found["processor time of the server for a click"] = (spent(server) - begin) / CLICKS
    page.goto(f"{address}?run=0.0.0.0.0&compared=0.1.2")  # three estimators, or those that there are
    page.get_by_text("The scores ").first.wait_for(timeout=600_000)
    page.wait_for_timeout(3000)
    begin = spent(server)
    handle, steps = page.locator("#what-if .noUi-handle").first, []
    handle.focus()
    for k in range(STEPS):
        before = page.evaluate(SEARCH)
        steps.append(
            until_changed(page, before, lambda k=k: handle.press("ArrowRight" if k < STEPS / 2 else "ArrowLeft"))
        )
        page.wait_for_timeout(1500)
    found["step of a slider (median)"], found["step of a slider (slowest)"] = float(np.median(steps)), max(steps)
    found["processor time of the server for a step and the rest after it"] = (spent(server) - begin) / STEPS
    return found


def main() -> None:
    """Measure the page of a result folder."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="result folder; made there with --runs")
    parser.add_argument("--runs", type=int, help="make a store of so many runs first")
    chosen = parser.parse_args()
    if chosen.runs is not None:
        scale.make(chosen.folder, chosen.runs)
    from playwright.sync_api import sync_playwright

    if BROWSER is None:
        sys.exit("needs Chromium on the PATH")
    begin = time.perf_counter()
    command = [sys.executable, "-m", "harness", "view", str(chosen.folder), "--no-browser"]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as server, sync_playwright() as playwright:
        assert server.stdout is not None
        address = server.stdout.readline().strip()
        print(f"start: {time.perf_counter() - begin:.1f} s")
        page = playwright.chromium.launch(executable_path=BROWSER, args=ARGUMENTS).new_page()
        for name, seconds in measure(page, address, server.pid).items():
            print(f"{name}: {seconds:.2f} s")
        print(f"memory of the server: {peak(server.pid):.0f} MiB")
        server.terminate()


if __name__ == "__main__":
    main()
