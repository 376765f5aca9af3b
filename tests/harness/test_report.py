"""The report of a synthetic store: right numbers, whole files, and every shape of study."""

from __future__ import annotations

import io
import json
import os
import re
import subprocess
import sys
from html.parser import HTMLParser

import numpy as np
import pytest
import synthetic
from matplotlib.backends.backend_svg import RendererSVG
from matplotlib.lines import Line2D

from harness.errors import UserError
from harness.report import _SECTIONS, headline, style, write_report
from harness.report.analysis import Analysis, Findings
from harness.report.document import Bullets, Document, Heading, Listing, Picture, Prose, Sheet, plain, render, source
from harness.report.opening import answer_in_short
from harness.report.sections import answer, boxes, consistency, drives, history, made, paired, scatter
from harness.report.store import Quantity, print_unit, quantity, read

_ANGLE = {"articulation_angle": ("rad", 0.012)}


class Page(HTMLParser):
    """Text, links and tags of an HTML page."""

    def __init__(self, html: str):
        super().__init__()
        self.words: list[str] = []
        self.links: list[str] = []
        self.tags: list[str] = []
        self.feed(html)

    def handle_starttag(self, tag, attrs):
        self.tags.append(tag)
        self.links += [value for key, value in attrs if key in ("src", "href") and value]

    def handle_data(self, data):
        self.words.append(data)

    @property
    def text(self) -> str:
        return " ".join("".join(self.words).split())


def _pages(pdf: bytes) -> int:
    """Page count of a PDF; Typst writes the page tree as plain text."""
    counts = re.findall(rb"/Type /Pages\s*/Count (\d+)", pdf) or re.findall(rb"/Count (\d+)", pdf)
    return max(int(c) for c in counts)


def _lose(fates: np.ndarray) -> None:
    """Plant lost in 3 runs, UKF in 4 more, all at 8 t; one failure of EKF at 32 t."""
    fates[0, 0, 5, :3, :] = 2
    fates[0, 0, 4, :4, 1] = 1
    fates[6, 0, 3, 0, 0] = 3


@pytest.fixture(scope="module")
def mass(tmp_path_factory):
    """The mass study with lost runs, a history and its report."""
    designs = {
        "level": synthetic.design(status=_lose),
        "band": synthetic.design(levels=(8.0, 24.0, 32.0), band=0.05, samples=8, repeats=1, seed=2),
    }
    folder = synthetic.write(
        tmp_path_factory.mktemp("mass"),
        designs,
        runs=[synthetic.history()],
    )
    files = write_report(folder)
    return folder, files, designs


@pytest.fixture(scope="module")
def small(tmp_path_factory):
    """A small study with a history and its report."""
    level = synthetic.design(levels=(16.0, 24.0), drives=synthetic.DRIVES[:1], repeats=4, targets=_ANGLE)
    run = synthetic.history(extra="stiffness_factor").isel(target=[1, 3])
    folder = synthetic.write(tmp_path_factory.mktemp("small"), {"level": level}, runs=[run])
    return folder, write_report(folder)


@pytest.fixture
def one_design(tmp_path):
    """Write a study of one small design and return its analysis."""

    def make(**options) -> Analysis:
        folder = synthetic.write(
            tmp_path / "study", {"level": synthetic.design(**{"repeats": 3, "drives": synthetic.DRIVES[:2], **options})}
        )
        return Analysis(read(folder))

    return make


def test_both_files_are_written_and_whole(mass):
    folder, files, _ = mass
    assert files == [folder / "report.html", folder / "report.pdf"]
    assert sorted(p.name for p in folder.iterdir()) == ["report.html", "report.pdf", "run.json", "scores.zarr"]
    pdf = files[1].read_bytes()
    assert pdf.startswith(b"%PDF-")
    assert pdf.rstrip().endswith(b"%%EOF")
    assert 8 <= _pages(pdf) <= 16


def test_html_needs_nothing_from_outside(mass):
    html = mass[1][0].read_text(encoding="utf-8")
    page = Page(html)
    assert page.links
    assert all(link.startswith(("data:", "#")) for link in page.links)
    assert "url(" not in html
    assert "@import" not in html
    assert "script" not in page.tags
    assert page.tags.count("img") == 9
    assert "math" in page.tags
    assert page.tags.count("h1") == 1


def test_the_answer_comes_first_and_its_numbers_are_those_of_the_store(mass):
    _, files, designs = mass
    text = Page(files[0].read_text(encoding="utf-8")).text
    data = designs["level"]
    force = data["rmse"].sel(target="lateral_force_axle_21").where(data["status"] == 0) / 1000
    matched = float(force.isel(band=4, estimator=0).median())
    light = float(force.isel(band=0, estimator=0).median())
    opening = text[: text.index("Figure 1")]
    assert opening.index("How wrong do the estimators get") < opening.index("Answer")
    assert f"(24 t) the median RMSE is {matched:.3g} kN for EKF" in opening
    assert f"At 8 t it is {light:.3g} kN for EKF ({light / matched:.2g} times as much)" in opening
    assert "Over all levels EKF is better than UKF on the same run by" in opening
    assert headline(mass[0]) in opening
    assert "In the run drawn at 8 t the true lateral force axle 21 lies within ± 2σ" in opening
    assert "Of 1968 runs of all designs, estimator diverged in 4 (UKF 4)" in opening
    assert "plant left its range in 6 (EKF 3, UKF 3); failed in 1 (EKF 1)" in opening


def test_the_report_says_how_it_was_made(mass):
    text = Page(mass[1][0].read_text(encoding="utf-8")).text
    for part in ("0123456789abcdef", "abcdef0", "numpy 2.0.0", "41.5 s", "72.9 runs per second", "10.0 ms"):
        assert part in text
    assert '"quoted", #hash, $dollar$, *star*, \\back <tag> & [bracket] `tick` @at' in text
    assert "840 simulated drives" in text
    assert re.search(r"trailer mass\s*8000 kg\s*24000 kg", text)
    assert re.search(r"process\s*lateral force axle 21\s*kN\s*0\.0316\s*–\s*1000\s*–", text)


def test_the_same_store_gives_the_same_bytes(small):
    """In another process, since the order of a set depends on the process."""
    folder, files = small
    before = [path.read_bytes() for path in files]
    command = "import sys; from harness.report import write_report; write_report(sys.argv[1])"
    environment = {**os.environ, "PYTHONHASHSEED": "42"}
    subprocess.run([sys.executable, "-c", command, folder], check=True, env=environment)
    assert before == [path.read_bytes() for path in files]


def test_boxes_leave_out_lost_runs_and_count_them(mass):
    analysis = Analysis(read(mass[0]))
    level = analysis.main
    assert level.summaries[0][0][0].n == 117
    assert level.summaries[0][0][1].n == 113
    assert boxes.tick_labels(level.design, level)[0] == "8 t\nn 113–117\ndiv. 3–7"
    assert boxes.tick_labels(level.design, level)[6] == "32 t\nn 119–120\nfailed 0–1"
    sheet = boxes.table(level, 0)
    assert sheet.header[3:6] == ["diverged", "plant out of range", "failed"]
    assert sheet.rows[1][:6] == ["", "UKF", "113", "4", "3", "0"]
    values = mass[2]["level"]["rmse"].isel(band=3, estimator=1, target=0).values / 1000
    median, lower, upper, largest = (style.number(float(np.quantile(values, q))) for q in (0.5, 0.25, 0.75, 1.0))
    row = sheet.rows[7]
    assert (row[6], row[8], row[9], row[10]) == (median, lower, upper, largest)


def test_comparisons_pair_the_runs_that_both_finished(mass):
    level = Analysis(read(mass[0])).main
    pair = level.compared(0, 0, 1, 0)
    assert pair.result.n == 113
    assert level.compared(0, 0, 1, None).result.n == 113 + 5 * 120 + 119
    data = mass[2]["level"]
    difference = (data["rmse"].isel(estimator=1) - data["rmse"].isel(estimator=0)).isel(band=2, target=0) / 1000
    assert level.compared(0, 0, 1, 2).result.difference.value == pytest.approx(float(difference.median()))
    assert all(c.p_corrected >= c.result.p_value for c in level.comparisons)


def test_consistency_is_weighed_against_its_bounds(one_design):
    findings = one_design(repeats=20).main
    assert findings.consistency("nees", 4, 0).verdict == "consistent"
    assert findings.consistency("nees", 0, 0).verdict == "over-confident"
    design = findings.design
    design.data["nees"][:] = 0.5 * design.state_dimension
    assert Findings(design, 0).consistency("nees", 4, 0).verdict == "cautious"
    c = findings.consistency("nis", 4, 0)
    assert c.upper - c.lower == pytest.approx(2 * 1.96 * np.sqrt(2 / (40 * 9000)), rel=1e-3)


def test_an_estimator_without_covariance_has_no_band_and_no_row(one_design):
    analysis = one_design(estimators=("EKF", "NARX"), without_covariance=("NARX",))
    assert analysis.main.with_covariance == [0]
    blocks = consistency.blocks(analysis)
    assert {row[1] for sheet in blocks if isinstance(sheet, Sheet) for row in sheet.rows} == {"EKF"}
    assert any(isinstance(b, Prose) and "NARX" in b.markup for b in blocks)
    silent = one_design(estimators=("NARX",), without_covariance=("NARX",))
    assert consistency.blocks(silent) == []


def test_medians_per_drive(one_design):
    findings = one_design().main
    medians = drives.medians(findings, 1)
    expected = np.degrees(findings.design.data["rmse"].isel(target=1).median(("sample", "repeat")))
    np.testing.assert_allclose(medians, expected.transpose("band", "estimator", "drive"))


def _everything_at_8_t(fates: np.ndarray) -> None:
    fates[0] = 1


def _everything(fates: np.ndarray) -> None:
    fates[...] = 2


@pytest.mark.parametrize(
    "options",
    [
        {"estimators": ("EKF",), "levels": (24.0,), "repeats": 1},
        {
            "estimators": ("EKF", "UKF", "CDKF", "ST-CDKF", "PF", "NARX", "KF", "mine"),
            "levels": (16.0, 24.0),
            "targets": _ANGLE,
        },
        {"levels": tuple(np.linspace(10, 30, 12)), "band": 0.02, "samples": 4, "repeats": 1, "targets": _ANGLE},
        {"status": _everything_at_8_t, "targets": {"speed": ("m/s", 0.1), "something_new": ("W", 5.0)}},
        {"status": _everything, "levels": (16.0, 24.0)},
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
    document = Document("What?", [block for section in _SECTIONS for block in section.blocks(analysis)])
    text, files = source(document)
    assert "nan" not in re.findall(r"[a-z]+", text)
    assert headline(analysis.store.directory) in text
    assert all(svg.startswith(b"<?xml") for svg in files.values())
    assert ("Which estimator is better" in text) == (len(analysis.main.design.estimators) > 1)
    if len(analysis.main.design.estimators) > 3:  # tables that go on over pages
        assert _pages(render(document)[1]) >= 5


def _words(analysis: Analysis) -> str:
    """Everything that the answer says in its bullets."""
    return " ".join(item for block in answer.blocks(analysis) if isinstance(block, Bullets) for item in block.items)


def test_words_when_nothing_is_left(one_design):
    lost = one_design(status=_everything)
    text = _words(lost)
    assert "At 8 t no run has a score." in text
    assert "plant left its range in 84 (EKF 42, UKF 42)" in text


def test_no_difference_is_called_none(one_design):
    analysis = one_design()
    design = analysis.main.design
    design.rmse[:, :, 1] = design.rmse[:, :, 0]
    text = _words(Analysis(analysis.store))
    assert "no difference between UKF and EKF is shown" in text
    assert "is better than" not in text


def test_a_difference_that_is_shown_may_still_be_negligible(one_design):
    """Half a per mille on every run is significant and of no use to anybody."""
    design = one_design(repeats=20).main.design
    design.rmse[:, :, 1] = design.rmse[:, :, 0] * 0.9995
    findings = Findings(design, 0)
    pair = findings.compared(0, 0, 1, None)
    assert pair.shown
    assert pair.negligible
    assert pair.relative == pytest.approx(-0.0005, rel=0.05)
    text = " ".join(answer._better(findings, 0))
    assert "UKF and EKF differ negligibly" in text
    assert "0.050 % of the median RMSE" in text
    assert "is better than" not in text
    design.rmse[:, :, 1] = design.rmse[:, :, 0] * 0.9
    text = " ".join(answer._better(Findings(design, 0), 0))
    assert "UKF is better than EKF on the same run by" in text
    assert "10 % of the median RMSE" in text


def _medians(design) -> np.ndarray:
    return np.nanmedian(design.rmse.reshape(*design.rmse.shape[:3], -1), axis=-1)


def test_headline_tells_the_largest_growth_of_each_target(one_design):
    design = one_design().main.design
    design.rmse[:, :, 1] = design.rmse[:, :, 0]
    design.rmse[1, 6] = design.rmse[1, 0] * 2  # the articulation angle is worst at 32 t
    medians = _medians(design)
    text = answer_in_short(Findings(design, 0))
    force = f"{style.number(medians[0, 4, 0])} to {style.number(medians[0, 0, 0])} kN"
    angle = f"{style.number(medians[1, 4, 0])} to {style.number(medians[1, 6, 0])}°"
    times = [
        f"({style.number(a / b, 2)} times)" for a, b in zip(medians[[0, 1], [0, 6], 0], medians[:, 4, 0], strict=True)
    ]
    assert text == (
        "With the trailer mass at 8 t instead of the believed 24 t, the median error of the lateral force axle 21 "
        f"grows from {force} {times[0]}; with the trailer mass at 32 t that of the articulation angle grows from "
        f"{angle} {times[1]}; EKF and UKF differ by less than 0.1 %."
    )


def test_headline_names_the_best_estimator_where_they_differ_and_what_was_lost(one_design):
    design = one_design(estimators=("EKF", "UKF", "PF"), status=_lose_two).main.design
    design.rmse[:, :, 2] = design.rmse[:, :, 0] * 0.5
    text = answer_in_short(Findings(design, 0))
    medians = _medians(design)
    best = f"{style.number(medians[0, 4, 2])} to {style.number(medians[0, 0, 2])} kN"
    assert f"grows from {best} ({medians[0, 0, 2] / medians[0, 4, 2]:.1f} times) with PF and to " in text
    assert f"{style.number(medians[0, 0, 0])} kN with EKF" in text
    assert "with UKF" not in text  # its median is that of the runs it survived; it is counted instead
    assert "differ by less" not in text
    assert text.endswith("Of 126 runs, in 2 the estimator diverged (UKF 2).")


def _lose_two(fates: np.ndarray) -> None:
    fates[3, 0, 0, :2, 1] = 1


def test_headline_of_other_studies(one_design):
    one = answer_in_short(one_design(estimators=("EKF",), levels=(24.0,)).main)
    assert re.fullmatch(
        r"With the trailer mass at 24 t the median error of the \D+21 is [\d.]+ kN and that .* is [\d.]+°\.", one
    )
    steady = one_design(levels=(8.0, 24.0)).main.design
    steady.rmse[:] = 1.0
    assert "stays at 1.00 kN" in answer_in_short(Findings(steady, 0))
    unmatched = answer_in_short(one_design(levels=(8.0, 12.0)).main)
    assert unmatched.startswith("With the trailer mass at 8 t instead of 12 t, the median error")
    assert answer_in_short(one_design(status=_everything).main).startswith(
        "No run has a score. Of 84 runs, in 84 the plant"
    )


def test_nothing_is_cut_off_and_panels_do_not_overlap():
    with style.drawing():
        fig = style.figure(5.0)
        panels = fig.subplots(2, 1, sharex=True)
        for axes in panels:
            axes.set_yticks([0, 1], ["a drive with quite a long name", "b"])
            axes.set_ylabel("label")
            axes.set_title("title", loc="left")
        panels[1].set_xticks([0, 1], ["two\nlines", "x"])
        panels[1].set_xlabel("levels")
        style.head(fig, "Is all of it there?", [Line2D([], [], label="one")])
        svg = style.svg(fig)
        renderer = RendererSVG(*fig.bbox.size, io.StringIO(), image_dpi=72)
        upper, lower = (axes.get_tightbbox(renderer) for axes in panels)
    legend = fig.legends[0].get_window_extent(renderer)
    assert svg.startswith(b"<?xml")
    assert min(upper.x0, lower.x0, lower.y0) >= 0
    assert max(upper.x1, lower.x1) <= fig.bbox.x1
    assert lower.y1 <= upper.y0 < upper.y1 <= legend.y0
    assert panels[0].get_window_extent().width > 0.5 * fig.bbox.width


def test_two_factors(tmp_path):
    """A level is a pair of values; the matched one has both as believed."""
    data = synthetic.design(levels=(16.0, 24.0), repeats=2)
    data["factor_friction"] = (("band", "sample"), np.array([[0.9], [0.5]]))
    factors = json.loads(data.attrs["factors"])
    second = {"name": "friction", "of": "both", "unit": "", "nominal": 0.5, "lower": [0.9, 0.5], "upper": [0.9, 0.5]}
    data.attrs["factors"] = json.dumps([*factors, second])
    folder = synthetic.write(tmp_path, {"both": data})
    design = read(folder).designs[0]
    assert design.matched == 1
    assert [f.words for f in design.factors] == ["trailer mass", "friction"]
    assert boxes.factor_label(design).startswith("trailer mass of the plant, friction of plant and belief")
    assert answer_in_short(Findings(design, 0)).startswith("At the level 16 t instead of 24 t, the median")
    (folder / "run.json").unlink()  # only the store is needed
    facts = next(b for b in made.blocks(Analysis(read(folder))) if isinstance(b, Sheet)).rows
    assert "seed" in dict(facts)
    assert "duration" not in dict(facts)


def test_history_errors_and_thinning():
    time = np.arange(10000.0)
    values = np.sin(time / 500)
    values[4321] = 7.0
    values[6000:7000] = np.nan
    times, thinned = history.thin(time, values)
    assert len(times) <= 2 * 900 + 2
    assert np.nanmax(thinned) == 7.0
    assert times[np.nanargmax(thinned)] == 4321
    assert np.isnan(thinned[(times > 6010) & (times < 6990)]).all()
    assert np.isfinite(thinned[times < 6000]).all()


def test_a_signal_without_truth_is_drawn_alone(small):
    text = Page(small[1][0].read_text(encoding="utf-8")).text
    assert "The plant has no stiffness factor: the estimate stands alone." in text
    runs = read(small[0]).histories
    assert history.inside(runs[0], "EKF").keys() == {"articulation_angle"}


def test_every_run_gets_a_figure(small):
    analysis = Analysis(read(small[0]))
    first = analysis.store.histories[0].isel(target=[0])
    analysis.store.histories = [first, first.assign_attrs(name="again")]
    captions = [b.caption for b in history.blocks(analysis) if isinstance(b, Picture)]
    assert [c.split(":")[0] for c in captions] == ["The run 8 t, winding-road", "The run again, 8 t, winding-road"]


def test_history_table_states_the_error_of_the_drawn_run(mass):
    data = read(mass[0]).histories[0]
    targets = [quantity(str(name)) for name in data["target"].values]
    rows = history._errors(data, targets, ["EKF", "UKF"]).rows
    error = np.degrees(data["estimate"].isel(estimator=1, target=1) - data["truth"].isel(target=1))
    assert rows[3][2] == style.number(float(np.sqrt((error**2).mean())))


def test_no_history_and_no_band_leave_their_sections_out(one_design):
    analysis = one_design()
    assert history.blocks(analysis) == []
    assert scatter.blocks(analysis) == []
    assert paired.blocks(analysis)[0] == Heading("Which estimator is better, run by run?")
    assert made.blocks(analysis)


def test_looks_are_fixed_and_never_alike():
    seven = style.looks(["EKF", "UKF", "CDKF", "ST-CDKF", "PF", "NARX", "KF"])
    assert style.looks(["UKF"])["UKF"] == seven["UKF"]
    assert style.looks(["new", "EKF"])["EKF"] == seven["EKF"]
    many = style.looks([f"filter {k}" for k in range(20)])
    drawn = {(look.colour, look.hatch) for look in many.values()}
    assert len(drawn) == 20
    assert len({look.marker for look in seven.values()}) == 7


@pytest.mark.parametrize(
    ("value", "text"),
    [
        (0.0, "0"),
        (1234.5, "1230"),
        (12.345, "12.3"),
        (0.0012345, "0.00123"),
        (-0.5, "−0.500"),
        (9.999, "10.0"),
        (float("nan"), "–"),
        (2.5e-7, "2.50·10⁻⁷"),
        (4e9, "4.00·10⁹"),
    ],
)
def test_numbers(value, text):
    assert style.number(value) == text


def test_units():
    assert print_unit("deg/s") == "°/s"
    assert print_unit("m/s^2") == "m/s²"
    assert print_unit("kN*m") == "kN·m"
    assert quantity("lateral_force_axle_21", "N").scale == pytest.approx(1e-3)
    assert quantity("yaw_rate_trailer", "rad/s").scale == pytest.approx(np.degrees(1))
    assert isinstance(quantity("unheard_of", "W"), Quantity)
    assert style.with_unit(2.5, "°") == "2.50°"
    assert style.probability(0.0004) == "< 0.001"


def test_any_text_survives_typst():
    """No character of a name or a study text is taken for markup."""
    nasty = 'a_b *c* #d $e$ `f` <g> @h [i] "j" \\k ~l // m /* n */ - + = 1. é'
    picture = Picture(b'<svg xmlns="http://www.w3.org/2000/svg" width="9" height="9"/>', nasty, nasty)
    sheet = Sheet(["name", "n"], [[nasty, "1"], ["", nasty]], nasty)
    blocks = [Heading(nasty), Prose(plain(nasty)), Bullets([plain(nasty)]), picture, sheet, Listing(nasty)]
    html, pdf = render(Document(nasty, blocks))
    assert Page(html.decode()).text.count(nasty) == 10  # title twice, each block once, the table 3 times
    assert _pages(pdf) == 1
    assert set(source(Document(nasty, blocks))[1]) == {"figure-01.svg"}


def test_errors_name_the_folder(tmp_path):
    with pytest.raises(UserError, match=r"scores.zarr is missing"):
        write_report(tmp_path)
    (tmp_path / "scores.zarr").mkdir()
    with pytest.raises(UserError, match="not a store that a study wrote"):
        write_report(tmp_path)
    folder = synthetic.write(tmp_path / "other", {"level": synthetic.design(repeats=1)})
    (folder / "run.json").write_text("{", encoding="utf-8")
    with pytest.raises(UserError, match=r"run.json: line 1: not JSON"):
        write_report(folder)
