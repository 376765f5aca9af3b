"""A finished study with names that no page may take for code, and its page."""

import copy
import io
import shutil

import pytest
from rich.console import Console

from harness.config import build_study
from harness.study.run import run_study
from support.page_served import entered, served
from support.stored_results import NASTY, write_results

STUDY = {
    "name": "car",
    "title": f"How heavy may it be? {NASTY}",
    "seed": 11,
    "targets": ["lateral_velocity"],
    "plant": {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "magic_formula", "sensors": "car_series"},
    "drive": [
        {"name": f"weave {NASTY}", "kind": "sine", "duration": 6, "amplitude": "20 deg"},
        {"name": "fast", "kind": "sine", "duration": 4, "amplitude": "30 deg", "speed": "30 m/s"},
    ],
    "estimator": [{"name": "EKF", "kind": "ekf"}, {"name": NASTY, "kind": "ukf", "alpha": 0.5}],
    "design": [
        {"name": "mass", "repeats": 6, "factor": [{"parameter": "mass", "levels": ["1.5 t", "1.9 t"]}]},
        {
            "name": "all",
            "sampling": "saltelli",
            "samples": 16,
            "factor": [
                {"parameter": "mass", "range": ["1.4 t", "1.9 t"]},
                {"parameter": "process_noise_scale", "range": [0.1, 10], "scale": "log"},
            ],
        },
    ],
}


def _run(out, study):
    run_study(build_study(study), out, jobs=1, console=Console(file=io.StringIO()))
    return out


@pytest.fixture(scope="package")
def folder(tmp_path_factory):
    return _run(tmp_path_factory.mktemp("view") / "car", STUDY)


@pytest.fixture(scope="package")
def other(tmp_path_factory):
    """The same runs with another UKF, as its spread of sigma points makes it."""
    study = copy.deepcopy(STUDY)
    study["estimator"][1]["alpha"] = 0.05
    study["design"] = study["design"][:1]
    return _run(tmp_path_factory.mktemp("other") / "car-other", study)


@pytest.fixture(scope="package")
def unlike(tmp_path_factory):
    """Other runs, at levels of which one is that of the others."""
    study = copy.deepcopy(STUDY)
    study |= {"seed": 12, "design": [copy.deepcopy(STUDY["design"][0]) | {"name": "heavy"}]}
    study["design"][0]["factor"][0]["levels"] = ["1.9 t", "2.1 t"]
    return _run(tmp_path_factory.mktemp("unlike") / f"car {NASTY.replace('/', '')}", study)


@pytest.fixture(scope="package")
def results(tmp_path_factory):
    """A folder of a campaign, a trace, a fit and a check."""
    folder = tmp_path_factory.mktemp("results")
    write_results(folder)
    return folder


@pytest.fixture(scope="package")
def address(folder):
    with served(folder) as found:
        assert found.startswith("http://127.0.0.1:")
        yield found


@pytest.fixture(scope="package")
def address_of_results(tmp_path_factory, folder):
    """Of a folder with a study, a campaign, a trace, a fit and a check, and that check four times more."""
    results = tmp_path_factory.mktemp("everything")
    write_results(results)
    for k in range(4):  # so many rows that a word filters them
        shutil.copytree(results / "check", results / f"z-check-{k}")
    shutil.copytree(folder, results / "study")
    with served(results) as found:
        yield found


@pytest.fixture(scope="package")
def address_of_three(folder, other, unlike):
    with served(folder, other, unlike) as found:
        yield found


BROWSER = next(filter(None, map(shutil.which, ("chromium", "chromium-browser", "google-chrome"))), None)
QUIET = [
    "--no-sandbox", "--disable-gpu", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync",
]  # fmt: skip


@pytest.fixture(scope="module")
def browser():
    if BROWSER is None:
        pytest.skip("needs Chromium on the PATH")
    api = pytest.importorskip("playwright.sync_api")
    with api.sync_playwright() as playwright:
        chromium = playwright.chromium.launch(executable_path=BROWSER, args=QUIET)
        yield chromium
        chromium.close()


@pytest.fixture
def visit(browser):
    """Open an address; at the end nothing may have gone wrong, nothing come from elsewhere, and no name be code."""
    context, wrong = browser.new_context(viewport={"width": 1280, "height": 900}), []

    def opened(address, query=""):
        address, name, value = entered(address)
        context.add_cookies([{"name": name, "value": value, "url": address}])
        page = context.new_page()
        page.on("console", lambda m: wrong.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda e: wrong.append(str(e)))
        page.on("request", lambda r: wrong.append(r.url) if not r.url.startswith((address, "data:", "blob:")) else None)
        page.goto(address + query)
        page.wait_for_function("window.Bokeh && Bokeh.documents.length && Bokeh.documents[0].is_idle", timeout=60_000)
        return page

    yield opened
    hits = [page.evaluate("window.hit") for page in context.pages]
    context.close()
    assert wrong == []
    assert set(hits) <= {None}
