"""A rare event of a population: what a study may ask, and that its probability is that of plain Monte Carlo."""

from __future__ import annotations

import json
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.special import ndtri

from harness.common.errors import UserError
from harness.config import load_study
from harness.study import rare_event, rare_file
from harness.study.design import Unit, points, scrambled_points, values_of
from harness.study.evaluate import StudyEvaluator
from harness.study.report.sections.exceedance import rare
from support.joint_study import HEAD, POPULATION

ASKED = 'design = "fleet", target = "articulation_angle", samples = 200'


@pytest.fixture
def study_of(tmp_path):
    def _study(asked=f'{ASKED}, limit = "1 deg"', limits=""):
        (tmp_path / "rare.toml").write_text(f"{limits}{HEAD}{POPULATION}\n[report]\nrare_event = {{ {asked} }}\n")
        return load_study(tmp_path / "rare.toml")

    return _study


def test_the_event_is_resolved(study_of):
    spec = study_of().rare_event
    assert (spec.design, spec.target, spec.samples) == ("fleet", "articulation_angle", 200)
    assert spec.limit == pytest.approx(np.deg2rad(1.0))
    assert spec.estimator == study_of().estimators[0].name
    assert study_of(ASKED, 'limits = { articulation_angle = "2 deg" }\n').rare_event.limit == pytest.approx(
        np.deg2rad(2)
    )
    assert study_of().hash == study_of(f'{ASKED}, limit = "2 deg"').hash


REFUSED = {
    ASKED: "limit: give a positive limit, as 'limits' has none of articulation_angle",
    f'{ASKED}, limit = "-1 deg"': "limit: give a positive limit",
    f'{ASKED}, limit = "1 m"': "report.rare_event.limit",
    f'{ASKED}, limit = "1 deg", estimator = "E"': "estimator: 'E' is no estimator of the study",
    'design = "flet", target = "articulation_angle"': "design: 'flet' is no design with sampling = 'population'; "
    "closest: fleet",
    'design = "fleet", target = "yaw_rate_tractor", limit = 1': "target: 'yaw_rate_tractor' is no target of the study",
}


@pytest.mark.parametrize("asked", REFUSED)
def test_what_is_no_event_is_refused_in_a_line(study_of, asked):
    with pytest.raises(UserError) as refused:
        study_of(asked)
    assert REFUSED[asked] in str(refused.value)
    assert "\n" not in str(refused.value)


def test_values_at_normal_numbers_are_the_points_of_the_population(study_of):
    study = study_of()
    design = study.designs[0]
    table = points(study, design)
    normal = ndtri(scrambled_points(design.base_samples, 4, (study.seed, 0)))
    np.testing.assert_allclose(values_of(design, normal), table.values[0, : design.base_samples], rtol=1e-9)


def test_the_probability_is_that_of_plain_monte_carlo(study_of, tmp_path):
    study = study_of()
    evaluator = StudyEvaluator(study)
    values = points(study, study.designs[0]).values[0]
    errors = rare_event.largest_errors(evaluator, study.rare_event, values, 2)
    first = [evaluator.evaluate(Unit(0, 0, drive, 0, 1))["max_error"][0, 0, 0] for drive in range(len(study.drives))]
    assert errors[0] == np.max([row[study.targets.index("articulation_angle")] for row in first])  # the same noise
    limit = float(np.quantile(errors, 0.97))
    asked = study_of(f"{ASKED}, limit = {limit!r}")
    evaluator = StudyEvaluator(asked)
    rare_event.write(evaluator, tmp_path, 2)
    kept = rare_file.read(tmp_path, asked.hash)
    assert kept["probability"] == pytest.approx(0.03, abs=3 * kept["variation"] * 0.03 + 0.02)
    assert kept["evaluations"] <= 2 * 200
    assert rare_file.read(tmp_path, "another study") == {}
    (tmp_path / rare_file.FILE).write_text(json.dumps(kept | {"probability": 0.5}))
    rare_event.write(evaluator, tmp_path, 2)  # it is there already
    assert rare_file.read(tmp_path, asked.hash)["probability"] == 0.5
    rare_event.write(StudyEvaluator(study_of(f"{ASKED}, limit = {0.9 * limit!r}")), tmp_path, 2)
    assert 0.03 < rare_file.read(tmp_path, asked.hash)["probability"] != 0.5


def test_a_limit_that_is_not_reached_costs_no_study(study_of, tmp_path, monkeypatch):
    """The errors have a largest value, so no level gets to the limit; the scores are done, and the report says it."""
    study = study_of(f'{ASKED}, limit = "100 deg"')
    monkeypatch.setattr(rare_event, "largest_errors", lambda _, __, values, ___: 1.0 / (1.0 + np.abs(values[:, 0])))
    rare_event.write(StudyEvaluator(study), tmp_path, 2)
    kept = rare_file.read(tmp_path, study.hash)
    assert "probability" not in kept
    assert "the limit 1.74533 is not reached" in kept["not_reached"]
    design = SimpleNamespace(name="fleet", targets=[SimpleNamespace(name="articulation_angle", scale=180 / np.pi,
                             words="articulation angle", unit="°")])  # fmt: skip
    (sentence,) = rare(SimpleNamespace(store=SimpleNamespace(rare_event=kept)), design)
    assert "exceeds 100° with " in sentence
    assert "is not known" in sentence
