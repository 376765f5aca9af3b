"""Filters and simulation of the joint study written for JAX: this project's numbers, whichever way they are written."""

import dataclasses

import numpy as np
import pytest

from bench.engine import ROOT
from harness.config import load_study
from harness.engine.standard_normal import standard_normal
from harness.study.compiled_study import in_a_row
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


FILTERS = [form for form in card_jax.FORMS if form.kind != card_jax.SIMULATION]
SIMULATIONS = [form for form in card_jax.FORMS if form.kind == card_jax.SIMULATION]


@pytest.mark.parametrize("form", FILTERS, ids=lambda form: f"{form.kind}, {form.name}")
def test_each_form_gives_the_scores_of_this_project(given, form):
    found = given.filter(form)(given.seen, given.told(form.kind, RUNS))
    wanted = given.wanted(form.kind)
    for name, values in wanted._asdict().items():
        assert np.ptp(values) > 0  # runs differ
        np.testing.assert_allclose(np.asarray(getattr(found, name)), values, rtol=1e-10, err_msg=name)


@pytest.mark.parametrize("form", SIMULATIONS, ids=lambda form: form.name)
def test_each_form_simulates_what_this_project_does(given, form):
    evaluator, plant = given.evaluator, given.evaluator.compiled.plant
    words = evaluator.noise.words(given.unit, evaluator.cases(given.unit))
    noise = in_a_row(standard_normal(words, SAMPLES, plant.nx + plant.ny), 3)
    inputs = evaluator.compiled.drives[0].plant[:SAMPLES, :, 0]
    found = given.simulation(form)(inputs, noise, given.plant(RUNS))
    for part, values in zip(found, (given.batch.truth, given.batch.measurements), strict=True):
        got = np.stack(part, axis=1) if form.entries else np.asarray(part)
        got = np.moveaxis(got, 1, 2) if form.vmapped and not form.entries else got
        wanted = in_a_row(values, 3)
        scale = np.maximum(np.abs(wanted).max(axis=(0, 2), keepdims=True), 1e-300)
        np.testing.assert_allclose(got / scale, wanted / scale, atol=1e-10)


def test_the_table_sets_the_best_form_beside_this_project(given, monkeypatch):
    rates = iter([3e6, 5e6, 4e6, 2e6])  # of two forms, each with two numbers of runs
    monkeypatch.setattr(given, "rate", lambda form, runs, rounds: (next(rates), 1.0))
    table = card_jax.table_of(given, [8, 16], 1, {"ekf": [8e6, 10e6]}, FILTERS[:2])
    assert list(table.columns[2].cells) == ["3.00", "4.00", "8.0", "2.00"]
    assert list(table.columns[3].cells) == ["5.00", "2.00", "10.0", "2.00"]


@pytest.mark.parametrize("kind", ["ekf", card_jax.SIMULATION])
def test_a_form_is_measured(given, kind):
    form = next(form for form in card_jax.FORMS if form.kind == kind)
    table = card_jax.table_of(given, [RUNS], 1, {kind: [1e6]}, [form])
    assert float(next(iter(table.columns[2].cells))) > 0
