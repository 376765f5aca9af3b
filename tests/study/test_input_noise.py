"""Noise of the inputs in a study: what it changes and what it leaves as it is, and the share of the error it has."""

from dataclasses import replace

import numpy as np
import pytest

from harness.common.statistics import share_of_squares
from harness.config import build_study
from harness.engine.simd.lanes import LANES
from harness.reporting.document import Picture, Prose, Sheet, plain
from harness.study.design import Unit, units
from harness.study.evaluate import StudyEvaluator
from harness.study.report.analysis import Analysis
from harness.study.report.sections import inputs
from harness.study.results import read
from harness.study.run import run_study
from harness.study.run_noise import Case

PLANT = {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "linear", "sensors": "car_series"}
NOISE = {"input": {"speed": 4e-2, "steering_wheel_angle": 9e-5}}
WAYS = {"EKF filtered": {}, "EKF as measured": {"input_signal": "measured"}}


def study_of(plant=PLANT, ways=WAYS, levels=(0, 1), **more):
    factor = {"parameter": "input_noise_scale", "of": "both", "levels": list(levels)}
    return build_study(
        {
            "name": "noisy",
            "targets": ["lateral_velocity", "yaw_rate"],
            "plant": plant,
            "estimator": [{"name": name, "kind": "ekf", **keys} for name, keys in ways.items()],
            "drive": [{"name": "w", "kind": "winding_road", "duration": "20 s", "speed": "20 m/s"}],
            "design": [{"name": "level", "repeats": 2 * LANES, **({"factor": [factor]} if levels else {})}],
            **more,
        }
    )


@pytest.fixture(scope="module")
def noisy():
    return StudyEvaluator(study_of({**PLANT, "noise": NOISE}))


@pytest.fixture(scope="module")
def exact():
    return StudyEvaluator(study_of(ways={"EKF": {}}, levels=()))


@pytest.fixture(scope="module")
def scores(noisy):
    """By band."""
    return [noisy.evaluate(unit) for unit in units(noisy.study, noisy.study.designs[0])]


def test_without_noise_of_inputs_nothing_is_another_study(exact):
    assert exact.study.plant.input_noise == {}
    assert study_of(ways={"EKF": {"input_signal": "measured"}}, levels=()).hash == exact.study.hash
    assert study_of({**PLANT, "noise": NOISE}, {"EKF": {}}, ()).hash != exact.study.hash
    table, *further = exact.inputs(0, 0, exact.simulate(Unit(0, 0, 0, 0, 1), [Case(0, 0)]), None)
    assert further == [None] * 4
    np.testing.assert_array_equal(table, exact.compiled.drives[0].belief)


def test_vehicle_and_measurements_do_not_know_of_it(noisy, exact):
    group = [Case(0, r) for r in range(LANES)]
    one, two = noisy.simulate(Unit(0, 1, 0, 0, 1), group), exact.simulate(Unit(0, 0, 0, 0, 1), group)
    np.testing.assert_array_equal(one.measurements, two.measurements)
    np.testing.assert_array_equal(one.truth, two.truth)
    assert one.input_errors["speed"].std() == pytest.approx(0.2, rel=0.02)
    assert np.abs(np.corrcoef(one.input_errors["speed"].T) - np.eye(LANES)).max() < 0.1
    assert two.input_errors == {}


def test_exact_inputs_that_are_known_to_be_give_the_scores_without_noise(scores, exact):
    """Up to rounding: told of errors of zero, the filter corrects by all measurements at once."""
    plain = exact.evaluate(units(exact.study, exact.study.designs[0])[0])
    for e in range(2):
        np.testing.assert_allclose(scores[0]["rmse"][:, :, e], plain["rmse"][:, :, 0], rtol=1e-7)
        np.testing.assert_allclose(scores[0]["nees"][:, :, e], plain["nees"][:, :, 0], rtol=1e-6)


def test_filters_that_know_of_the_noise_state_what_they_err(scores):
    for e in range(2):
        assert (scores[1]["rmse"][:, :, e] > scores[0]["rmse"][:, :, e]).mean() > 0.9
        nees, nis = (float(scores[1][name][:, :, e].mean()) / 2 for name in ("nees", "nis"))
        assert 0.7 < nees < 1.5
        assert 0.9 < nis < 1.1


@pytest.mark.parametrize("index", [0, 1])
def test_no_estimator_sees_a_later_input(noisy, index):
    unit, group = Unit(0, 1, 0, 0, 1), [Case(0, r) for r in range(LANES)]
    batch, believed = noisy.simulate(unit, group), noisy.held(unit, group, "belief")
    later = {name: errors.copy() for name, errors in batch.input_errors.items()}
    for errors in later.values():
        errors[1000:] += 0.3
    runs = [
        noisy.estimate(index, unit, group, b, believed, keep=True) for b in (batch, replace(batch, input_errors=later))
    ]
    np.testing.assert_array_equal(runs[0].kept[:1000], runs[1].kept[:1000])
    assert (runs[0].kept[1100:] != runs[1].kept[1100:]).any()


def test_errors_of_a_step_are_those_of_its_end_only_where_they_last(noisy):
    unit, group = Unit(0, 1, 0, 0, 1), [Case(0, r) for r in range(LANES)]
    batch, believed = noisy.simulate(unit, group), noisy.held(unit, group, "belief")
    lasting, single = (noisy.inputs(i, 0, batch, believed) for i in (0, 1))
    np.testing.assert_array_equal(lasting.errors_between, lasting.errors_at)
    apart = ((errors != 0).any(axis=(0, 1, 3)) for errors in (single.errors_between, single.errors_at))
    assert not np.logical_and(*apart).any()
    speed = noisy.compiled.belief.model.inputs.index("speed")
    exact = noisy.compiled.drives[0].belief[:, speed]
    np.testing.assert_allclose(single.at[:, speed] - exact, batch.input_errors["speed"], atol=1e-12)


def test_share_of_squares_is_that_of_the_cause():
    rng = np.random.default_rng(2)
    base, cause = rng.normal(size=(2, 4000))
    found = share_of_squares(np.abs(base) + 3.0, np.sqrt((np.abs(base) + 3.0) ** 2 + (1 + 0.1 * cause) ** 2))
    expected = 1.01 / (np.mean((np.abs(base) + 3.0) ** 2) + 1.01)
    assert found.value == pytest.approx(expected, rel=0.02)
    assert found.lower < expected < found.upper
    assert np.isnan(share_of_squares([np.nan], [1.0]).value)
    assert share_of_squares([2.0, np.nan], [1.0, 5.0]).value == pytest.approx(-3.0)


def test_the_report_says_what_the_inputs_make_up(tmp_path):
    study = study_of({**PLANT, "noise": NOISE}, levels=(0, 1, 4))
    analysis = Analysis(read(run_study(study, tmp_path / "noisy", jobs=1)))
    shares = analysis.main.input_shares
    rmse = analysis.main.design.rmse[1, :, 0]
    assert shares[1, 2, 0, 0] == pytest.approx(1 - (rmse[0] ** 2).sum() / (rmse[2] ** 2).sum())
    assert (shares[:, 0] == 0).all()
    assert (shares[:, 2, :, 0] > shares[:, 1, :, 0]).all()
    blocks = inputs.blocks(analysis)
    (sentence,) = inputs.in_short(analysis.main)
    assert plain(sentence).rstrip(";").rstrip('"') in next(b for b in blocks if isinstance(b, Prose)).markup
    assert f"{100 * shares[1, 2, :, 0].max():.0f} %" in sentence
    assert "at ×4" in sentence
    assert len([b for b in blocks if isinstance(b, Picture)]) == 1
    assert len([b for b in blocks if isinstance(b, Sheet)]) == 2
    exact = Analysis(read(run_study(study_of(ways={"EKF": {}}, levels=()), tmp_path / "plain", jobs=1)))
    assert inputs.blocks(exact) == []
    assert inputs.in_short(exact.main) == []


def test_square_root_forms_are_told_of_the_errors_of_inputs_as_the_others_are():
    kinds = [{"name": k, "kind": k} for k in ("ekf", "sr_ekf", "ukf", "sr_ukf")]
    evaluator = StudyEvaluator(study_of({**PLANT, "noise": NOISE}, levels=(), estimator=kinds))
    unit, cases = Unit(0, 0, 0, 0, 1), [Case(0, r) for r in range(LANES)]
    batch, believed = evaluator.simulate(unit, cases, 500), evaluator.held(unit, cases, "belief")
    found = [evaluator.estimate(i, unit, cases, batch, believed) for i in range(len(kinds))]
    for usual, root in ((0, 1), (2, 3)):
        for what in ("rmse", "nees", "nis", "log_likelihood"):
            np.testing.assert_allclose(getattr(found[root], what), getattr(found[usual], what), rtol=1e-6)
