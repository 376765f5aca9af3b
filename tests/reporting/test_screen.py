"""What the HTML of a report does on screen: in its text, and in a browser where there is one."""

import base64
import hashlib
import json
import re
import shutil
import subprocess

import numpy as np
import pytest

from harness.reporting import style
from harness.reporting.document import Picture, Report, Sheet, render

NASTY = "\"><script>alert(1)</script>&'{x}"
BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
in_a_browser = pytest.mark.skipif(BROWSER is None, reason="needs Chromium on the PATH")


def _picture(names: list[str]) -> Picture:
    with style.drawing():
        fig = style.figure(2.0)
        axes = fig.subplots()
        for number, name in enumerate(names):
            style.mark(axes.plot([0, 1], [number, 1], "o"), name, f"{name}: {number} kN")
        return Picture(style.svg(fig), "Two series.", f"Of {names[0]}")


@pytest.fixture(scope="module")
def page() -> str:
    """Two figures with the same series, one with a nasty name, and a table of groups of rows."""
    rows = [["b", "10.0 to 12.0"], ["", "second row of b"], ["a", "9.50"], ["c", "–"], ["d", "4.5·10³"], ["e", "−3.0"]]
    rows += [[f"more {k}", f"{100 + k}"] for k in range(6)]
    sheet = Sheet(["name", "value in kN"], rows, "A table.", left=1)
    return render(Report("Title", [_picture(["EKF", NASTY]), _picture(["EKF", "UKF"]), sheet]))[0].decode()


def test_figures_are_part_of_the_page_and_say_their_numbers(page):
    assert page.count("<svg ") == 2
    assert "<img" not in page
    assert page.count('data-series="EKF"') == 2
    assert "<title>EKF: 0 kN</title>" in page
    ids = re.findall(r' id="([^"]*)"', page)
    assert len(ids) == len(set(ids)) > 10
    used = set(re.findall(r'(?:href="#|url\(#)([^")]+)', page))
    assert used <= set(ids)


def test_a_name_never_becomes_code(page):
    assert "<script>alert" not in page
    assert "&lt;script&gt;alert(1)&lt;/script&gt;" in page
    (script,) = re.findall(r"<script>(.*?)</script>", page, re.DOTALL)
    allowed = base64.b64encode(hashlib.sha256(script.encode()).digest()).decode()
    assert f"default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'sha256-{allowed}'" in page


def _after(page: str, path, doing: str) -> str:
    """Return the page after a reader has done something, as a browser has it; errors of the console fail."""
    steps = f"<script>{doing}</script></body>"
    path.write_text(re.sub(r'<meta http-equiv="Content-Security-Policy"[^>]*>', "", page).replace("</body>", steps))
    return _opened(path)


def _opened(path) -> str:
    quiet = ["--headless", "--no-sandbox", "--disable-gpu", "--enable-logging=stderr", "--dump-dom"]
    done = subprocess.run([BROWSER, *quiet, path.as_uri()], capture_output=True, text=True, timeout=120)
    assert "CONSOLE" not in done.stderr
    return done.stdout


@in_a_browser
def test_the_page_as_written_runs_its_script_under_its_policy(page, tmp_path):
    (tmp_path / "page.html").write_text(page)
    seen = _opened(tmp_path / "page.html")
    assert seen.count('<fieldset class="tools">') == 2
    assert seen.count("<button") == 2


@in_a_browser
def test_a_series_is_switched_off_in_all_figures(page, tmp_path):
    seen = _after(page, tmp_path / "page.html", "document.querySelector('.tools input[value=EKF]').click()")
    marks = re.findall(r"<g [^>]*data-series[^>]*>", seen)
    assert [("EKF" in m, "display: none" in m) for m in marks] == [(True, True), (False, False)] * 2


def _errors(values: dict[str, float], scale: str) -> str:
    """A page with a panel of errors, one point for each series."""
    with style.drawing():
        fig = style.figure(2.0)
        axes = fig.subplots()
        for name, value in values.items():
            style.mark(axes.plot([0, 1], [value, value]), name)
            style.mark(axes.plot([0.5], [value], "o"), name)
        axes.set_yscale(scale)
        axes.set_ylim(min(values.values()) / 2 if scale == "log" else 0.0, 1.1 * max(values.values()))
        style.rescalable(axes)
        picture = Picture(style.svg(fig), "Errors.", "Errors")
    return render(Report("Title", [picture]))[0].decode()


_SEEN = """
const axis = document.querySelector('[data-axis]'), panel = axis.parentNode.querySelector('path').getBBox();
const share = ({y, height}) => 1 - (y + height / 2 - panel.y) / panel.height;
const heights = [...document.querySelectorAll('[data-series]')].map((mark) => share(mark.getBBox()));
document.title = JSON.stringify([heights, [...axis.querySelectorAll('text')].map((text) => Number(text.textContent))]);
"""


def _seen(values: dict[str, float], scale: str, path, doing: str) -> tuple[list[float], list[float]]:
    """Return how far up the panel line and point of each series are after a reader did something, and the numbers."""
    page = _after(_errors(values, scale), path / "page.html", f"onload = () => {{ {doing};{_SEEN} }}")
    heights, numbers = json.loads(re.search(r"<title>(.*?)</title>", page)[1])
    return heights, numbers


@in_a_browser
@pytest.mark.parametrize("scale", ["linear", "log"])
def test_an_axis_is_as_long_as_the_series_that_are_shown_need(tmp_path, scale):
    off = "document.querySelector('.tools input[value=PF]').click()"
    heights, numbers = _seen({"EKF": 2.0, "UKF": 4.0, "PF": 4000.0}, scale, tmp_path, off)
    expected = [2 / 4.2, 4 / 4.2] if scale == "linear" else np.log([2 / 1.5, 4 / 1.5]) / np.log(5.4 / 1.5)
    assert heights[:4] == pytest.approx(np.repeat(expected, 2), abs=1e-3)
    assert numbers == ([0, 1, 2, 3, 4] if scale == "linear" else [2, 5])


@in_a_browser
@pytest.mark.parametrize("scale", ["linear", "log"])
def test_the_scale_of_an_axis_is_switched(tmp_path, scale):
    switch = "document.querySelector('div.tools input').click()"
    heights, numbers = _seen({"EKF": 2.0, "PF": 4000.0}, scale, tmp_path, switch)
    share = np.log(1 / 0.75) / np.log(1.35 / 0.75 * 2000) if scale == "linear" else 2 / 4200
    assert heights[:2] == pytest.approx([share] * 2, abs=1e-3)
    assert numbers == ([10, 100, 1000] if scale == "linear" else [0, 1000, 2000, 3000, 4000])


@in_a_browser
def test_tables_are_sorted_by_numbers_with_the_rows_that_belong_together(page, tmp_path):
    doing = "document.querySelectorAll('th button')[1].click()"
    rising = _column(_after(page, tmp_path / "page.html", doing))
    assert rising[:4] == ["e", "a", "b", ""]
    assert rising[-2:] == ["d", "c"]  # 4500 is the largest; what has no number comes last
    falling = _column(_after(page, tmp_path / "page.html", f"{doing};{doing}"))
    assert falling[0] == "d"
    assert falling[-4:] == ["", "a", "e", "c"]
    again = _column(_after(page, tmp_path / "page.html", f"{doing};{doing};{doing}"))
    assert again[:4] == ["b", "", "a", "c"]


@in_a_browser
def test_rows_are_found_by_what_they_hold(page, tmp_path):
    typed = "f.value = 'MORE'; f.dispatchEvent(new Event('input', {bubbles: true}))"
    doing = f"const f = document.querySelector('[type=search]'); {typed}"
    seen = _after(page, tmp_path / "page.html", doing)
    body = seen[seen.index("<tbody") : seen.index("</tbody")]
    assert body.count('<tr hidden=""') == 6


@in_a_browser
def test_on_a_phone_a_figure_keeps_its_size_and_rolls(page, tmp_path):
    wide = "e => [e.scrollWidth > e.clientWidth, e.querySelector('svg').clientWidth, e.clientWidth]"
    framed = page.replace("<body>", '<body><iframe width=390 height=800 srcdoc="X"></iframe>', 1)
    assert framed != page
    doing = (
        "const f = document.querySelector('iframe'), d = f.contentDocument;"
        "d.documentElement.innerHTML = [...document.querySelectorAll('style')].map(s => s.outerHTML).join('')"
        " + document.querySelector('figure:has(svg)').outerHTML;"
        f"document.title = JSON.stringify(({wide})(d.querySelector('figure')))"
    )
    seen = _after(framed, tmp_path / "page.html", f"onload = () => {{ {doing} }}")
    rolls, size, frame = json.loads(re.search(r"<title>(.*?)</title>", seen)[1])
    assert rolls
    assert size > 540  # 9 points of print are 10 pixels then
    assert frame < 390


def _column(seen: str) -> list[str]:
    body = seen[seen.index("<tbody") : seen.index("</tbody")]
    return re.findall(r"<tr[^>]*>\s*<td[^>]*>(.*?)</td>", body, re.DOTALL)
