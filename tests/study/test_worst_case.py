"""Tuning for the worst case: the tail's mean, a box in which the best noise is known, file, report and refusals."""

import dataclasses

import numpy as np
import pytest

from harness.common.errors import UserError
from harness.common.statistics import tail_mean
from harness.config import load_study
from harness.reporting.document import Picture, Sheet, made
from harness.study import worst_case_report
from harness.study.design import Unit
from harness.study.evaluate import StudyEvaluator
from harness.study.run_noise import Case
from harness.study.worst_case import box_of, tune_for_worst_case, write_worst_case
from support.small_study import EKF, SEMITRAILER

STUDY = f"""
name = "worst"
seed = 4
targets = ["articulation_angle"]
{SEMITRAILER}{EKF}[[drive]]
name = "weave"
kind = "sine"
duration = 20
[[design]]
name = "noise"
samples = 2
[[design.factor]]
parameter = "measurement_noise_scale"
range = [1, 1e6]
scale = "log"
[[design]]
name = "nothing"
"""


def test_the_mean_of_a_tail_is_the_conditional_value_at_risk():
    assert tail_mean(np.arange(1, 101)) == pytest.approx(98.0)  # of 96 to 100
    assert tail_mean([5.0, 1.0, 3.0], 1.0) == pytest.approx(3.0)
    assert tail_mean(np.arange(1, 11), 0.25) == pytest.approx((10 + 9 + 0.5 * 8) / 2.5)
    assert tail_mean([1.0, 2.0, np.inf], 0.4) == np.inf
    assert tail_mean([1.0] * 98 + [np.inf] * 2, 0.01) == np.inf
    normal = np.random.default_rng(1).normal(size=200_000)
    assert tail_mean(normal) == pytest.approx(np.exp(-(1.6448536**2) / 2) / np.sqrt(2 * np.pi) / 0.05, rel=0.01)


@pytest.fixture(scope="module")
def study(tmp_path_factory):
    path = tmp_path_factory.mktemp("worst") / "worst.toml"
    path.write_text(STUDY)
    return load_study(path)


@pytest.fixture(scope="module")
def found(study):
    return tune_for_worst_case(study, study.design("noise"), budget=96, points=8)


def test_against_noisier_sensors_it_believes_them_less(found):
    """The sensor of the worst runs has up to a million times the variance; at home it is as believed."""

    def trust(c):
        return c.factors.get("measurement", 1) / c.factors.get("unknown_inputs", 1)

    one = found["EKF"]
    at_home = min(one.tried, key=lambda c: c.nominal)
    assert trust(one.after) > 30 * trust(at_home)
    assert one.after.worst < 0.5 * one.before.worst
    assert one.checked[1] < 0.5 * one.checked[0]
    assert one.after.nominal > at_home.nominal
    assert one.before.nominal == pytest.approx(1.0)


def test_the_front_has_both_ends_and_nothing_is_better_in_both(found):
    one = found["EKF"]
    front = one.front
    assert front[-1] == one.after
    assert front[0].nominal == min(c.nominal for c in one.tried)
    assert not [c for c in one.tried for f in front if c.nominal < f.nominal and c.worst < f.worst]
    assert len(one.tried) == 1 + 96


def test_the_same_again_whatever_the_threads(study, found):
    again = tune_for_worst_case(study, study.design("noise"), budget=96, points=8, jobs=1)["EKF"]
    assert again.after.factors == found["EKF"].after.factors
    assert again.checked == found["EKF"].checked


def test_a_study_that_takes_the_file_has_the_smaller_worst_case(study, found, tmp_path):
    write_worst_case(tmp_path / "noise.toml", study, study.design("noise"), 96, 8, found, "harness tune worst")
    (tmp_path / "worst.toml").write_text(STUDY.replace("seed = 4", 'seed = 5\ntuning = "noise.toml"'))
    tuned = load_study(tmp_path / "worst.toml")
    assert "conditional value at risk" in tuned.tuning
    worst = []
    for some in (study, tuned):
        box = box_of(some, some.design("noise"), 64)
        evaluator = StudyEvaluator(dataclasses.replace(some, seed=5, designs=(box,)))
        errors = []
        for first in range(0, 64, 8):
            unit, cases = Unit(0, 0, 0, first, first + 8), [Case(s, 0) for s in range(first, first + 8)]
            batch, believed = evaluator.simulate(unit, cases), evaluator.held(unit, cases, "belief")
            errors.append(evaluator.estimate(0, unit, cases, batch, believed).rmse[0])
        worst.append(np.sort(np.ravel(errors))[-3:].mean())
    assert worst[1] < 0.5 * worst[0]


def test_the_report_draws_the_front_and_states_both_errors(study, found):
    report = worst_case_report.report(study, study.design("noise"), found, "harness tune worst")
    blocks = made(report.sections)
    assert "EKF: worst case" in worst_case_report.answer(found)
    assert [b for b in blocks if isinstance(b, Picture)]
    first = next(b for b in blocks if isinstance(b, Sheet))
    assert [row[1] for row in first.rows] == ["as it is", "found"]


def test_what_has_no_worst_case_is_refused(study):
    with pytest.raises(UserError, match="design 'nothing' varies nothing"):
        tune_for_worst_case(study, study.design("nothing"), budget=96)
    with pytest.raises(UserError, match="too small"):
        tune_for_worst_case(study, study.design("noise"), budget=95)
    with pytest.raises(UserError, match="no estimator 'UKF'"):
        tune_for_worst_case(study, study.design("noise"), budget=96, only=["UKF"])
