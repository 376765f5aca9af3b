"""Speed of ``harness view``: first picture, clicks, a slider, memory; ``python -m bench.view results/mass``.

``--runs 100000`` makes a store of that many runs first, as ``bench.scale`` does. Every time is that of a browser, from
the reader's action until the page shows what belongs to it. The first click of each estimator loads or compiles it, and
is told apart. Processor times say what a machine takes that does other work as well.
"""

from __future__ import annotations

import contextlib
import os
import subprocess
import sys
import time
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from bench import scale
from bench.view_pictures import ARGUMENTS, BROWSER, IDLE
from harness.common.arguments import Parser

CLICKS, STEPS = 8, 12
STEP = 6
"""Pixels by which a slider is dragged."""

REST = 1500
"""Time in ms between two actions of the reader."""

LISTEN = """() => {
    window.said = '';
    if (window.listening) return;
    window.listening = true;
    const verdict = Bokeh.documents[0].get_model_by_name('verdict');
    verdict.properties.text.change.connect(() => { window.said = verdict.text; });
}"""


def peak(process: int) -> float:
    """Return the largest memory that a process has had, in MiB (Linux)."""
    lines = Path(f"/proc/{process}/status").read_text(encoding="utf-8").splitlines()
    return float(next(line.split()[1] for line in lines if line.startswith("VmHWM"))) / 1024


def spent(process: int) -> float:
    """Return the processor time that a process has had, in s (Linux)."""
    user, system = Path(f"/proc/{process}/stat").read_text(encoding="utf-8").rpartition(")")[2].split()[11:13]
    return (int(user) + int(system)) / os.sysconf("SC_CLK_TCK")


def browser_spent(server: int) -> float:
    """Return the processor time of the browser in s: of all processes that began here, but for the server (Linux)."""
    parents, total = {}, 0.0
    for path in Path("/proc").glob("[0-9]*/stat"):
        with contextlib.suppress(OSError):
            parents[int(path.parent.name)] = int(path.read_text(encoding="utf-8").rpartition(")")[2].split()[1])
    for process in parents:
        above = process
        while above in parents and above not in (server, os.getpid()):
            above = parents[above]
        if above == os.getpid() != process:
            with contextlib.suppress(OSError):
                total += spent(process)
    return total


def until_painted(page: Any, doing: Callable[[], Any]) -> float:
    """Do something and return how long it takes until the page says what came of it, and has painted it."""
    page.evaluate(LISTEN)
    begin = time.perf_counter()
    doing()
    page.wait_for_function("window.said && !window.said.startsWith('Computing')", timeout=120_000, polling=5)
    page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
    return time.perf_counter() - begin


def timed(page: Any, server: int, doing: Sequence[Callable[[], Callable[[], Any]]]) -> tuple[list[float], str]:
    """Do one thing after the other; return the time of each, and in words what processor time one takes.

    Each is called and gives what is done then, from which on time counts.
    """
    times, begin = [], (spent(server), browser_spent(server))
    for each in doing:
        times.append(until_painted(page, each()))
        page.wait_for_timeout(REST)
    own, other = ((now - b) / len(doing) for now, b in zip((spent(server), browser_spent(server)), begin, strict=True))
    return times, f"{own:.2f} s of the server's processor time, {other:.2f} s of the browser's"


def _span(times: Sequence[float]) -> str:
    """Say the median and the extremes: where others work on the machine, the smallest is nearest to a free one."""
    return f"{np.median(times):.2f} s, {min(times):.2f} to {max(times):.2f} s"


def measure(page: Any, address: str, server: int) -> Iterator[str]:
    """Give the times of a page in words; ``server`` is the process that serves it."""
    begin = time.perf_counter()
    page.goto(address)
    address = page.url.partition("?")[0]  # the first one opens once
    page.wait_for_function(IDLE, timeout=120_000, polling=5)
    yield f"first picture: {time.perf_counter() - begin:.2f} s"
    boxes, rank = page.get_by_label("Box", exact=True), page.get_by_label("Its run")
    count = boxes.locator("option").count()
    estimators = page.evaluate("Bokeh.documents[0].get_model_by_name('compared').labels.length")

    def click(k: int, which: int) -> Callable[[], Callable[[], Any]]:
        def choose() -> Callable[[], Any]:
            boxes.select_option(index=k % count)
            return lambda: rank.select_option(["largest", "median"][which % 2])

        return choose

    first, _ = timed(page, server, [click(0, 0)])
    yield f"first click: {first[0]:.2f} s"
    others, _ = timed(page, server, [click(k, k) for k in range(1, estimators)]) if estimators > 1 else ([], "")
    if others:
        yield f"first click of each further estimator: at most {max(others):.2f} s"
    clicks, cost = timed(page, server, [click(k * (estimators + 1) + 1, k) for k in range(CLICKS)])
    yield f"click: {_span(clicks)}; {cost}"
    page.goto(f"{address}?run=0.0.0.0.0&compared=0.1.2")  # three estimators, or those that there are
    page.get_by_text("The scores ").first.wait_for(timeout=600_000)
    page.wait_for_timeout(2 * REST)
    yield from _dragged(page, server)


def _dragged(page: Any, server: int) -> Iterator[str]:
    """Drag the first slider to and fro, and give the time of a step in words."""
    handle = page.locator("#what-if .noUi-handle").first
    handle.scroll_into_view_if_needed()
    page.wait_for_timeout(2 * REST)
    box = handle.bounding_box()
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    ways = [STEP * (1 + min(k, STEPS - 2 - k)) for k in range(STEPS)]
    moves = [lambda to=x + way: lambda: page.mouse.move(to, y) for way in ways]
    steps, cost = timed(page, server, moves)
    page.mouse.up()
    yield f"step of a slider: {_span(steps)}; {cost}"


def main() -> None:
    """Measure the page of a result folder."""
    parser = Parser(description=__doc__)
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
        for line in measure(page, address, server.pid):
            print(line, flush=True)
        print(f"memory of the server: {peak(server.pid):.0f} MiB")
        server.terminate()


if __name__ == "__main__":
    main()
