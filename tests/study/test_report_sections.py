"""The parts of the report below its answer: each shows the numbers of the store."""

from __future__ import annotations

import json
import shutil

import numpy as np
import pytest

from harness.models.quantities import quantity
from harness.reporting import style
from harness.reporting.document import Picture, Prose, Sheet
from harness.study.report import write_report
from harness.study.report.analysis import Analysis, Findings
from harness.study.report.opening import answer_in_short
from harness.study.report.sections import (
    boxes,
    consistency,
    drives,
    history,
    made,
    paired,
    scatter,
    weights,
)
from harness.study.results import read
from support import synthetic


def test_boxes_of_a_level_hold_the_same_runs_and_losses_are_counted(mass, mass_designs):
    analysis = Analysis(read(mass))
    level = analysis.main
    assert [s.n for s in level.summaries[0][0]] == [117, 117]
    assert boxes.tick_labels(level.design)[0] == "8 t\nn 117\ndiv. 0–4\nout 3"
    assert boxes.tick_labels(level.design)[6] == "32 t\nn 120\ndiv. 0–1"
    sheet = boxes.table(level, 0)
    assert sheet.header == ["level", "EKF", "UKF"]
    assert sheet.rows[0][0] == "8 t\n3 out of control"
    assert sheet.rows[0][2].endswith("max ∞\n4 diverged")
    values = mass_designs["level"]["rmse"].isel(band=3, estimator=1, target=0).values / 1000
    low, high = level.summaries[0][3][1].median[1:]
    assert low < np.median(values) < high
    lines = [
        style.number(np.median(values)),
        f"{style.number(low)}–{style.number(high)}",
        f"max {style.number(values.max())}",
    ]
    assert sheet.rows[3][2].split("\n") == lines


def test_a_design_over_one_factor_is_shown_over_its_value_only(mass):
    analysis = Analysis(read(mass))
    assert [f.design.name for f in analysis.levelled] == ["level"]
    picture = next(b for b in scatter.blocks(analysis) if isinstance(b, Picture))
    assert "design “band”, 144 runs of each estimator." in picture.caption


def test_an_array_read_part_by_part_is_the_same(mass, monkeypatch):
    whole = Analysis(read(mass)).main.design
    for name, value in (("_HELD", 0), ("_SMALL", 0), ("_CHUNKS_AT_ONCE", 1)):
        monkeypatch.setattr(f"harness.study.results.{name}", value)
    parts = Analysis(read(mass)).main.design
    assert parts.data["rmse"].variable._in_memory is False
    np.testing.assert_array_equal(parts.status, whole.status)
    np.testing.assert_array_equal(parts.rmse, whole.rmse)
    np.testing.assert_array_equal(parts.per_run("nees"), whole.per_run("nees"))


def test_of_very_many_runs_the_first_points_are_drawn(mass, monkeypatch):
    monkeypatch.setattr(scatter, "_MOST", 50)
    picture = next(b for b in scatter.blocks(Analysis(read(mass))) if isinstance(b, Picture))
    assert "144 runs of each estimator, of which the first" in picture.caption
    assert "points of each band are drawn" in picture.caption


def test_comparisons_pair_the_runs_of_a_vehicle_under_control(mass, mass_designs):
    level = Analysis(read(mass)).main
    pair = level.compared(0, 0, 1, 0)
    assert pair.result.n == 117
    data = mass_designs["level"]
    assert level.compared(0, 0, 1, None).result.n == 120  # each run once, by its mean over the levels it has
    ratio = (data["rmse"].isel(estimator=1) / data["rmse"].isel(estimator=0)).isel(band=2, target=0)
    assert level.compared(0, 0, 1, 2).result.ratio.value == pytest.approx(float(ratio.median()))
    assert all(c.p_corrected >= c.result.p_value for c in level.comparisons)


def test_consistency_is_weighed_against_its_bounds(one_design):
    findings = one_design(repeats=20).main
    assert findings.consistency("nees", 4, 0).verdict == "consistent"
    assert findings.consistency("nees", 0, 0).verdict == "over-confident"
    design = one_design(repeats=20).main.design
    design.data["nees"][:] = 0.5 * design.state_dimension
    assert Findings(design, 0).consistency("nees", 4, 0).verdict == "cautious"
    c = findings.consistency("nis", 4, 0)
    assert c.upper - c.lower == pytest.approx(2 * 1.96 * np.sqrt(2 / (40 * 9000)), rel=1e-3)


def test_an_estimator_without_covariance_has_no_band_and_no_row(one_design):
    analysis = one_design(estimators=("EKF", "NARX"), without_covariance=("NARX",))
    assert analysis.main.with_covariance == [0]
    blocks = consistency.blocks(analysis)
    by_drive, by_level = (b for b in blocks if isinstance(b, Sheet))
    assert [row[0] for row in by_drive.rows] == ["EKF"]
    assert {row[1] for row in by_level.rows} == {"EKF"}
    assert any(isinstance(b, Prose) and "NARX" in b.markup for b in blocks)
    silent = one_design(estimators=("NARX",), without_covariance=("NARX",))
    assert consistency.blocks(silent) == []


def test_medians_per_drive(one_design):
    findings = one_design().main
    medians = drives.medians(findings, 1)
    expected = np.degrees(findings.design.data["rmse"].isel(target=1).median(("sample", "repeat")))
    np.testing.assert_allclose(medians, expected.transpose("band", "estimator", "drive"))


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
    assert "At the level 16 t instead of 24 t, the median" in answer_in_short(Analysis(read(folder)))
    for factor in design.factors:
        object.__setattr__(factor, "of", "plant")
    assert boxes.factor_label(design) == "trailer mass and friction of the plant (grey: as believed)"
    object.__setattr__(design.factors[0], "words", "a factor whose name would reach far beyond the edges of the page")
    assert max(len(line) for line in boxes.factor_label(design).splitlines()) <= 80
    design.factors[1].lower[1] = 0.4
    assert design.matched_is == "around what is believed"
    (folder / "run.json").unlink()  # only the store is needed
    facts = next(b for b in made.blocks(Analysis(read(folder))) if isinstance(b, Sheet)).rows
    assert "seed" in dict(facts)
    assert "duration" not in dict(facts)


def test_tuned_noise_is_told_and_nothing_where_none_is(one_design):
    analysis = one_design()
    assert not _tables_of_noise(analysis)
    factors = {"EKF, tuned": {"process": 0.5, "unknown_inputs": 1200.0, "measurement": 1.0}}
    analysis.store.attributes["description"] |= {"noise_factors": factors, "tuning": "largest likelihood (35 drives)"}
    (sheet,) = _tables_of_noise(analysis)
    assert sheet.header == ["estimator", "process", "unknown inputs", "measurement"]
    assert sheet.rows == [["EKF, tuned", "0.500", "1200", "1.00"]]
    assert "largest likelihood (35 drives)" in sheet.caption


def _tables_of_noise(analysis):
    return [b for b in made.blocks(analysis) if isinstance(b, Sheet) and b.caption.startswith("Tuned noise")]


def test_of_bands_about_the_same_value_the_narrowest_is_the_believed_one(tmp_path):
    data = synthetic.design(levels=(24.0, 24.0, 24.0), repeats=2)
    factor = {**json.loads(data.attrs["factors"])[0], "lower": [20e3, 24e3, 12e3], "upper": [28e3, 24e3, 36e3]}
    data.attrs["factors"] = json.dumps([factor])
    design = read(synthetic.write(tmp_path, {"bands": data})).designs[0]
    assert (design.matched, design.matched_is) == (1, "as believed")


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
    analysis = Analysis(read(small))
    caption = next(b.caption for b in history.blocks(analysis) if isinstance(b, Picture))
    assert "The plant has no stiffness factor: only the estimate is drawn." in caption
    runs = analysis.store.histories
    assert history.inside(runs[0], "EKF").keys() == {"articulation_angle"}


def test_every_run_gets_a_figure(small):
    analysis = Analysis(read(small))
    first = analysis.store.histories[0].isel(target=[0])
    analysis.store.histories = [first, first.assign_attrs(name="again")]
    captions = [b.caption for b in history.blocks(analysis) if isinstance(b, Picture)]
    assert [c.split(":")[0] for c in captions] == ["The run “8 t, winding-road”", "The run “Again, 8 t, winding-road”"]


def test_an_estimate_that_diverged_is_drawn_and_counted_up_to_then(small):
    analysis = Analysis(read(small))
    run = analysis.store.histories[0]
    run["estimate"][4000:, 1] = np.nan  # 100 samples a second
    figure, table = (b for b in history.blocks(analysis) if isinstance(b, Picture | Sheet))
    said = "UKF diverged after 39.99 s: nothing is shown or counted from there on."
    assert figure.caption.endswith(said)
    assert table.caption.endswith(said)
    assert "EKF diverged" not in figure.caption


def test_history_table_states_the_error_of_the_drawn_run(mass):
    data = read(mass).histories[0]
    targets = [quantity(str(name)) for name in data["target"].values]
    rows = history._errors(data, targets, ["EKF", "UKF"]).rows
    error = np.degrees(data["estimate"].isel(estimator=1, target=1) - data["truth"].isel(target=1))
    assert rows[3][2] == style.number(float(np.sqrt((error**2).mean())))


def test_no_history_and_no_band_leave_their_sections_out(one_design):
    analysis = one_design()
    assert history.blocks(analysis) == []
    assert scatter.blocks(analysis) == []
    assert paired.blocks(analysis)
    assert made.blocks(analysis)


def test_consistency_by_drive_is_that_of_the_matched_level(one_design):
    findings = one_design().main
    sheet = next(b for b in consistency.blocks_by_drive(findings) if isinstance(b, Sheet))
    nees = findings.design.data["nees"].isel(band=4, sample=0).median("repeat").transpose("estimator", "drive") / 11
    assert [row[1:] for row in sheet.rows] == [[style.number(float(v)) for v in row] for row in nees]
    assert consistency.blocks_by_drive(one_design(levels=(8.0, 12.0)).main) == []


def test_drives_are_drawn_as_believed_and_where_it_is_worst(one_design):
    design = one_design().main.design
    design.errors[1, 6] *= 10
    findings = Findings(design, 0)
    assert [drives.shown(findings, target) for target in (0, 1)] == [[4, 0], [4, 6]]
    assert drives.shown(one_design(levels=(8.0, 12.0)).main, 0) == [0]


def test_the_gain_of_a_measured_state_is_told(one_design):
    """Of a scalar filter with P/R = 1/2, 1/3, ... the gains are these; a follower is told from one that ignores."""
    analysis = one_design()
    run = synthetic.history(estimators=("KF", "NARX"), without_covariance=("NARX",)).isel(target=[1], time=slice(0, 50))
    assert weights.blocks(analysis) == []
    run["measured_articulation_angle"] = ("time", run["truth"].values[:, 0], {"variance": 4e-4})
    run["std"][:, 0, 0] = np.sqrt(4e-4 / np.arange(1, 51))
    analysis.store.histories = [run]
    prose, sheet = weights.blocks(analysis)
    assert sheet.rows == [
        [", ".join(("8 t",)), "articulation angle", "KF", "0.5000", "0.3333", "0.2500", "0.2000", "0.0200"]
    ]
    assert "relies on its model" in prose.markup
    run["std"][:, 0, 0] = np.sqrt(0.99 * 4e-4)
    assert "follows the measured articulation angle" in weights.blocks(analysis)[0].markup
    caption = [b for b in history.blocks(analysis) if isinstance(b, Picture)]
    assert len(caption) == 1


def test_a_design_too_large_to_be_held_gives_the_same_report(small, tmp_path, monkeypatch):
    folder = shutil.copytree(small, tmp_path / "copy")
    held = write_report(Analysis(read(folder)))[0].read_text(encoding="utf-8")
    monkeypatch.setattr("harness.study.results._HELD", 0)
    large = read(folder)
    assert not large.designs[0].data["rmse"].variable._in_memory
    assert write_report(Analysis(large))[0].read_text(encoding="utf-8") == held
    assert len(large.designs[0]._kept) <= 2
