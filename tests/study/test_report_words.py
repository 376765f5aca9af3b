"""What the report says in words: the opening sentence and the answer's paragraphs."""

from __future__ import annotations

import re

import numpy as np
import pytest

from harness.reporting import style
from harness.reporting.document import Bullets, Prose
from harness.study.report.analysis import Analysis, Findings
from harness.study.report.opening import answer_in_short
from harness.study.report.sections import answer, in_numbers
from support.report_parts import everything


def _words(analysis: Analysis) -> str:
    """Everything that the answer says in its bullets."""
    return " ".join(item for block in answer.blocks(analysis) if isinstance(block, Bullets) for item in block.items)


def test_words_when_nothing_is_left(one_design):
    lost = one_design(status=everything)
    text = _words(lost)
    assert "plant left its range in 84 (EKF 42, UKF 42)" in text


def _row(findings: Findings, estimator: str) -> dict[str, str]:
    """The cells of an estimator's first row in the table of the answer, by header."""
    sheet = in_numbers.table(findings)
    cells = next(row for row in sheet.rows if row[1] == estimator)
    return dict(zip(sheet.header, cells, strict=True))


def test_no_difference_is_called_none(one_design):
    analysis = one_design()
    design = analysis.main.design
    design.rmse[:, :, 1] = design.rmse[:, :, 0]
    row = _row(Findings(design, 0), "UKF")
    assert row["same run, all levels"] == "not shown"
    assert _row(Findings(design, 0), "EKF")["same run, all levels"] == "compared with"


def test_a_difference_that_is_shown_may_still_be_negligible(one_design):
    """Half a per mille on every run is significant and of no use to anybody."""
    design = one_design(repeats=20).main.design
    design.rmse[:, :, 1] = design.rmse[:, :, 0] * 0.9995
    findings = Findings(design, 0)
    pair = findings.compared(0, 0, 1, None)
    assert pair.shown
    assert pair.negligible
    assert pair.relative == pytest.approx(-0.0005, rel=0.05)
    assert _row(findings, "UKF")["same run, all levels"] == "within 1 %"
    design.rmse[:, :, 1] = design.rmse[:, :, 0] * 0.9
    assert _row(Findings(design, 0), "UKF")["same run, 24 t"] == "−10 %"


def test_the_table_of_the_answer_has_the_medians_and_their_growth(one_design):
    design = one_design().main.design
    medians = _medians(design)
    row = _row(Findings(design, 0), "UKF")
    assert row["24 t"].startswith(f"{style.number(medians[0, 4, 1])} (")
    assert row["8 t"] == f"{style.number(medians[0, 0, 1])} ({style.number(medians[0, 0, 1] / medians[0, 4, 1], 2)}×)"
    assert "lost" not in row
    single = in_numbers.table(one_design(estimators=("EKF",), levels=(24.0,)).main)
    assert list(single.header) == ["target", "estimator", "24 t"]
    assert single.caption == "Median RMSE as believed with its 95 % interval."


def _medians(design) -> np.ndarray:
    return np.nanmedian(design.rmse.reshape(*design.rmse.shape[:3], -1), axis=-1)


def test_headline_tells_the_largest_growth_of_each_target(one_design):
    design = one_design().main.design
    design.rmse[:, :, 1] = design.rmse[:, :, 0]
    design.rmse[1, 6] = design.rmse[1, 0] * 2  # the articulation angle is worst at 32 t
    medians = _medians(design)
    text = answer_in_short(Findings(design, 0))
    force = f"{style.number(medians[0, 4, 0])} to {style.number(medians[0, 0, 0])} kN"
    angle = f"{style.number(medians[1, 4, 0])} to {style.number(medians[1, 6, 0])}°"
    times = [
        f"({style.number(a / b, 2)} times)" for a, b in zip(medians[[0, 1], [0, 6], 0], medians[:, 4, 0], strict=True)
    ]
    assert text == (
        "With the trailer mass at 8 t instead of the believed 24 t, the median error of the lateral force axle 21 "
        f"grows from {force} {times[0]}; with the trailer mass at 32 t that of the articulation angle grows from "
        f"{angle} {times[1]}; EKF and UKF differ by less than 0.1 %."
    )


def test_headline_names_the_best_estimator_where_they_differ_and_what_was_lost(one_design):
    design = one_design(estimators=("EKF", "UKF", "PF"), status=_lose_two).main.design
    design.rmse[:, :, 2] = design.rmse[:, :, 0] * 0.5
    text = answer_in_short(Findings(design, 0))
    medians = _medians(design)
    best = f"{style.number(medians[0, 4, 2])} to {style.number(medians[0, 0, 2])} kN"
    assert f"grows from {best} ({medians[0, 0, 2] / medians[0, 4, 2]:.1f} times) with PF and to " in text
    assert f"{style.number(medians[0, 0, 0])} kN with EKF" in text
    assert "with UKF" not in text  # its median is that of the runs it survived; it is counted instead
    assert "differ by less" not in text
    assert text.endswith(
        "Of 126 runs, in 2 the estimator diverged (UKF 2). Not compared, as more of its runs were lost: UKF."
    )


def test_headline_counts_the_lost_runs_of_all_designs(one_design):
    first = one_design().main.design
    other = one_design(estimators=("EKF", "PF"), levels=(8.0, 24.0), status=_lose_the_second).main.design
    text = answer_in_short(Findings(first, 0), [first, other])
    runs, lost = first.status.size + other.status.size, other.status.size // 2
    assert text.endswith(f"Of {runs} runs of all 2 designs, in {lost} the estimator diverged (PF {lost}).")


def test_headline_names_those_that_it_leaves_out(one_design):
    def lose(fates: np.ndarray) -> None:
        fates[:, 0, :, :, 2:] = 1

    text = answer_in_short(one_design(estimators=("EKF", "UKF", "KF", "PF"), status=lose).main)
    assert text.endswith("Not compared, as more of their runs were lost: KF and PF.")


def test_headline_names_the_estimator_that_alone_can_be_compared(one_design):
    text = answer_in_short(one_design(status=_lose_the_second).main)
    assert text.count(" with EKF") == 2  # once for each target


def _lose_the_second(fates: np.ndarray) -> None:
    fates[..., 1] = 1


def _lose_two(fates: np.ndarray) -> None:
    fates[3, 0, 0, :2, 1] = 1


def test_headline_of_other_studies(one_design):
    one = answer_in_short(one_design(estimators=("EKF",), levels=(24.0,)).main)
    assert re.fullmatch(
        r"With the trailer mass at 24 t the median error of the \D+21 is [\d.]+ kN and that .* is [\d.]+°\.", one
    )
    steady = one_design(levels=(8.0, 24.0)).main.design
    steady.rmse[:] = 1.0
    assert "stays at 1.00 kN" in answer_in_short(Findings(steady, 0))
    unmatched = answer_in_short(one_design(levels=(8.0, 12.0)).main)
    assert unmatched.startswith("With the trailer mass at 8 t instead of 12 t, the median error")
    assert answer_in_short(one_design(status=everything).main).startswith(
        "No run has a score. Of 84 runs, in 84 the plant"
    )


SEVEN = ("KF", "EKF", "UKF", "CDKF", "ST-CDKF", "PF", "NARX")


def _lose_on_the_first_drive(fates: np.ndarray) -> None:
    fates[:, :, 0, :, 0] = 1


def test_many_estimators_are_compared_with_the_best(one_design):
    """KF is best on the runs it survives: that makes it neither the reference nor the best."""
    design = one_design(estimators=SEVEN, repeats=20, status=_lose_on_the_first_drive).main.design
    for e, factor in enumerate((0.5, 1.0, 0.999, 1.001, 1.002, 1.5, 2.0)):
        design.rmse[:, :, e] = np.where(design.status[:, e] == 0, design.rmse[:, :, 1] * factor, np.nan)
    findings = Findings(design, 0)
    assert design.estimators[findings.reference] == "UKF"
    assert findings.pairs == [(2, e) for e in (0, 1, 3, 4, 5, 6)]
    rows = {name: _row(findings, name) for name in SEVEN}
    shown = {name: row["same run, all levels"] for name, row in rows.items()}
    assert shown == {
        "KF": "−50 %",
        "EKF": "within 1 %",
        "UKF": "compared with",
        "CDKF": "within 1 %",
        "ST-CDKF": "within 1 %",
        "PF": "+50 %",
        "NARX": "+100 %",
    }
    assert rows["KF"]["lost"] == str(int((design.status[:, 0] != 0).sum())) != "0"
    assert rows["PF"]["lost"] == "0"


def test_lost_runs_name_the_drive_they_share(one_design):
    text = _words(one_design(status=_lose_on_the_first_drive))
    assert "estimator diverged in 21 (EKF 21, all on winding-road)" in text


def test_a_belief_in_another_model_is_told(one_design):
    analysis = one_design()
    assert "believe" not in answer._scope(analysis)
    analysis.store.attributes["description"]["belief"]["model"] = "car_3dof"
    scope = next(b.markup for b in answer.blocks(analysis)[2:] if isinstance(b, Prose))
    assert "The plant is semitrailer+magic_formula, the estimators believe car_3dof: they are wrong" in scope


@pytest.mark.parametrize(("of", "says"), [("plant", "as believed"), ("belief", "as stated"), ("both", "as stated")])
def test_the_matched_level_is_called_what_it_is(one_design, of, says):
    design = one_design().main.design
    factor = design.factors[0]
    object.__setattr__(factor, "of", of)
    assert in_numbers.table(Findings(design, 0)).caption.startswith(f"Median RMSE {says} (24 t) with its 95 % interval")


def test_a_few_runs_behind_a_large_nees_are_counted(one_design):
    design = one_design(repeats=20).main.design
    design.data["nees"][:] = design.state_dimension
    design.data["nees"][4, 0, 0, 3, 0] = 1e6 * design.state_dimension
    text = answer._as_stated(Findings(design, 0), 4)
    assert "larger than stated (EKF 25000 through 1 of 40 runs)" in text
    assert "as large as stated (UKF 1.00)" in text
