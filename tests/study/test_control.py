"""A vehicle out of control: found from the plant, once per run, and no estimator's fault."""

from dataclasses import replace

import numpy as np
import pytest

from harness.config import load_study
from harness.study.compiled_study import asked_too_much
from harness.study.design import Unit, units
from harness.study.evaluate import StudyEvaluator
from harness.study.replay import Place, Replayer
from harness.study.run_noise import Case
from harness.study.score_names import LOST_CONTROL, OK, PLANT_DIVERGED

SPIN = """
name = "spin"
targets = ["lateral_velocity"]
estimator = [{ name = "EKF", kind = "ekf" }, { name = "PF", kind = "particle", particles = 64 }]
plant = { vehicle = "car_two_track", parameters = "althoff_2020", tyre = "magic_formula", sensors = "car_series" }
belief = { vehicle = "car", parameters = "govindarajan_2018", sensors = "car_series" }

[[drive]]
name = "sine"
kind = "sine"
speed = "25 m/s"
amplitude = "20 deg"
duration = "12 s"
lateral_acceleration_limit = "9 m/s^2"

[[design]]
name = "level"
repeats = 8
factor = [{ parameter = "friction", levels = [0.3, 1.0489] }]
"""


@pytest.fixture(scope="module")
def spin(tmp_path_factory):
    """A car that spins at the first level and not at the second: its study, evaluator and the units' scores."""
    path = tmp_path_factory.mktemp("spin") / "spin.toml"
    path.write_text(SPIN)
    study = load_study(path)
    evaluator = StudyEvaluator(study)
    return study, evaluator, [evaluator.evaluate(unit) for unit in units(study, study.designs[0])]


def test_a_vehicle_out_of_control_ends_its_run_at_one_sample_for_all_estimators(spin):
    study, _evaluator, (wild, calm) = spin
    assert (wild["status"] == PLANT_DIVERGED).all()
    ends = wild[LOST_CONTROL]
    assert np.isfinite(ends).all()
    np.testing.assert_array_equal(wild["time_of_divergence"], np.broadcast_to(ends[..., None], (1, 8, 2)))
    np.testing.assert_array_equal(wild["updates"], np.round(wild["time_of_divergence"] / study.plant.step) - 1)
    assert (calm["status"] == OK).all()
    assert np.isnan(calm[LOST_CONTROL]).all()
    assert np.isfinite(wild["rmse"]).all()  # up to there


def test_control_is_lost_where_an_axle_first_slides_more_sideways_than_it_rolls(spin):
    _, evaluator, (wild, _) = spin
    batch = evaluator.simulate(Unit(0, 0, 0, 0, 1), [Case(0, r) for r in range(8)])
    names = [n for n in evaluator.compiled.truth_names if n.startswith("slip_angle_axle_")]
    assert len(names) == 4
    slips = np.abs(batch.truth[:, [evaluator.compiled.truth_names.index(n) for n in names]]).max(axis=1)
    first = np.argmax(slips > np.pi / 4, axis=0)
    np.testing.assert_allclose(wild[LOST_CONTROL][0], first * 0.01)


def test_a_replayed_run_ends_where_the_study_ended_it(spin):
    study, _, (wild, _) = spin
    replayed = Replayer(study).run(Place(0, 0, 0, 0, 3), everything=True)
    end = wild[LOST_CONTROL][0, 3]
    assert replayed.scores["status"].tolist() == [PLANT_DIVERGED] * 2
    for data in (replayed.data["estimate"], replayed.everything["lateral_velocity"]):
        assert data.where(data["time"] < end - 1e-9, drop=True).notnull().all()
        assert data.where(data["time"] > end - 1e-9, drop=True).isnull().all()


def test_a_drive_that_asks_for_more_than_friction_gives_is_named(spin):
    study, evaluator, _ = spin
    (sentence,) = asked_too_much(study, evaluator.compiled)
    assert "drive 'sine' asks for 5.3 m/s^2" in sentence
    assert "2.9 m/s^2 in design 'level'" in sentence
    gripping = replace(study, designs=())
    assert asked_too_much(gripping, evaluator.compiled) == []
