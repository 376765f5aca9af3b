"""Tuning: it finds the noise that was there, treats all estimators alike, and a study takes its result."""

import dataclasses
import re

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.config import load_drives, load_study
from harness.engine.simd.lanes import LANES
from harness.study.compiled_study import scale_noise
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case
from harness.study.tune import Tuning, tune, write_tuning
from support.small_study import EKF, SEMITRAILER

STUDY = f"""
name = "tuned"
seed = 4
targets = ["articulation_angle"]
{SEMITRAILER}[belief.noise]
measurement_scale = 20

{EKF}[[drive]]
name = "weave"
kind = "sine"
duration = 30
[[design]]
name = "level"
"""
HEAD = 'rule = "r"\ndrives = []\nbudget = 1\n'


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    path = tmp_path_factory.mktemp("tune") / "tuned.toml"
    path.write_text(STUDY)
    return load_study(path)


@pytest.fixture(scope="module")
def found(study):
    return tune(study, budget=288)


def test_finds_the_measurement_noise_that_was_there(found):
    """The belief starts with twenty times the variance; 3000 samples determine it within a few percent."""
    assert found["EKF"].factors["measurement"] == pytest.approx(1 / 20, rel=0.1)
    assert found["EKF"].after > found["EKF"].before + 1000


def test_is_reproducible(study, found):
    assert tune(study, budget=288) == found


def test_a_study_takes_the_file_and_its_estimator_the_factors(study, found, tmp_path):
    write_tuning(tmp_path / "noise.toml", study, 288, 1, found, "harness tune tuned --budget 288")
    written = (tmp_path / "noise.toml").read_text()
    assert written.startswith("# Written by: harness tune tuned --budget 288\n")
    assert re.search(r"^\[estimator\.EKF\] # log-likelihood \S+ before, \S+ after$", written, re.MULTILINE)
    path = tmp_path / "tuned.toml"
    path.write_text(STUDY.replace("seed = 4", 'seed = 4\ntuning = "noise.toml"'))
    tuned = load_study(path)
    assert tuned.estimators[0].noise == found["EKF"].factors
    assert "weave" in tuned.tuning
    assert tuned.hash != study.hash
    evaluator, unit, case = StudyEvaluator(tuned), Unit(0, 0, 0, 0, 1), [Case(0, 0)]
    batch, held = evaluator.simulate(unit, case, 500), evaluator.held(unit, case, "belief")
    by_file = evaluator.estimate(0, unit, case, batch, held)
    plain = dataclasses.replace(tuned.estimators[0], noise={})
    bare = StudyEvaluator(dataclasses.replace(tuned, estimators=(plain,)))
    by_hand = bare.estimate(0, unit, case, batch, scale_noise(held, tuned.belief, found["EKF"].factors))
    np.testing.assert_array_equal(by_file.log_likelihood, by_hand.log_likelihood)


def test_groups_are_scaled_apart(study):
    evaluator = StudyEvaluator(study)
    held = evaluator.held(Unit(0, 0, 0, 0, 1), [Case(0, 0)], "belief")
    scaled = scale_noise(held, study.belief, {"process": 2.0, "unknown_inputs": 3.0, "measurement": 5.0})
    np.testing.assert_allclose(scaled.process_noise / held.process_noise, np.outer([2.0] * 10 + [3.0], np.ones(LANES)))
    np.testing.assert_allclose(scaled.measurement_noise, 5 * held.measurement_noise)
    assert scale_noise(held, study.belief, {}) is held


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (None, "harness tune"),
        ("rule = 3", "is not a tuning file"),
        (
            'rule = "r"\ndrives = []\nbudget = 1\n[estimator.EKG]\nprocess = 1\nunknown_inputs = 1\nmeasurement = 1',
            "EKF",
        ),
        (
            'rule = "r"\ndrives = []\nbudget = 1\n[estimator.EKF]\nprocess = -1\nunknown_inputs = 1\nmeasurement = 1',
            "positive",
        ),
        (
            'rule = "r"\ndrives = []\nbudget = 1\n[estimator.EKF]\nprocess = "1_5"\nunknown_inputs = 1\n'
            "measurement = 1",
            "factor 'process' of 'EKF': '1_5' means '15'",
        ),
    ],
)
def test_wrong_tuning_files_are_refused(tmp_path, text, message):
    if text is not None:
        (tmp_path / "noise.toml").write_text(text)
    path = tmp_path / "tuned.toml"
    path.write_text(STUDY.replace("seed = 4", 'seed = 4\ntuning = "noise.toml"'))
    with pytest.raises(UserError, match=message):
        load_study(path)


def test_only_the_named_are_tuned_and_the_others_keep_their_noise(study, found, tmp_path):
    second = 'name = "EKF, tuned"\nkind = "ekf"\n[[estimator]]\nname = "network"\nkind = "narx"\n'
    text = STUDY.replace("[[drive]]", f"[[estimator]]\n{second}[[drive]]", 1).replace(
        "seed = 4", 'seed = 4\ntuning = "to come.toml"'
    )
    (tmp_path / "two.toml").write_text(text)
    with pytest.raises(UserError, match="harness tune"):
        load_study(tmp_path / "two.toml")
    bare = load_study(tmp_path / "two.toml", tuned=False)
    of_one = tune(bare, 288, only=["EKF, tuned"])
    assert list(of_one) == ["EKF, tuned"]
    assert of_one["EKF, tuned"].factors == found["EKF"].factors  # same drives, noise and candidates
    write_tuning(tmp_path / "to come.toml", bare, 288, 1, of_one, "harness tune two")
    noise = {e.name: e.noise for e in load_study(tmp_path / "two.toml").estimators}
    assert noise == {"EKF": {}, "EKF, tuned": found["EKF"].factors, "network": {}}
    with pytest.raises(UserError, match="there is no estimator 'EKF, tund'; closest: EKF, tuned"):
        tune(bare, 288, only=["EKF, tund"])
    with pytest.raises(UserError, match="network states no likelihood"):
        tune(bare, 288, only=["EKF, tuned", "network"])


def test_a_factor_at_the_end_of_the_search_is_named():
    factors = {"process": 1.0, "unknown_inputs": 9.9e3, "measurement": 1.01e-4}
    assert Tuning(factors, 0.0, 1.0).at_the_edge == ["unknown_inputs", "measurement"]
    assert Tuning(dict.fromkeys(factors, 100.0), 0.0, 1.0).at_the_edge == []


def test_small_budgets_and_unknown_drives_are_refused(study, tmp_path):
    with pytest.raises(UserError, match="too small"):
        tune(study, budget=10)
    with pytest.raises(UserError, match="no set of drives"):
        load_drives("nowhere", tmp_path)
