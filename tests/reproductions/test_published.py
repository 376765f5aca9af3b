"""Records of the published numbers: verdicts, what is missing or old, the page and the report."""

import json
from pathlib import Path

import numpy as np
import pytest
import xarray as xr

from harness.common.statistics import Interval
from reproductions import reproduce
from reproductions.campaign.claims import CLAIMS
from reproductions.campaign.evidence import Evidence
from reproductions.published import kit, page, wording, ziaukas_evidence, ziaukas_ideal, ziaukas_ramps
from reproductions.published.record import (
    Kind,
    Outcome,
    Record,
    Row,
    answer,
    computed,
    count,
    image,
    point,
    printed,
    setting,
    statement,
)
from reproductions.published.report import compared, overview
from reproductions.published.results import Missing, Origin, Stored, state_of
from reproductions.published.wording import Chapter
from reproductions.stored import LONG
from support.synthetic import design, write

ROOT = Path(__file__).parents[2]


@pytest.fixture
def stored(tmp_path):
    return Stored(tmp_path, tmp_path / "out", ROOT / "studies")


def outcome(record, stored):
    return answer(record, stored).outcome


# --- verdicts


@pytest.mark.parametrize(
    ("text", "low", "high"),
    [("0.7778", 0.77775, 0.77785), ("15", 14.5, 15.5), ("2.02e-5", 2.015e-5, 2.025e-5), ("1e3", 500.0, 1500.0)],
)
def test_a_printed_number_stands_for_half_a_unit_to_either_side(text, low, high):
    assert printed(text) == pytest.approx((low, high), rel=1e-6)


def test_a_number_that_follows_from_theirs_is_judged_by_the_digits_printed(stored):
    assert outcome(computed("", "", "0.62", lambda: 1707 / 2741.9), stored) is Outcome.REPRODUCED
    assert outcome(computed("", "", "7.781", lambda: 7.7751), stored) is Outcome.NOT_REPRODUCED


def test_a_setting_is_taken_over_only_if_it_is_equal(stored):
    assert outcome(setting("", "", "10", 10.0), stored) is Outcome.TAKEN_OVER
    assert outcome(setting("", "", "10", 10.4), stored) is Outcome.OURS_DIFFERS


def test_an_interval_across_the_edge_decides_nothing(stored):
    def record(lower, upper):
        return statement("", "", lambda _: [Evidence("", Interval(1.0, lower, upper), (0.5, 2.0), 1.0, 9)])

    assert outcome(record(0.9, 1.1), stored) is Outcome.REPRODUCED
    assert outcome(record(0.4, 1.1), stored) is Outcome.UNDECIDED
    assert outcome(record(2.1, 2.4), stored) is Outcome.NOT_REPRODUCED
    assert outcome(statement("", "", lambda _: []), stored) is Outcome.UNDECIDED


def test_a_record_that_cannot_be_compared_says_why(stored):
    row = answer(image("figure 1", "a curve"), stored)
    assert row.outcome is Outcome.IMAGE
    assert count([row, row]) == {Outcome.IMAGE: 2}


# --- stored results


def _median():
    test = ziaukas_evidence.median(("ideal", None, "EKF", "lateral_force_axle_21"), 1.64)
    return Record("5.3", "median of the force", "1.64", "kN", test=test, needs="ideal")


def test_a_missing_study_is_named_with_its_command(stored):
    row = answer(_median(), stored)
    assert row.outcome is Outcome.MISSING
    assert "make study-ideal" in row.missing
    assert "make study-ideal" in wording.why(row)


def test_a_study_of_another_text_is_read_and_marked_as_old(stored, tmp_path):
    data = design(estimators=("EKF", "UKF", "NARX"), levels=[24.0], repeats=4)
    write(tmp_path / "ideal", {"ideal": data})
    row = answer(_median(), stored)
    expected = float(np.median(data["rmse"].sel(target="lateral_force_axle_21")[..., 0])) / 1000
    assert row.evidence[0].value.value == pytest.approx(expected)
    assert row.evidence[0].n == 24
    assert row.old
    assert wording.verdict(row).endswith("†")
    assert "earlier text" in stored.origin("ideal").state


def test_a_study_that_is_not_finished_is_missing(stored, tmp_path):
    write(tmp_path / "ideal", {"ideal": design(levels=[24.0], status=lambda fates: fates.fill(-1))})
    with pytest.raises(Missing, match=r"runs are still to come.*make study-ideal"):
        stored.design("ideal")
    assert stored.origin("ideal").state == "not finished"


def test_a_study_without_the_level_asked_for_is_named(stored, tmp_path):
    write(tmp_path / "mass", {"level": design(estimators=("EKF",), levels=[24.0])})
    group = ("mass", "8 t", "EKF", "articulation_angle")
    row = answer(Record("", "", test=ziaukas_evidence.median(group, 3.0), needs="mass"), stored)
    assert row.outcome is Outcome.MISSING
    assert "study 'mass' has no level '8 t'" in row.missing


def test_a_store_is_current_with_the_hash_and_the_code_of_its_study():
    from harness.config import load_study
    from harness.study.provenance import engine_hash

    study = load_study(ROOT / "studies" / "kalman-lecture.toml")
    right = {"study_hash": study.hash, "engine": engine_hash(study)}
    assert state_of(right, study) == "current"
    assert state_of(right | {"engine": "another"}, study) == "older than the code that decides it"
    assert "earlier text" in state_of(right | {"study_hash": "another"}, study)


def test_a_finding_says_in_how_much_of_the_box_it_holds(stored, tmp_path):
    (tmp_path / "reproduce-box").mkdir()
    found = {"made": "2026-01-01", "points": 256, "nearest": {"number": 1, "at": {}}}
    found["findings"] = [{"finding": "The mass matters.", "share": [0.34, 0.3, 0.381]}]
    (tmp_path / "reproduce-box" / "box.json").write_text(json.dumps(found))
    row = answer(statement("5", "The mass matters", lambda _: [point("", 1.0, (0.0, 2.0))]), stored)
    assert wording.why(row) == "Holds in 34 % (30 to 38) of the box of what is not published."
    assert answer(statement("5", "Another", lambda _: []), stored).box is None
    (tmp_path / "reproduce-box" / "box.json").write_text("{}")
    row = answer(statement("5", "The mass matters", lambda _: []), Stored(tmp_path, tmp_path / "out"))
    assert "box.json: not the result of a box" in row.missing


# --- documents


def test_every_number_of_the_lecture_is_reproduced(stored):
    rows = [answer(record, stored) for record in kit.records()]
    assert set(count(rows)) == {Outcome.REPRODUCED, Outcome.TAKEN_OVER, Outcome.IMAGE}


def test_a_wrong_filter_is_found(stored, monkeypatch):
    gains, variances = kit.example()
    monkeypatch.setattr(kit, "example", lambda *_: (1.001 * gains, variances))
    gain = [r for r in kit.records() if r.quantity.startswith("gain K(")]
    assert {outcome(record, stored) for record in gain} == {Outcome.NOT_REPRODUCED}


def test_the_delays_of_bild_5_2_are_those_of_the_observability_check(stored):
    late = [r for r in ziaukas_ideal.records() if r.theirs in ("2.39", "1.57")]
    for record in late:
        (evidence,) = answer(record, stored).evidence
        assert evidence.value == pytest.approx((2.81, 1.40, 4.22), abs=0.02)


def _ramp(delay: float, noise: float = 0.0) -> xr.Dataset:
    time = np.arange(0.0, 20.0, 0.01)
    truth = np.clip(time - 5.0, 0.0, 4.0)
    estimate = np.clip(time - 5.0 - delay, 0.0, 4.0) + noise * np.random.default_rng(0).normal(size=time.size)
    signals = {"target": [ziaukas_ramps.STEERING], "estimator": ["EKF"], "time": time}
    return xr.Dataset(
        {
            "truth": (("time", "target"), truth[:, None]),
            "estimate": (("time", "estimator", "target"), estimate[:, None, None]),
        },
        coords=signals,
    )


@pytest.mark.parametrize("delay", [0.0, 0.3, 0.7])
def test_the_delay_of_an_estimate_is_found_in_noise(delay):
    assert ziaukas_ramps.delay_of(_ramp(delay, 0.1), "EKF") == pytest.approx(delay, abs=0.02)


def test_roughness_is_that_of_the_noise():
    smooth, noisy = (ziaukas_ramps.roughness(_ramp(0.3, n), "EKF", ziaukas_ramps.STEERING) for n in (0.0, 0.1))
    assert noisy == pytest.approx(0.1 * 2**0.5, rel=0.05)
    assert smooth < 0.01


def test_the_findings_of_the_campaign_are_all_there_once():
    places = [c.studies for c in CLAIMS]
    assert all(places)
    quantities = [
        r.quantity for name in ("ziaukas-ideal", "ziaukas-robustness", "ziaukas-vehicle") for r in _records(name)
    ]
    texts = [c.text.rstrip(".") for c in CLAIMS if not c.text.startswith("Trailer tyres within")]
    assert [quantities.count(text) for text in texts] == [1] * len(texts)
    assert sum(q.startswith("growth of the median error") for q in quantities) == 3  # of the claim left out


def _records(name):
    return reproduce.CHAPTERS[name].records()


@pytest.mark.parametrize("name", reproduce.CHAPTERS)
def test_every_record_can_be_read(name):
    records = _records(name)
    assert len(records) > 5
    studies = {p.stem for p in (ROOT / "studies").glob("*.toml")} | {"realtime"} | set(LONG)
    for record in records:
        assert record.place
        assert record.quantity
        assert (record.test is None) == (record.bar is not None), record.quantity
        assert set(record.needs.split()) <= studies
        if record.bar is Outcome.FOREIGN:
            assert record.reason, record.quantity
        if record.kind is not Kind.STATEMENT and record.bar is None:
            assert record.theirs, record.quantity


# --- page and report


def _chapter() -> Chapter:
    def many(values, region):
        return [point(f"case {i}", v, region) for i, v in enumerate(values)]

    rows = [
        Row(
            Record("1", "a | b", "2", "kN", test=lambda _: []),
            [Evidence("", Interval(1.9, 1.8, 2.0), (1.0, 4.0), 2.0, 8)],
        ),
        Row(
            Record("2", "many", kind=Kind.STATEMENT, test=lambda _: [], reason="so"),
            many([0.5, 0.7, 3.0, 9.0], (0.0, 1.0)),
        ),
        Row(Record("3", "gone", "1", test=lambda _: [], needs="ideal"), missing="make it with 'make study-ideal'"),
        Row(Record("4", "wheel", "3", "m", Kind.SETTING, lambda _: []), [point("", 3.0, (3.0, 3.0), 3.0)]),
        Row(image("5", "curve")),
    ]
    return Chapter("Somebody 2000: something", "A note.", rows)


def test_counts_on_top_leave_settings_apart():
    text = wording.sentence(_chapter().rows)
    assert text.startswith("Of 4 numbers and statements 1 are reproduced, 1 are not and 1 wait for a stored result")
    assert "1 cannot be compared: 1 are shown only in an image" in text
    assert text.endswith("Of 1 settings 1 are taken over as printed.")


def test_many_numbers_are_written_as_their_range_and_the_one_that_decides():
    row = _chapter().rows[1]
    assert wording.ours(row) == "4 numbers, 0.500 to 9.00; against it: case 3: 9"
    assert wording.wanted(row) == "below 1.00"
    assert wording.why(row) == "so"
    assert wording.ours(_chapter().rows[0]) == "1.90 (1.80 to 2.00)"


def test_the_page_has_a_row_per_record_and_no_broken_cell():
    text = page.content([_chapter()], [Origin("ideal", "make study-ideal", "", "missing")], "2026-01-01")
    for line in text.splitlines():
        if line.startswith("| 1 "):
            assert line.count("|") == 6
    assert "| 1 | a ∣ b | 2 kN | 1.90 (1.80 to 2.00) | reproduced |" in text
    assert "| not reproduced (1) |" in text
    assert "\n1. so\n" in text
    assert "| wheel |" not in text, "a setting that is taken over has no line"
    assert "| ideal | `make study-ideal` | – | missing |" in text
    assert "[Somebody 2000: something](#somebody-2000-something)" in text


def test_pictures_show_every_outcome():
    svg = overview([_chapter()])
    assert b"<svg" in svg
    assert len(compared(_chapter().rows)) == 1  # a setting is no result


def test_the_command_writes_report_and_data_of_a_document(tmp_path, capsys, monkeypatch):
    monkeypatch.chdir(ROOT)
    (tmp_path / "results").mkdir()
    arguments = ["--results", str(tmp_path / "results"), "--out", str(tmp_path / "out"), "--only", "kit"]
    assert reproduce.main(arguments) == 0
    found = json.loads((tmp_path / "out" / "reproduction.json").read_text())
    (document,) = found["documents"]
    assert len(document["rows"]) == len(kit.records())
    assert (tmp_path / "out" / "report.pdf").stat().st_size > 10_000
    assert "Which published numbers are reproduced?" in (tmp_path / "out" / "report.html").read_text()
    assert "are reproduced" in capsys.readouterr().out


def test_bad_input_is_refused_before_anything_is_computed(tmp_path, capsys):
    bare = tmp_path / "bare.md"
    bare.write_text("no marks\n")
    assert reproduce.main(["--page", str(bare)]) == 2
    assert "the page needs marks" in capsys.readouterr().err
    assert reproduce.main(["--results", str(tmp_path / "nowhere"), "--only", "kit"]) == 2
    assert "there is no such folder" in capsys.readouterr().err
