"""What the pages of traces, fits, checks and points of a design are made of, without a browser."""

import json
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from bokeh.document import Document

from harness.common.errors import UserError
from harness.models.assembly.plan import Outline
from harness.study.replay import Place, Replayer
from harness.study.report import analyse
from harness.study.stored import study_of
from harness.view import check_page, fit_page, folder_page, trace_page
from harness.view.above import AboveFigure, Along, _extent
from harness.view.boxes import expected
from harness.view.factors import points_of, shares, varied
from harness.view.factors_panel import FactorsPanel, tolerance_box
from harness.view.pages import kind_of, pages
from harness.view.trace_page import bars, changes
from support.stored_results import NASTY


def built(put):
    document = Document()
    put(document)
    document.validate()
    return document


def titles(document):
    figures = (m for m in document.models if type(m).__name__ == "figure")
    return [m.title.text.replace("\n", " ") for m in figures if m.title.text]


def tables(document):
    return [m.text for m in document.models if type(m).__name__ == "Div" and "<table" in m.text]


def test_a_trace_shows_what_is_likely_where_and_what_was_tried(results):
    document = built(trace_page.build(results / "trace"))
    drawn = titles(document)
    assert "Yaw rate: measured and simulated" in drawn
    assert "Residual over the path, before" in drawn  # the held-out recording comes first, and it has a path
    columns = [set(m.data) for m in document.models if type(m).__name__ == "ColumnDataSource"]
    assert {"x", "y", "size", "name", "before", "after", "rank"} in columns
    assert document.title == "What does the model lack? trace"
    texts = [m.text for m in document.models if type(m).__name__ == "Div" and m.render_as_text]
    assert any(NASTY in text for text in texts)


def test_a_trace_of_an_older_version_says_what_it_lacks(results, tmp_path):
    (tmp_path / "trace.json").write_text(json.dumps({"answer": "old", "posterior": None, "candidates": []}))
    texts = [m.text for m in built(trace_page.build(tmp_path)).models if type(m).__name__ == "Div"]
    assert any("kept no drives over time" in text for text in texts)


def test_a_fit_and_a_check_have_their_figures(results):
    fitted = built(fit_page.build(results / "identify"))
    assert "Value over that at the start" in titles(fitted)
    (matrix,) = (t for t in tables(fitted) if "matrix" in t)
    assert matrix.count(">1.0</td>") == 2
    assert matrix.count(">−0.40</td>") == 2
    document = built(check_page.build(results / "check"))
    assert next(m for m in document.models if type(m).__name__ == "Select").value == "1"  # the signal with a warning
    assert any('<a href="?signal=1">yaw rate</a>' in text for text in tables(document))
    gaps = [
        (m.left, m.right) for m in document.models if type(m).__name__ == "BoxAnnotation" and m.fill_color == "#bbbbbb"
    ]
    assert gaps == [pytest.approx((2.0, 3.0), abs=0.03)]
    assert "yaw rate from speed: disagrees: sign" in titles(document)


def test_a_folder_leads_to_each_result(results):
    found = pages([results])
    said = [m.text for m in built(found["/"]).models if type(m).__name__ == "Div"]
    assert "1 campaign, 1 check, 1 identification, 1 trace" in said
    assert list(found) == ["/", "/1", "/2", "/3", "/4"]
    text, findings = sorted(tables(built(found["/"])), key=lambda t: "Mass counts" in t)
    assert "2 findings: 1 reproduced, 1 not reproduced." in text
    assert "not reproduced" in findings
    assert "<script>" not in findings
    assert "&lt;script&gt;" in text
    assert "<script>" not in text
    assert "1 disagrees." in text
    assert '<a href="3">identify</a>' in text
    assert "Value over that at the start" in titles(built(found["/3"]))
    assert [kind_of(results / name) for name in ("check", "identify", "trace")] == ["check", "identification", "trace"]


def test_what_is_no_result_is_refused(results, tmp_path):
    with pytest.raises(UserError, match=r"no result to show: there is none of scores\.zarr"):
        pages([tmp_path])
    (tmp_path / "trace.json").write_text("[]")
    with pytest.raises(UserError, match="no record"):
        pages([tmp_path])
    document = built(folder_page.refused(tmp_path, "cannot be read"))
    assert "cannot be read" in [m.text for m in document.models if type(m).__name__ == "Div"]


def test_points_of_a_design_have_their_factors_score_and_worst_run(folder):
    design = analyse(folder).store.designs[0]
    assert varied(design) == [0]
    found = points_of(design, "rmse", 0, 0, None)
    assert found.values.ravel() == pytest.approx([1.5, 1.9])
    runs = design.rmse[0, :, 0, :, 0]  # band, drive, repeat
    assert found.scores == pytest.approx(np.sqrt(np.mean(runs**2, axis=(1, 2))))
    for band, (drive, repeat) in enumerate(found.worst):
        assert runs[band, drive, repeat] == runs[band].max()
    alone = points_of(design, "max_error", 0, 0, 1)
    assert set(alone.worst[:, 0]) == {1}
    assert shares(design.factors[0], np.array([1.5, 1.7, 1.9])) == pytest.approx([0, 0.5, 1])


def test_consistency_has_an_expected_value_and_a_band(folder):
    design = analyse(folder).store.designs[0]
    lines = sorted(expected(design, "nis"))
    assert lines[1] == design.output_dimension
    assert lines[0] < lines[1] < lines[2]
    assert expected(design, "rmse") == {}


def test_a_bar_is_as_long_as_its_value():
    plot = bars(["all", "none"], [("probability", [1.0, 0.0])], "probability")
    (drawn,) = (r for r in plot.renderers if type(r.glyph).__name__ == "HBar")
    assert list(drawn.data_source.data["right"]) == [1.0, 0.0]
    assert drawn.glyph.left == 0.0


def test_a_candidate_without_a_finite_error_is_not_drawn_as_a_good_one():
    plot = changes(["lag", "lost"], ("without it", "with it"), [(4.0, 1.0), (4.0, float("nan"))], "error", "Yaw rate")
    drawn = {r.glyph.marker: r.data_source.data for r in plot.renderers if type(r.glyph).__name__ == "Scatter"}
    assert list(drawn["circle"]["first"]) == [4.0, 4.0]
    assert list(drawn["square"]["second"]) == [1.0]
    told = [r for r in plot.renderers if type(r.glyph).__name__ == "Text" and r.glyph.text_align == "right"]
    assert [list(r.data_source.data["text"]) for r in told] == [["with it: no finite value"]]


def test_the_numbers_on_the_vehicle_are_those_of_the_list_and_every_row_has_its_name(results):
    document = built(trace_page.build(results / "trace"))
    rows = [m.data for m in document.models if type(m).__name__ == "ColumnDataSource" and "rank" in m.data]
    listed = [n for m in document.models if type(m).__name__ == "ColumnDataSource" for n in m.data.get("name", [])]
    assert {f"{k}: {n}" for data in rows for k, n in zip(data["rank"], data["name"], strict=True)} <= set(listed)
    (ticks,) = (m.ticks for m in document.models if type(m).__name__ == "FixedTicker")
    assert ticks == sorted(ticks)


def test_no_mark_on_the_vehicle_covers_another_and_each_stands_at_its_place(results, tmp_path):
    record = json.loads((results / "trace" / "trace.json").read_text())
    places = [("sensor", 0.0), ("sensor", 0.0), ("sensor", 0.1), ("sensor", 1.5), ("port", 1.2), ("port", 1.2)]
    record["pinpoint"] = [
        record["pinpoint"][0] | {"kind": kind, "ahead_of_first_cog": x, "ports": ["lateral_force_axle_front"]}
        for kind, x in places
    ]
    (tmp_path / "trace.json").write_text(json.dumps(record))
    document = built(trace_page.build(tmp_path))
    (data,) = (m.data for m in document.models if type(m).__name__ == "ColumnDataSource" and "rank" in m.data)
    assert data["x"] == [x for _, x in places]
    plot = document.get_model_by_name("place on the vehicle")
    per_pixel = (plot.y_range.end - plot.y_range.start) / (plot.height - 100)  # what labels and title leave
    for i, x in enumerate(data["x"]):
        for k in range(i):
            beside = abs(x - data["x"][k]) > 0.2 * 4.0  # m, of a vehicle of 4 m
            assert beside or abs(data["y"][i] - data["y"][k]) > data["size"][i] * per_pixel
    body = next(r.glyph for r in plot.renderers if type(r.glyph).__name__ == "Quad")
    assert [body.bottom < y < body.top for y in data["y"]] == [False] * 4 + [True] * 2


def test_a_comparison_that_holds_but_for_a_factor_is_drawn_with_it(results, tmp_path):
    record = json.loads((results / "check" / "check.json").read_text())
    record["mended"] = ["yaw_rate = { invert = true }"]
    compared = {"signals": ["yaw_rate", "speed"], "exact": False, "slope": -0.5, "offset": 0.0, "delay": None,
                "explained": 0.9, "unit": "deg/s", "scale": 2.0, "verdict": "agrees", "reasons": []}  # fmt: skip
    record["comparisons"][0] |= compared
    (tmp_path / "check.json").write_text(json.dumps(record))
    (tmp_path / "signals.npz").write_bytes((results / "check" / "signals.npz").read_bytes())
    document = built(check_page.build(tmp_path))
    data = next(m.data for m in document.models if type(m).__name__ == "ColumnDataSource" and "computed" in m.data)
    known = np.isfinite(data["measured"])  # twice sin t, and of minus sin t half of the negative
    assert data["computed"][known] == pytest.approx(data["measured"][known] / 2, abs=1e-6)
    assert any("yaw_rate = { invert = true }" in m.text for m in document.models if type(m).__name__ == "Div")
    assert any("−0.500" in text for text in tables(document))


def test_a_tolerance_box_has_its_ends_in_the_units_of_its_factors(folder):
    one = analyse(folder).store.designs[1].factors[0]
    linear = replace(one, nominal=2.0, lower=np.array([1.8, 1.0]), upper=np.array([2.2, 4.0]), unit="t")
    across = replace(linear, log=True, unit="")
    design = replace(analyse(folder).store.designs[1], factors=[linear, across])
    figure = tolerance_box(design, [0.5, 0.5], [1.0, 0.5], 0.25)
    (names,) = (r.data_source.data["name"] for r in figure.renderers if type(r.glyph).__name__ == "Text")
    assert names == ["mass: 1.50 to 4.00 t", "mass: 1.41 to 2.83"]


def test_the_frame_of_the_vehicle_holds_every_corner_of_a_trailer_that_is_turned_or_believed_to_be():
    outline = Outline(-4.0, 4.0, 2.5, True)
    plan = SimpleNamespace(outlines={"tractor": outline, "trailer": outline}, coupling=(-2.0, 3.0))
    believed = np.array([0.0, np.pi / 2, np.nan])
    held = _extent(plan, {"articulation": np.zeros(3), "articulation 0": believed, "x": np.full(3, 99.0)}, 1.0)
    assert held["x"][0] <= -2.0 - 7.0  # behind the coupling by the trailer's own length
    assert held["y"][0] <= -7.0  # turned by a right angle
    assert held["x"][1] == 5.0  # of the tractor
    side = _extent(plan, {"articulation": np.array([np.pi / 4])}, 0.0)
    assert side["y"][0] == pytest.approx(-(7.0 + 1.25) / np.sqrt(2))


def test_all_figures_of_a_design_share_one_selection_that_leads_to_a_run(folder):
    chosen, brushes, alongs = [], [], []
    panel = FactorsPanel(
        Document(),
        analyse(folder),
        lambda run, estimator: chosen.append((run, estimator)),
        brushes.append,
        alongs.append,
    )
    panel.show(0, "rmse", 0, None)
    assert panel.layout.children == []  # one factor: there is nothing to brush
    panel.show(1, "rmse", 0, None)
    document = Document()
    document.add_root(panel.layout)
    panel.explain((1, "rmse", 0, None), 0)
    document.validate()
    assert {
        "Parallel coordinates",
        "Sobol indices, 95 % intervals",
    } <= set(titles(document))
    shared = {
        r.data_source.id
        for f in document.models
        if type(f).__name__ == "figure" and (f.name or "")[:7] in ("paralle", "scatter")
        for r in f.renderers
    }
    assert len(shared) == 1
    source = document.get_model_by_id(shared.pop())
    assert len(source.data["score"]) == 64
    source.selected.indices = [5]
    found = points_of(analyse(folder).store.designs[1], "rmse", 0, 0, None)
    assert chosen == [((0, found.worst[5][0], 5, found.worst[5][1]), 0)]


def test_a_number_over_the_time_of_a_drive_colours_its_path_and_no_other(folder):
    study = study_of(folder)
    figure = AboveFigure(analyse(folder).looks)
    figure.show(Replayer(study).run(Place(0, 1, 1, 0, 4), [0], innovations=False, everything=True))
    time, values = np.array([0.0, 2.0, 4.0]), np.array([0.0, 1.0, 0.0])
    along = {n: Along(d.name, time, values, "total index") for n, d in zip(("no", "yes"), study.drives, strict=True)}
    figure.colour_also(along)
    document = Document()
    document.add_root(figure.layout)
    select = next(m for m in document.models if type(m).__name__ == "Select")
    assert "yes" in select.options
    assert "no" not in select.options
    path = next(m.data for m in document.models if type(m).__name__ == "ColumnDataSource" and "yes" in m.data)
    assert max(path["yes"]) == pytest.approx(1.0, abs=0.02)
    assert path["yes"][0] == 0.0
