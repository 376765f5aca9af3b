"""What an amendment is worth: the study that is derived, the comparison of both beliefs, and how it is told."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.config import resolve_single
from harness.config.parameter_set import set_text
from harness.diagnosis.report import study_gain
from harness.diagnosis.result import study_gain as stage
from harness.diagnosis.result.study_gain import StudyGain
from harness.reporting.document import Picture, Sheet
from harness.study.results import read
from harness.study.score_names import OK
from support import synthetic

ROOT = Path(__file__).parents[2]
MASS = ROOT / "studies" / "mass.toml"
TRUCK = {"vehicle": "semitrailer", "parameters": "ziaukas_2023", "tyre": "magic_formula", "sensors": "test_vehicle"}


@pytest.fixture
def models(tmp_path):
    """A nominal model and one with a gust and a heavier trailer, written as a trace writes them."""
    gust = {"crosswind_force_trailer": 8e3, "crosswind_onset": 47.0, "crosswind_end": 50.0, "trailer_mass": 26e3}
    specs = {
        "nominal": resolve_single(TRUCK, "test"),
        "amended": resolve_single({**TRUCK, "effects": ["crosswind"], "values": gust}, "test"),
    }
    for name, spec in specs.items():
        (tmp_path / f"{name}.toml").write_text(set_text(spec, "test", {}))
    return specs


FILTERS = [{"name": "EKF", "kind": "ekf"}, {"name": "EKF, rough", "kind": "ekf", "roughness": 2}]


@pytest.fixture
def studies(tmp_path, models, monkeypatch):
    """The two studies that are run, as resolved."""
    seen = {}

    def score(study, out, jobs, console):
        seen[out.name] = study
        synthetic.write(out, {"level": synthetic.design(repeats=2)})

    monkeypatch.setattr(stage, "run_study", score)
    found = stage.study_gain(MASS, tmp_path, models, ("ekf", "particle", "st_cdkf"), repeats=2)
    return seen, found


def test_both_studies_have_the_amended_plant_and_differ_in_the_belief_alone(studies, models):
    nominal, amended = studies[0]["nominal"], studies[0]["amended"]
    assert nominal.plant == amended.plant
    assert amended.plant.effects == amended.belief.effects == ("crosswind",)
    assert nominal.belief.effects == ()
    assert (nominal.belief.values["trailer_mass"], amended.belief.values["trailer_mass"]) == (24e3, 26e3)
    assert nominal.belief.unknown_inputs == amended.belief.unknown_inputs == ("steering_wheel_angle",)
    assert [(e.name, e.kind) for e in amended.estimators] == [
        ("EKF", "ekf"), ("ST-CDKF", "st_cdkf"), ("PF", "particle")
    ]  # fmt: skip
    assert amended.estimators[1].settings["softening"] == 10
    assert (nominal.seed, nominal.drives) == (amended.seed, amended.drives)
    assert nominal.designs == amended.designs
    assert (amended.designs[0].repeats, len(amended.designs)) == (2, 1)


def test_estimators_that_only_their_tuning_tells_apart_are_run_once():
    kept = stage.bare_tables(
        {"estimator": [*FILTERS, {"name": "EKF, tuned", "kind": "ekf"}, "ekf"], "design": [{}]}, ("ekf",), 2
    )
    assert kept["estimator"] == FILTERS


def test_changes_are_put_inside_the_shortest_drive_in_their_order(studies):
    amended, found = studies[0]["amended"], studies[1]
    assert found.change_times == {"crosswind_onset": 20.0, "crosswind_end": 40.0}  # the shortest drives last 60 s
    for spec in (amended.plant, amended.belief):
        assert {n: spec.values[n] for n in found.change_times} == found.change_times


def test_points_that_depend_on_the_belief_are_those_of_the_amended_one_in_both(tmp_path, models, monkeypatch):
    text = MASS.read_text().replace(
        'levels = ["8 t", "12 t", "16 t", "20 t", "24 t", "28 t", "32 t"]', 'shift = ["1 t"]'
    )
    text = text.split("[history]")[0].replace('"robustness"', f'"{ROOT}/studies/drives/robustness.toml"')
    (tmp_path / "shift.toml").write_text(text.replace("levels", "shift"))
    seen = []

    def score(study, out, *_):
        seen.append(study)
        synthetic.write(out, {"level": synthetic.design(repeats=2)})

    monkeypatch.setattr(stage, "run_study", score)
    stage.study_gain(tmp_path / "shift.toml", tmp_path, models, ("ekf",))
    assert [s.designs[0].factors[0].levels for s in seen] == [(27e3,), (27e3,)]


@pytest.mark.parametrize(("what", "value"), [("vehicle", "car"), ("tyre", "linear")])
def test_a_study_of_another_vehicle_or_tyre_is_refused(what, value, models):
    with pytest.raises(UserError, match=f"plant.{what} is '.*', that of the traced model '{value}'"):
        stage.refuse_study(MASS, dataclasses.replace(models["nominal"], **{what: value}))
    stage.refuse_study(MASS, models["nominal"])


@pytest.fixture
def made(tmp_path):
    """Return a function that compares two synthetic studies, the second with errors smaller by a factor."""

    def make(factor=0.5, **options) -> StudyGain:
        designs = []
        for name, share in (("nominal", 1.0), ("amended", factor)):
            data = synthetic.design(repeats=8, **options)
            data["rmse"] = share * data["rmse"]
            designs.append(read(synthetic.write(tmp_path / name, {"level": data})).designs[0])
        return StudyGain(Path("studies/mass.toml"), "How wrong?", *designs, 1, {"crosswind_onset": 26.7})

    return make


def test_an_error_that_halves_in_every_run_has_the_ratio_one_half(made):
    gain = made().gain(0, 1)
    assert gain.ratio == pytest.approx((0.5, 0.5, 0.5))
    assert gain.after == pytest.approx(0.5 * gain.before)
    assert (gain.estimator, gain.lost) == ("EKF", (0, 0))


def test_only_runs_that_both_beliefs_finished_are_compared_and_lost_ones_are_counted(made):
    worth = made()
    worth.amended.data["status"][0, 0, :, :, 0] = 1
    first = made().gain(0, 0, 0)
    assert worth.amended.status[0, 0].max() != OK
    assert np.isnan(worth.gain(0, 0, 0).ratio.value)
    assert worth.gain(0, 0, 0).lost == (0, first.lost[1] + 48)
    assert worth.gain(0, 0).ratio.value == pytest.approx(0.5)


def test_the_answer_is_told_at_the_level_believed_and_over_all(made):
    text = study_gain.answer(made())
    assert (
        "50 % in lateral force axle 21 and 50 % in articulation angle with the trailer mass as believed (24 t)" in text
    )
    assert text.endswith("over all levels.")
    assert "(no difference shown)" in study_gain.answer(made(1.0))


def test_the_section_shows_both_beliefs_and_says_when_changes_come(made):
    blocks = study_gain.blocks(made())
    assert "crosswind onset 26.7 s" in str(blocks)
    picture = next(b for b in blocks if isinstance(b, Picture))
    assert b"<svg" in picture.svg
    sheet = next(b for b in blocks if isinstance(b, Sheet))
    assert len(sheet.rows) == 2 * 2 * 2  # targets, estimators, level believed and all
    assert study_gain.blocks(None) == []
    assert "cannot be run" in str(study_gain.blocks("it cannot be run"))
