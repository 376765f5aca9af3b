"""The report's sections on designs over all factors at once, on scores whose indices and boxes are known."""

from __future__ import annotations

import numpy as np
import pytest
import zarr

from harness.study.report import analyse, write_report
from harness.study.report.analysis import Analysis
from harness.study.report.ranking import Ranking, tolerances
from harness.study.report.sections import over_time, sensitivity, tolerance
from harness.study.report.sections.over_time import AlongDrive
from harness.study.results import read
from support import synthetic
from support.joint_study import WINDOWS, scores, study_of
from support.report_parts import Page

TARGETS = ("lateral_force_axle_21", "articulation_angle")


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("joint")
    study = study_of(path)
    synthetic.write(path / "out", scores(study))
    zarr.open_group(path / "out" / "scores.zarr", mode="r+").attrs["limits"] = (
        '{"articulation_angle": 0.03490658503988659}'
    )
    return path / "out"


@pytest.fixture(scope="module")
def analysis(folder):
    return Analysis(read(folder))


def words(blocks):
    return " ".join(str(vars(block)) for block in blocks)


def test_indices_are_those_of_the_error_that_was_made(analysis):
    ranking = Ranking(analysis.findings[0].design, seed=0)
    found = ranking.errors[1][0]
    np.testing.assert_allclose([t.value for t in found.total], [0.8, 0.2, 0.0], atol=0.06)
    np.testing.assert_allclose([f.value for f in found.first], [0.8, 0.2, 0.0], atol=0.12)
    assert ranking.divergence[0] is None  # it lost no run
    assert ranking.divergence[1].order[0] == 0
    assert ranking.divergence[1].total[0].value > 0.9
    assert ranking.of_ranks[1][0].order[:2] == [0, 1]


def test_diverged_runs_score_as_much_as_the_worst_that_finished(analysis):
    ranking = Ranking(analysis.findings[0].design, seed=0)
    lost = ranking.lost[1] == 1.0
    assert 0.0 < lost.mean() < 0.2
    np.testing.assert_allclose(ranking.outcomes[1, 1, lost], ranking.outcomes[1, 0].max())
    np.testing.assert_allclose(ranking.outcomes[1, 1, ~lost], ranking.outcomes[1, 0, ~lost])


def test_words_name_the_leading_factor_and_count_what_was_lost(analysis):
    told = words(sensitivity.blocks(analysis))
    assert "the total indices of the error are trailer mass" in told
    assert "UKF, the total indices of the share of diverged runs are trailer mass" in told
    diverged = int((analysis.findings[0].design.status[:, 1] == 1).sum())
    assert f"Of these diverged: EKF 0, UKF {diverged}." in told
    assert "128 base samples, 3 factors, hence 640 points, on 2 drives: 1280 runs" in told


def test_the_box_is_where_the_error_reaches_the_limit(analysis):
    """1 deg + 2 deg times the share of the way to 32 t is 2 deg at half of it, 28 t."""
    limit = {"articulation_angle": np.deg2rad(2.0)}
    found = tolerances(analysis.findings[1].design, limit)
    assert set(found) == {(1, 0), (1, 1)}
    assert found[1, 0].first == (0, True)
    assert found[1, 0].upper[0] == pytest.approx(0.5)
    assert 0.5 <= found[1, 0].box <= 0.75
    told = words(tolerance.blocks(analysis))
    assert "trailer mass above 28.0 t" in told
    assert "2.00°" in told


def test_an_estimator_that_does_not_give_a_target_tolerates_nothing_and_has_no_index(folder):
    """It has no error, which is neither a small one nor that of a lost run."""
    analysis = Analysis(read(folder))
    for findings in analysis.findings:
        findings.design.errors_under_control[1, :, 0] = np.nan  # the articulation angle of the first
    indices, nested = (f.design for f in analysis.findings[:2])
    assert (indices.giving(0), indices.giving(1)) == ([0, 1], [1])
    ranking = Ranking(indices, seed=0)
    assert ranking.errors[1][0] is None
    assert ranking.of_ranks[1][0] is None
    assert ranking.best(1) == 1
    assert ranking.errors[1][1] is not None
    found = tolerances(nested, {TARGETS[1]: 0.0349})
    assert list(found) == [(1, 1)]
    text = words(tolerance.blocks(analysis))
    assert f"{nested.estimators[1]} tolerates most" in text


def test_a_vehicle_out_of_control_is_charged_to_no_estimator(folder, tmp_path):
    """Heavy trailers spin: the error counts up to there, the limit is kept, and the mass is named as the cause."""
    made = scores(study_of(tmp_path))
    for data in made.values():
        heavy = data["factor_trailer_mass"] > 28.5e3
        for name, value in (("status", 2), ("rmse", np.deg2rad(0.5))):
            data[name] = data[name].where(~heavy, value).astype(data[name].dtype).transpose(*data[name].dims)
        data["loss_of_control"] = data["loss_of_control"].where(~heavy, 3.0).transpose(*data["loss_of_control"].dims)
    synthetic.write(tmp_path / "out", made)
    zarr.open_group(tmp_path / "out" / "scores.zarr", mode="r+").attrs["limits"] = '{"articulation_angle": 0.0349}'
    analysis = Analysis(read(tmp_path / "out"))
    joint, nested = (f.design for f in analysis.findings[:2])
    assert 0 < joint.out_of_control.sum() == (joint.factors[0].values > 28.5).sum() * 2
    assert not any(joint.diverged(e) for e in range(2))
    ranking = Ranking(joint, seed=0)
    assert ranking.divergence == [None, None]
    assert ranking.out_of_control.order[0] == 0
    assert np.isfinite(ranking.outcomes).all()
    told = words(sensitivity.blocks(analysis))
    assert "The largest total indices of the share of runs out of control are trailer mass" in told
    assert f"In {int(nested.out_of_control.sum())} runs, at" in words(tolerance.blocks(analysis))
    borne, whole = (tolerances(d, {TARGETS[1]: np.deg2rad(2.0)}) for d in (nested, read(folder).designs[1]))
    assert borne[1, 0].box > whole[1, 0].box  # the heavy edge broke the limit, and is the vehicle's doing now


def test_sensitivity_over_time_changes_with_the_cause(analysis):
    along = AlongDrive(Ranking(analysis.findings[0].design, seed=0), 1)
    assert along.total.shape == (3, WINDOWS, 3)
    np.testing.assert_allclose(along.total[0, :, 0], [1.0, 1.0, 0.0, 0.0], atol=0.06)
    np.testing.assert_allclose(along.total[1, :, 0], [0.0, 0.0, 1.0, 1.0], atol=0.06)
    assert len(over_time.blocks(analysis)) == 1 + len(TARGETS)


def test_an_order_that_the_samples_do_not_tell_is_said_to_be_open(analysis):
    told = words(sensitivity.blocks(analysis)) + " ".join(sensitivity.in_short(analysis.main.ranking))
    assert "too few to decide" not in told  # mass makes four times the variance that friction makes
    ranking = Ranking(analysis.findings[0].design, seed=0)
    mass, friction, _ = points_of(ranking)
    ranking.outcomes[1] = 10.0 + mass + friction
    told = sensitivity.in_short(ranking)[1]
    assert "is driven by" in told
    assert "128 base samples are too few to decide whether" in told


def test_indices_that_the_samples_do_not_tell_are_not_stated(analysis):
    ranking = Ranking(analysis.findings[0].design, seed=0)
    ranking.outcomes[1] = np.random.default_rng(4).standard_cauchy(ranking.outcomes[1].shape) ** 2
    told = sensitivity.in_short(ranking)[1]
    assert told.endswith("is driven by factors that 128 base samples are too few to tell.")


def points_of(ranking):
    """Values of the factors at the points of the design, each with unit variance."""
    values = np.stack([f.values[0] for f in ranking.design.factors])
    return (values - values.mean(axis=1, keepdims=True)) / values.std(axis=1, keepdims=True)


def test_unfinished_designs_have_no_indices(tmp_path):
    study = study_of(tmp_path)
    made = scores(study)
    made["joint"]["status"][0, 3, 0] = -1
    synthetic.write(tmp_path / "out", made)
    analysis = Analysis(read(tmp_path / "out"))
    assert "is not finished" in words(sensitivity.blocks(analysis))
    assert over_time.blocks(analysis) == []


def test_a_design_too_small_to_be_divided_has_no_picture_of_convergence(tmp_path, analysis):
    synthetic.write(tmp_path / "out", scores(study_of(tmp_path, samples=4)))
    small = sensitivity.blocks(Analysis(read(tmp_path / "out")))
    assert "Are there enough samples" not in words(small)
    assert "Are there enough samples" in words(sensitivity.blocks(analysis))


def test_a_whole_report_is_written(folder):
    html = Page(write_report(analyse(folder))[0].read_text(encoding="utf-8")).text
    assert "the error of the articulation angle is driven by trailer mass (total index 0." in html
    assert "How far may all factors drift? For the articulation angle: " in html
    for question in ("Which parameter drives the error?", "How far may the vehicle drift in all factors at once?",
                     "Which parameter causes the error, and when?"):  # fmt: skip
        assert question in html
