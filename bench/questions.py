"""The five questions of docs/view.md, by clicking alone: ``python -m bench.questions results/mass results/trace``.

A mouse and lists of the page answer them in Chromium, on the mass study and on a trace. Times run from the first click
until what answers is painted; what is read there is printed. Reading takes its time on top.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from bench.view_pictures import ARGUMENTS, BROWSER, IDLE, served
from harness.common.arguments import Parser

HEAVIER = 2.0
"""Tonnes by which the trailer of the third question becomes heavier."""

_PLACE = """([across, name, what]) => {
    const plot = [...Bokeh.documents[0]._all_models.values()].filter((m) => m.name === 'boxes of runs').at(-1);
    const view = Bokeh.index.find_one(plot);
    const {data} = plot.renderers.map((r) => r.data_source).find((s) => s.data.middle);
    const row = [...data.name].findIndex((n, k) => n === name && Math.round(data.x[k]) === across);
    view.canvas_view.el.scrollIntoView({block: 'center'});
    const box = view.canvas_view.el.getBoundingClientRect();
    return [box.x + view.frame.x_scale.compute(data.x[row]), box.y + view.frame.y_scale.compute(data[what][row])];
}"""
_ENDS = """() => {
    const slider = [...Bokeh.documents[0]._all_models.values()].find((m) => m.title?.startsWith?.('trailer mass'));
    return slider.end - slider.start;
}"""


def _click(page: Any, across: int, estimator: str, what: str) -> None:
    """Click the largest run of a box, ``most``, or its median, ``middle``, and wait until the run is drawn."""
    page.wait_for_timeout(300)  # the boxes may just have been renewed
    page.mouse.click(*page.evaluate(_PLACE, [across, estimator, what]))
    page.get_by_text("The scores are those of the store").first.wait_for(timeout=300_000)


def _choose(page: Any, label: str, option: str, in_address: str) -> None:
    """Choose from a list and wait until the address tells it."""
    page.get_by_label(label, exact=True).select_option(option)
    page.wait_for_function(f"location.search.includes('{in_address}')")


def _scores(page: Any, *names: str) -> str:
    """Return the rows of the table of a run that begin with these names."""
    rows = page.locator("#what-if table tbody tr").all_inner_texts()
    return "\n".join("  " + "  ".join(r.split("\t")) for r in rows if r.startswith(names))


def _worst_drive(page: Any) -> str:
    _choose(page, "Boxes", "by drive, at 8 t", "level=0")
    offered = page.get_by_label("Box", exact=True).locator("option").all_inner_texts()
    medians = [float(o.rsplit("median ", 1)[1].split()[0]) for o in offered if ", EKF:" in o]
    _click(page, medians.index(max(medians)), "EKF", "most")
    axles = page.locator("table.axles tr").all_inner_texts()
    return "\n".join(["  " + "  ".join(row.split("\t")) for row in axles] + [_scores(page, "EKF:")])


def _where_lost(page: Any) -> str:
    _choose(page, "Target", "articulation angle", "target=1")
    _click(page, 6, "EKF", "most")
    _choose(page, "Path coloured by", "error of EKF: articulation angle", "colour=")
    return _scores(page, "EKF: RMSE, articulation")


def _two_tonnes(page: Any) -> str:
    _click(page, 4, "EKF", "middle")
    handle, track = page.locator("#what-if .noUi-handle").first, page.locator("#what-if .noUi-base").first
    handle.scroll_into_view_if_needed()
    box, way = handle.bounding_box(), HEAVIER / page.evaluate(_ENDS) * track.bounding_box()["width"]
    x, y = box["x"] + box["width"] / 2, box["y"] + box["height"] / 2
    page.mouse.move(x, y)
    page.mouse.down()
    page.mouse.move(x + way, y, steps=10)
    page.mouse.up()
    said = page.get_by_text("This run is in no store")
    said.wait_for(timeout=60_000)
    return f"  {said.inner_text()}\n{_scores(page, 'EKF: RMSE')}"


def _whose_outlier(page: Any) -> str:
    _click(page, 6, "PF", "most")
    return "\n".join(_scores(page, f"{name}: RMSE, lateral", f"{name}: NIS") for name in ("KF", "EKF", "PF"))


def _what_changed(page: Any) -> str:
    _choose(page, "Output", "lateral acceleration", "output=1")
    return "\n".join("  " + line for line in page.get_by_text("Simulation error of the").all_inner_texts())


QUESTIONS = {
    "Which drive makes the EKF worst at 8 t, and why?": ("mass", _worst_drive),
    "Where on the road is the articulation angle lost?": ("mass", _where_lost),
    "What do two tonnes more do?": ("mass", _two_tonnes),
    "Is the particle filter's outlier the plant's or its own?": ("mass", _whose_outlier),
    "What did the amended model change?": ("trace", _what_changed),
}


def answers(chromium: Any, addresses: dict[str, str]) -> Iterator[str]:
    """Give each question with its time and what is read."""
    browser = chromium.new_context(viewport={"width": 1280, "height": 900})
    for question, (page_of, answer) in QUESTIONS.items():
        page = browser.new_page()
        page.goto(addresses[page_of])
        addresses[page_of] = page.url.partition("?")[0]  # the first one opens once
        page.wait_for_function(IDLE, timeout=120_000)
        begin = time.perf_counter()
        read = answer(page)
        page.evaluate("new Promise((done) => requestAnimationFrame(() => requestAnimationFrame(done)))")
        yield f"{time.perf_counter() - begin:.1f} s  {question}\n{read}"
        page.close()


def main() -> None:
    """Answer the five questions."""
    parser = Parser(description=__doc__)
    parser.add_argument("mass", type=Path, help="results of the mass study")
    parser.add_argument("trace", type=Path, help="results of a trace")
    chosen = parser.parse_args()
    from playwright.sync_api import sync_playwright

    with (
        served(chosen.mass.resolve()) as mass,
        served(chosen.trace.resolve()) as trace,
        sync_playwright() as playwright,
    ):
        if BROWSER is None:
            sys.exit("needs Chromium on the PATH")
        chromium = playwright.chromium.launch(executable_path=BROWSER, args=ARGUMENTS)
        for answer in answers(chromium, {"mass": mass, "trace": trace}):
            print(answer, flush=True)


if __name__ == "__main__":
    main()
