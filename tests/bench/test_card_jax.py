"""Filters of the joint study written for JAX: the scores of this project's, whichever way they are written."""

import dataclasses

import numpy as np
import pytest

from bench.engine import ROOT
from harness.config import load_study
from harness.study.evaluate import StudyEvaluator

pytest.importorskip("jax", reason="only `make bench PEERS=1` installs JAX")

from bench import card_jax

RUNS, SAMPLES = 8, 200


@pytest.fixture(scope="module")
def given():
    study = load_study(ROOT / "studies" / "joint.toml")
    chosen = tuple(each for each in study.estimators if each.kind in ("ekf", "ukf"))
    study = dataclasses.replace(study, estimators=chosen, history=(), over_time=None)
    return card_jax.Problem(StudyEvaluator(study), 0, SAMPLES, RUNS)


@pytest.mark.parametrize("form", card_jax.FORMS, ids=lambda form: f"{form.kind}, {form.name}")
def test_each_form_gives_the_scores_of_this_project(given, form):
    found = given.filter(form)(given.seen, given.told(form.kind, RUNS))
    wanted = given.wanted(form.kind)
    for name, values in wanted._asdict().items():
        assert np.ptp(values) > 0  # runs differ
        np.testing.assert_allclose(np.asarray(getattr(found, name)), values, rtol=1e-10, err_msg=name)


def test_the_table_sets_the_best_form_beside_this_project(given):
    chosen = [form for form in card_jax.FORMS if form.kind == "ekf"][:2]
    table = card_jax.table_of(given, [RUNS], 1, {"ekf": [1e6]}, chosen)
    *rates, ours, times = table.columns[2].cells
    assert ours == "1.0"
    assert float(times) == pytest.approx(1 / max(map(float, rates)), abs=0.05 / max(map(float, rates)) + 0.01)
