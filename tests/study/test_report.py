"""The report's files: whole, self-contained, reproducible, and written for every shape of study."""

from __future__ import annotations

import os
import re
import subprocess
import sys

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.reporting import style
from harness.reporting.document import render, source
from harness.study.report import analyse, report, write_report
from harness.study.report.opening import sentences
from support import synthetic
from support.report_parts import ANGLE, Page, everything, everything_at_8_t, pages


@pytest.fixture(scope="module")
def files(mass):
    """HTML and PDF of the mass study."""
    return write_report(analyse(mass))


def test_both_files_are_written_and_whole(mass, files):
    folder = mass
    assert files == [folder / "report.html", folder / "report.pdf"]
    assert sorted(p.name for p in folder.iterdir()) == ["report.html", "report.pdf", "run.json", "scores.zarr"]
    pdf = files[1].read_bytes()
    assert pdf.startswith(b"%PDF-")
    assert pdf.rstrip().endswith(b"%%EOF")
    assert 8 <= pages(pdf) <= 16


def test_html_needs_nothing_from_outside(files):
    html = files[0].read_text(encoding="utf-8")
    page = Page(html)
    assert all(link.startswith(("data:", "#")) for link in page.links)
    assert set(re.findall(r"url\((.)", html)) == {"#"}
    assert "@import" not in html
    assert page.tags.count("script") == 1
    assert "<script src" not in html
    assert page.tags.count("svg") == 7
    assert "math" in page.tags
    assert page.tags.count("h1") == 1


def test_the_answer_comes_first_and_its_numbers_are_those_of_the_store(mass, mass_designs, files):
    text = Page(files[0].read_text(encoding="utf-8")).text
    data = mass_designs["level"]
    force = data["rmse"].sel(target="lateral_force_axle_21").where(data["status"] == 0) / 1000
    matched = float(force.isel(band=4, estimator=0).median())
    light = float(force.isel(band=0, estimator=0).median())
    opening = text[: text.index("Table 3")]
    best, harms, counts = sentences(analyse(mass))
    said = [opening.index(sentence) for sentence in (*best, *harms, *counts)]
    assert said == sorted(said)
    assert said[-1] < opening.index("Figure 1") < opening.index("Table 1")
    assert opening.index("How wrong do the estimators get") < opening.index("Answer")
    assert "Median RMSE as believed (24 t) with its 95 % interval" in opening
    assert f"{style.number(light)} ({style.number(light / matched, 2)}×)" in opening
    assert "In the run drawn at 8 t the true lateral force axle 21 lies within ± 2σ" in opening
    assert "EKF in 1; UKF in 4, all on steady-circle." in opening
    assert "In 3 of 984 runs (3 of 840 in the design “level”) the vehicle itself goes out of control" in opening


def test_the_report_says_how_it_was_made(files):
    text = Page(files[0].read_text(encoding="utf-8")).text
    for part in ("0123456789abcdef", "abcdef0", "numpy 2.0.0", "41.5 s", "72.9 runs per second", "10.0 ms"):
        assert part in text
    assert '"quoted", #hash, $dollar$, *star*, \\back <tag> & [bracket] `tick` @at' in text
    assert "840 simulated drives" in text
    assert re.search(r"trailer mass\s*8000 kg\s*24000 kg", text)
    assert re.search(r"process\s*lateral force axle 21\s*kN\s*0\.0316\s*–\s*1000\s*–", text)


@pytest.mark.proof
def test_the_same_store_gives_the_same_bytes(small):
    """In another process, since the order of a set depends on the process."""
    files = write_report(analyse(small))
    before = [path.read_bytes() for path in files]
    command = "import sys; from harness.study.report import analyse, write_report; write_report(analyse(sys.argv[1]))"
    environment = {**os.environ, "PYTHONHASHSEED": "42"}
    subprocess.run([sys.executable, "-c", command, small], check=True, env=environment)
    assert before == [path.read_bytes() for path in files]


@pytest.mark.parametrize(
    "options",
    [
        {"estimators": ("EKF",), "levels": (24.0,), "repeats": 1},
        {
            "estimators": ("EKF", "UKF", "CDKF", "ST-CDKF", "PF", "NARX", "KF", "mine"),
            "levels": (16.0, 24.0),
            "targets": ANGLE,
        },
        {"levels": tuple(np.linspace(10, 30, 12)), "band": 0.02, "samples": 4, "repeats": 1, "targets": ANGLE},
        {"status": everything_at_8_t, "targets": {"speed": ("m/s", 0.1), "something_new": ("W", 5.0)}},
        {"status": everything, "levels": (16.0, 24.0)},
        {
            "targets": {f"lateral_force_axle_{a}": ("N", 900.0) for a in (11, 12, 21, 22, 23)},
            "levels": (8.0, 12.0),
            "drives": ("roundabout",),
        },
    ],
    ids=["one of each", "eight estimators", "many bands", "a level lost, new target", "all lost", "five, unmatched"],
)
def test_any_study_gets_a_report(one_design, options):
    analysis = one_design(**options)
    made = report(analysis)
    text, files = source(made)
    assert "nan" not in re.findall(r"[a-z]+", text)
    assert all(sentence in text for part in sentences(analysis) for sentence in part)
    assert all(svg.startswith(b"<?xml") for svg in files.values())
    assert ("Which estimator is better" in text) == (len(analysis.main.design.estimators) > 1)
    if len(analysis.main.design.estimators) > 3:  # tables that go on over pages
        assert pages(render(made)[1]) >= 5


def test_errors_name_the_folder(tmp_path):
    with pytest.raises(UserError, match=r"scores.zarr is missing"):
        analyse(tmp_path)
    (tmp_path / "scores.zarr").mkdir()
    with pytest.raises(UserError, match="not a store that a study wrote"):
        analyse(tmp_path)
    folder = synthetic.write(tmp_path / "other", {"level": synthetic.design(repeats=1)})
    for content in (b"{", b'{"started": "\xff"}', b"[1]", b'{"runs": null}', b'{"runs_per_s": NaN}', b"[" * 99_999):
        (folder / "run.json").write_bytes(content)
        with pytest.raises(UserError, match=r"run.json: is damaged or no JSON text: .*; delete it"):
            analyse(folder)
