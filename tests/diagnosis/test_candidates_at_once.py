"""Candidates that are fitted and judged at once: in the same bits whatever the number of threads, and no further than
they lead."""

import math
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from harness.common.cache import LastUsed
from harness.diagnosis.criteria import BIC_NEEDED, HOPEFUL
from harness.diagnosis.fitting import FittedHypothesis, Fitting
from harness.diagnosis.model.hypotheses import hypotheses
from harness.diagnosis.selection.candidate_fits import CandidateFits
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.score_test import ScoreTest
from harness.diagnosis.selection.selection_round import SelectionRound
from harness.diagnosis.selection.validation import HeldOut
from harness.identification.filtered_model import REMEMBERED
from harness.identification.fisher_scoring import Maximum
from support.driven_car import FREE, driven

NAMES = ("steering_offset", "sensor_bias@yaw_rate", "steering_lag")


@pytest.fixture(scope="module")
def drives(augmented):
    return [augmented.drive(driven(i, ["steering_offset"], 25.0, steering_offset=1e-3), f"drive {i}") for i in (60, 61)]


def fitted(augmented, drives, jobs, monkeypatch):
    """Return what a round makes of three hypotheses, with a number of threads, and nothing remembered."""
    monkeypatch.setattr(augmented, "jobs", jobs)
    monkeypatch.setattr(augmented, "_remembered", LastUsed(REMEMBERED))
    variances = first_variances(augmented, drives)
    fitting = Fitting(augmented, drives[:1], variances, driven=drives)
    fits = CandidateFits(fitting, HeldOut(augmented, drives[1:], variances), FREE, lambda _: None)
    nominal = fits.fit((), fitting.first(), 3, 1)
    chosen = [h for h in hypotheses(augmented, FREE) if h.name in NAMES]
    assert len(chosen) == len(NAMES)
    scores = ScoreTest(fitting, nominal).of(chosen)
    found = SelectionRound(fits, (), [nominal], 1)
    found.fit(scores)
    judged = [found.judged(s) for s in scores]
    points = [found.fits[h].point for h in chosen]
    bits = [(p.values.tobytes(), p.process.tobytes(), p.measurement.tobytes()) for p in points]
    return bits, [(c.bic, c.held_out.log_likelihood, c.held_out.normalised_excess_mse) for c in judged]


def test_candidates_end_in_the_same_bits_whatever_the_number_of_threads(augmented, drives, monkeypatch):
    alone = fitted(augmented, drives, 1, monkeypatch)
    assert max(bic for bic, *_ in alone[1]) > 100  # the one that is there
    for jobs in (2, 5):
        assert fitted(augmented, drives, jobs, monkeypatch) == alone


@pytest.mark.parametrize("stuck", [True, False])
def test_a_fit_that_no_step_leads_on_from_has_ended(augmented, drives, monkeypatch, stuck):
    """Its slopes promise what it does not reach, and so they would in another turn."""
    promising = partial(Maximum, value=0.0, information=np.empty((0, 0)), predicted=100.0, stuck=stuck)
    monkeypatch.setattr("harness.diagnosis.fitting.maximise", lambda objective, z, *_, **__: promising(z))
    fitting = Fitting(augmented, drives[:1], first_variances(augmented, drives), driven=drives)
    assert fitting.fit((), fitting.first(), 3, 1, afresh=False).ended is stuck


@pytest.mark.parametrize(
    ("behind", "ended", "fitted_on"),
    [(0.0, False, True), (0.0, True, False), (0.9 * BIC_NEEDED, False, True), (1.1 * BIC_NEEDED, False, False)],
)
def test_what_is_far_behind_or_has_ended_is_not_fitted_on(monkeypatch, behind, ended, fitted_on):
    asked = []

    def fit(self, added, start, turns=3, afresh=True, least=0.0):
        asked.append((added, start, turns, afresh))
        return FittedHypothesis((), "end", 0.0, -behind if added == ("one",) else 0.0, added != ("one",) or ended)

    monkeypatch.setattr(CandidateFits, "fit", fit)
    fits = CandidateFits.__new__(CandidateFits)
    fits.augmented, fits.doubt = SimpleNamespace(share=lambda do, what: [do(x) for x in what]), 0.5 * HOPEFUL
    fits.fit_all([(("one",), lambda: "start"), (("best",), lambda: "start")])
    assert asked[:2] == [(("one",), "start", 1, True), (("best",), "start", 1, True)]
    assert asked[2:] == [(("one",), "end", 3, False)] * fitted_on


@pytest.mark.parametrize(("base", "promise"), [(-1e4, -500.0), (2000.0, 2500.0), (2900.0, 2750.0), (math.inf, 2750.0)])
def test_the_first_sets_what_the_others_must_promise_and_the_best_what_is_fitted_on_must(monkeypatch, base, promise):
    """Most of the first one's gain over a base, or to be in question; what has that of the best one's is fitted on."""
    reached = {"a": 3000.0, "b": 1000.0, "c": 2000.0, "d": 2500.0, "e": 3600.0}
    doubt, asked = 0.5 * HOPEFUL, {}

    def fit(self, added, start, turns=3, afresh=True, least=0.0):
        asked[added[0], turns] = least
        return FittedHypothesis((), "end", 0.0, reached[added[0]])

    monkeypatch.setattr(CandidateFits, "fit", fit)
    fits = CandidateFits.__new__(CandidateFits)
    fits.augmented, fits.doubt = SimpleNamespace(share=lambda do, what: [do(x) for x in what]), doubt
    models = [((name,), lambda: "start") for name in reached]
    fits.fit_all(models, base=base, needed=-500.0)
    names = [*reached]
    assert [asked[name, 1] for name in names] == [-500.0] + [promise] * 4
    if base == -1e4:
        assert [asked[name, 3] for name in names] == [3600.0 - doubt] * 5


def test_the_same_fit_is_scored_once_and_again_where_more_is_asked():
    """What is out of the question by then has no score."""
    asked = []

    def score(tried):
        asked.append(list(tried))
        return [SimpleNamespace(hypothesis=h) for h in tried]

    fits = CandidateFits.__new__(CandidateFits)
    fits._scores = {}
    one, other = object(), object()
    found = [
        fits.scores_at(point, tried, score) for point, tried in ((one, "ab"), (one, "b"), (other, "b"), (one, "bc"))
    ]
    assert asked == [["a", "b"], ["b"], ["b", "c"]]
    assert [[s.hypothesis for s in scores] for scores in found] == [["a", "b"], ["b"], ["b"], ["b", "c"]]
