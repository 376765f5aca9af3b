"""What the report says in words: the opening sentence and the answer's paragraphs."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest

from harness.reporting import style
from harness.reporting.document import Bullets, Prose
from harness.study.report.analysis import Analysis, Findings
from harness.study.report.opening import answer_in_short
from harness.study.report.sections import answer, boxes, paired
from harness.study.results import Design, StudyResults, read
from harness.study.score_names import ESTIMATOR_DIVERGED, PLANT_DIVERGED
from support import synthetic
from support.report_parts import everything


def _words(analysis: Analysis) -> str:
    """Everything that the answer says in its bullets."""
    return " ".join(item for block in answer.blocks(analysis) if isinstance(block, Bullets) for item in block.items)


def _answer(design: Design, limits: dict[str, float] | None = None) -> str:
    """The answer of a study of this design alone."""
    attributes = {"limits": limits} if limits else {}
    return answer_in_short(Analysis(StudyResults(Path("study"), attributes, [design], [])))


def test_words_when_no_vehicle_stays_under_control(one_design):
    assert "In 42 of 42 runs the vehicle itself goes out of control" in _words(one_design(status=everything))


def _row(findings: Findings, estimator: str) -> dict[str, str]:
    """The cells of an estimator's first row in the table of the answer, by header."""
    sheet = answer.table(findings)
    cells = next(row for row in sheet.rows if row[1] == estimator)
    return dict(zip(sheet.header, cells, strict=True))


def test_no_difference_is_called_none(one_design):
    design = one_design(repeats=20).main.design
    design.errors[:, :, 1] = design.errors[:, :, 0]
    row = _row(Findings(design, 0), "UKF")
    assert row["same run, all levels"] == "1.00 (0/40) n.s."
    assert _row(Findings(design, 0), "EKF")["same run, all levels"] == "reference"


def test_few_runs_are_compared_by_what_they_show(one_design):
    """Ten times worse in 8 of 8 runs: no test can show it among 128 comparisons, and the table does."""
    analysis = one_design(estimators=NINE, repeats=8, drives=synthetic.DRIVES[:1])
    design = analysis.main.design
    design.errors[:, :, 1:] = design.errors[:, :, :1] * np.linspace(1.2, 10.0, 8)[:, None, None, None]
    analysis.findings = [findings := Findings(design, 0)]
    assert len(findings.comparisons) == 128
    assert (findings.pairs_needed, findings.decides) == (13, False)  # 128 * 2 / 2**13 is the first below 0.05
    assert _row(findings, NINE[-1])["same run, 24 t"] == "10.0 (0/8)"
    assert "8 pairs of runs and 128 comparisons" in answer.few(findings)
    (*_, sheet) = paired.blocks(analysis)
    assert "p (Holm)" not in sheet.header
    assert sheet.rows[-1][2:] == ["10.0", "10.0 to 10.0", "0 of 8"]


def test_a_design_with_enough_runs_has_tests(one_design):
    analysis = one_design(repeats=20)
    assert (analysis.main.pairs_needed, analysis.main.decides) == (10, True)  # of 16 comparisons
    assert answer.few(analysis.main) == ""
    (*_, sheet) = paired.blocks(analysis)
    assert sheet.header[-1] == "p (Holm)"


def test_fewer_than_six_runs_have_no_interval_and_no_dash(one_design):
    analysis = one_design(repeats=2, drives=synthetic.DRIVES[:1])
    medians = _medians(analysis.main.design)
    assert _row(analysis.main, "UKF")["24 t"] == style.number(medians[0, 4, 1])
    assert "without interval" in answer.few(analysis.main)
    assert not any("–" in cell for row in boxes.table(analysis.main, 0).rows for cell in row)


def test_the_table_of_the_answer_has_the_medians_and_their_growth(one_design):
    design = one_design().main.design
    medians = _medians(design)
    row = _row(Findings(design, 0), "UKF")
    assert row["24 t"].startswith(f"{style.number(medians[0, 4, 1])} (")
    assert row["8 t"] == f"{style.number(medians[0, 0, 1])} ({style.number(medians[0, 0, 1] / medians[0, 4, 1], 2)}×)"
    assert "diverged" not in row
    single = answer.table(one_design(estimators=("EKF",), levels=(24.0,)).main)
    assert list(single.header) == ["target", "estimator", "24 t"]
    assert single.caption == "Median RMSE as believed with its 95 % interval."


def _medians(design) -> np.ndarray:
    return np.nanmedian(design.errors.reshape(*design.errors.shape[:3], -1), axis=-1)


def test_the_answer_says_where_the_error_of_each_target_grows_most(one_design):
    design = one_design().main.design
    design.errors[:, :, 1] = design.errors[:, :, 0]
    design.errors[1, 6] = design.errors[1, 0] * 2  # the articulation angle is worst at 32 t
    medians = _medians(design)
    text = _answer(design)
    assert text.startswith("EKF and UKF are alike within 3 %, with an error of ")
    for k, band in enumerate((0, 6)):
        grown = f"{style.number(medians[k, 4, 0])} to {style.with_unit(medians[k, band, 0], design.targets[k].unit)}"
        assert f"grows from {grown} ({style.number(medians[k, band, 0] / medians[k, 4, 0], 2)} times)" in text
    assert "With the trailer mass at 8 t instead of the believed 24 t, the" in text
    assert "; with the trailer mass at 32 t that of the articulation angle" in text


def test_the_best_estimator_has_the_smallest_area_and_its_losses_are_said(one_design):
    design = one_design(estimators=("EKF", "UKF", "PF"), status=_lose_two).main.design
    design.errors[:, :, 2] = design.errors[:, :, 0] * 0.5
    design.errors[:, 0, 2, 0, 0, 0] = np.inf
    design.status[0, 2, 0, 0, 0] = ESTIMATOR_DIVERGED
    text = _answer(design)
    assert text.startswith("PF (diverged in 1 of 42 runs) is the best of 3, with an error of ")
    levels = np.array([8.0, 12.0, 16.0, 20.0, 24.0, 28.0, 32.0])
    medians = np.median(design.errors[0, :, 2].reshape(7, -1), axis=1)
    area = np.trapezoid(medians, levels) / 24.0
    assert f"error of {style.with_unit(area, 'kN')} ({style.with_unit(medians.max(), 'kN')} at the worst level)" in text
    assert text.endswith("Of 42 runs, UKF diverged in 2 and PF diverged in 1.")


def test_a_diverged_run_counts_as_larger_than_any_other(one_design):
    design = one_design(status=_lose_on_the_first_drive).main.design
    findings = Findings(design, 0)
    rest = np.sort(design.errors[0, 0, 0, 1].ravel())
    assert findings.summaries[0][0][0].n == 6
    assert findings.summaries[0][0][0].maximum == np.inf
    assert findings.summaries[0][0][0].minimum == rest[0]
    assert findings.medians[0, 0, 0] == np.inf  # three of six: half of the way to an infinite one
    assert findings.compared(0, 0, 1, 0).result.n == 6


def test_limits_decide_which_is_best_and_how_harmful_a_design_is(one_design):
    design = one_design().main.design
    design.errors[0, :, 0], design.errors[0, :, 1] = 1.0, 0.5
    design.errors[0, :, 1, 0] = 30.0  # smaller in the median, but one drive of two beyond the limit
    text = _answer(design, {"lateral_force_axle_21": 2000.0})
    assert text.startswith("EKF is the best of 2, with an error of 1.00 kN in the lateral force axle 21")
    assert "within 2.00 kN in 100 % of the runs" in text
    assert "within 2.00 kN in 50 % of the runs" in text


def test_designs_are_in_the_order_of_their_harm(tmp_path):
    mild, harsh = (synthetic.design(levels=(8.0, 24.0), repeats=3, drives=synthetic.DRIVES[:2]) for _ in "ab")
    folder = synthetic.write(tmp_path, {"mild": mild, "harsh": harsh})
    store = read(folder)
    for design, factor in zip(store.designs, (1.5, 40.0), strict=True):
        design.errors[:, 0] = design.errors[:, 1] * factor
    text = answer_in_short(Analysis(store))
    assert text.index("(40 times)") < text.index("(1.5 times)")
    assert " over both designs, with an error of " in text


def test_runs_out_of_control_count_for_no_estimator(one_design):
    def spin(fates: np.ndarray) -> None:
        fates[0, 0, 0, :, :] = PLANT_DIVERGED
        fates[0, 0, 1, :, :] = PLANT_DIVERGED
        fates[1, 0, 0, 0, :] = PLANT_DIVERGED

    analysis = one_design(status=spin)
    design = analysis.main.design
    assert [design.compared(b) for b in range(3)] == [0, 5, 6]
    assert [s.n for s in analysis.main.summaries[0][1]] == [5, 5]
    assert boxes.tick_labels(design)[1] == "12 t\nn 5\nout 1"
    text = answer_in_short(analysis)
    assert "the vehicle goes out of control in 6 of 6 runs at 8 t and 1 of 6 runs at 12 t" in text
    assert text.endswith(
        "In 7 of 42 runs the vehicle itself goes out of control; these are left out for every estimator."
    )


def _lose_two(fates: np.ndarray) -> None:
    fates[3, 0, 0, :2, 1] = 1


def test_answers_of_other_studies(one_design):
    one = answer_in_short(one_design(estimators=("EKF",), levels=(24.0,)))
    assert re.fullmatch(
        r"With the trailer mass at 24 t the median error of the \D+21 stays at [\d.]+ kN and that .* at [\d.]+°\.", one
    )
    steady = one_design(levels=(8.0, 24.0)).main.design
    steady.errors[:] = 1.0
    assert "stays at 1.00 kN with EKF and UKF" in _answer(steady)
    unmatched = answer_in_short(one_design(levels=(8.0, 12.0), estimators=("EKF",)))
    assert unmatched.startswith("With the trailer mass at 8 t the median error of the lateral force axle 21 is ")
    assert answer_in_short(one_design(status=everything)).startswith("No run has a score. In 42 of 42 runs the vehicle")


NINE = ("KF", "EKF", "UKF", "CDKF", "ST-CDKF", "PF", "NARX", "EKF, tuned", "PF, tuned")
SEVEN = ("KF", "EKF", "UKF", "CDKF", "ST-CDKF", "PF", "NARX")


def _lose_on_the_first_drive(fates: np.ndarray) -> None:
    fates[:, :, 0, :, 0] = 1


def test_many_estimators_are_compared_with_the_best(one_design):
    """KF is best on the runs it survives, half of all: that makes it neither the reference nor the best."""
    design = one_design(estimators=SEVEN, repeats=20, status=_lose_on_the_first_drive).main.design
    for e, factor in enumerate((0.5, 1.0, 0.999, 1.001, 1.002, 1.5, 2.0)):
        design.errors[:, :, e] = np.where(design.status[:, e] == 0, design.errors[:, :, 1] * factor, np.inf)
    findings = Findings(design, 0)
    assert design.estimators[findings.reference] == "UKF"
    assert findings.pairs == [(2, e) for e in (0, 1, 3, 4, 5, 6)]
    rows = {name: _row(findings, name) for name in SEVEN}
    shown = {name: row["same run, all levels"] for name, row in rows.items()}
    assert shown == {
        "KF": "∞ (20/40) n.s.",  # better in half of its runs, lost in the others
        "EKF": "1.00 (0/40)",
        "UKF": "reference",
        "CDKF": "1.00 (0/40)",
        "ST-CDKF": "1.00 (0/40)",
        "PF": "1.50 (0/40)",
        "NARX": "2.00 (0/40)",
    }
    assert rows["KF"]["diverged"] == str(int((design.status[:, 0] != 0).sum())) != "0"
    assert rows["PF"]["diverged"] == "0"


def test_diverged_runs_name_the_drive_they_share(one_design):
    assert "EKF in 21, all on winding-road." in _words(one_design(status=_lose_on_the_first_drive))


def test_a_belief_in_another_model_is_told(one_design):
    analysis = one_design()
    assert "believe" not in answer._scope(analysis)
    analysis.store.attributes["description"]["belief"]["model"] = "car_3dof"
    scope = next(b.markup for b in answer.blocks(analysis)[1:] if isinstance(b, Prose))
    assert "The plant is semitrailer+magic_formula, the estimators believe car_3dof: the models differ" in scope


@pytest.mark.parametrize(("of", "says"), [("plant", "as believed"), ("belief", "as stated"), ("both", "as stated")])
def test_the_matched_level_is_called_what_it_is(one_design, of, says):
    design = one_design().main.design
    factor = design.factors[0]
    object.__setattr__(factor, "of", of)
    assert answer.table(Findings(design, 0)).caption.startswith(f"Median RMSE {says} (24 t) with its 95 % interval")


def test_a_few_runs_behind_a_large_nees_are_counted(one_design):
    design = one_design(repeats=20).main.design
    design.data["nees"][:] = design.state_dimension
    design.data["nees"][4, 0, 0, 3, 0] = 1e6 * design.state_dimension
    text = answer._as_stated(Findings(design, 0), 4)
    assert "larger than the covariance states (EKF 25000 through 1 of 40 runs)" in text
    assert "as large as the covariance states (UKF 1.00)" in text
