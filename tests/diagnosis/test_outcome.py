"""What follows the search of a trace: the verdict is written, whatever fails thereafter."""

import dataclasses
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest

from harness.common.failures import FILE, Failures
from harness.common.files import json_text
from harness.common.statistics import Interval
from harness.config import load_study
from harness.diagnosis import run
from harness.diagnosis.criteria import HORIZONS, PRIORS
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis, coordinates, hypotheses
from harness.diagnosis.report import probabilities, residual_sections
from harness.diagnosis.report.probabilities import likely
from harness.diagnosis.report.report import report
from harness.diagnosis.report.residual_figures import correlations, picture
from harness.diagnosis.report.summary import _rounds
from harness.diagnosis.residuals.dependence import Regressor
from harness.diagnosis.residuals.disturbance_ranking import DisturbanceRanking
from harness.diagnosis.residuals.innovation_tests import consistency, cross_correlation
from harness.diagnosis.residuals.unmodelled import UnmodelledDisturbance, find_unmodelled
from harness.diagnosis.result.answer import gap
from harness.diagnosis.result.outcome import outcome_of
from harness.diagnosis.result.record import write_outcome
from harness.diagnosis.selection.acceptance import Candidate, Round
from harness.diagnosis.selection.candidate_fits import CandidateFits
from harness.diagnosis.selection.forward_selection import Trace, first_variances
from harness.diagnosis.selection.forward_selection import trace as search_for
from harness.diagnosis.selection.posterior import Alike, ComparedModel, Posterior
from harness.diagnosis.selection.score_test import Score
from harness.diagnosis.selection.validation import HeldOut, Judgement, colour_left
from harness.identification.whiteness import whiteness
from harness.models.assembly.plan import Planner
from harness.models.quantities import words
from harness.models.roles import VEHICLES
from support.driven_car import FREE, driven, fitted
from support.report_parts import Page


@pytest.fixture(scope="module")
def trace(augmented):
    """A trace that found nothing in a car that turns too little in a gust."""
    values = {"crosswind_force": 400.0, "crosswind_onset": 10.0, "crosswind_end": 20.0}
    train, test = (
        augmented.drive(driven(seed, ["crosswind"], duration=25.0, **values), f"drive_$x_{{$ {seed}")
        for seed in (90, 91)
    )
    fitting, fit = fitted(augmented, [train])
    held_out = HeldOut(augmented, [test], first_variances(augmented, [train, test]))
    judged = held_out.judge((), fit.point)
    last = Round((), judged, None, "nothing promises enough to be fitted", "")
    return Trace(fitting, held_out, FREE, fit, fit, (), (last,), (), judged, judged)


def broken(*_, **__):
    raise ZeroDivisionError("no effect is left")


@pytest.fixture(scope="module")
def outcome(trace):
    return outcome_of(trace)


def reported(outcome, folder):
    """Return text of the report of a trace that was judged, and its record, both written."""
    write_outcome(outcome, folder)
    record = json.loads((folder / "trace.json").read_text())
    files = report(outcome, "harness trace").write(folder, failures=outcome.failures)
    assert files[1].stat().st_size > 10_000
    return Page(files[0].read_text(encoding="utf-8")).text, record


def test_a_trace_that_found_nothing_has_a_report(outcome, tmp_path):
    text, record = reported(dataclasses.replace(outcome, failures=Failures(tmp_path)), tmp_path)
    assert next(iter(record)) == "schema_version"
    assert record["schema_version"] == 2
    assert record["verdict"] == "unresolved"
    assert record["not_made"] == []
    fitted, stated = outcome.trace.final, outcome.trace.fitting.augmented.spec.values
    errors = outcome.trace.fitting.standard_errors(fitted)
    assert [*record["refitted"]] == [*FREE]
    for c, error in zip(fitted.coordinates, errors, strict=True):
        said = record["refitted"][c.name]
        assert (said["value"], said["std"]) == pytest.approx((fitted.point.value(c), error))
        assert (said["stated"], said["unit"]) == (stated[c.name], "N/rad")
        assert f"{words(c.name)} " in text
    assert text.count(", stated ") == len(FREE)
    open_ = [(e["name"], e["value"], e["standard_error"]) for e in record["estimates"]]
    assert [n for n, _, _ in open_] == [*FREE]
    assert [e for *_, e in open_] == pytest.approx(errors)
    assert np.diag(record["correlation"]) == pytest.approx(np.ones(len(FREE)))
    study = load_study(tmp_path / "posterior.toml")  # draws vehicles from these
    assert [f.marginal.arguments[:2] for f in study.designs[0].factors] == [(v, e) for _, v, e in open_]
    assert "# The trace is unresolved: the model lacks something" in (tmp_path / "posterior.toml").read_text()
    assert not (tmp_path / FILE).exists()
    assert "drive_$x_{$ 91" in text
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    order = ["Outputs over time of", "Top view of the vehicle", "Summary; the sections below"]
    assert [page.index(said) for said in order] == sorted(page.index(said) for said in order)


def test_the_vehicle_has_a_frame_where_an_addition_changes_the_model(outcome):
    spec = outcome.trace.fitting.augmented.spec
    plan = Planner(spec.model(), VEHICLES.load(spec.vehicle)).plan(spec.values)
    axle = next(iter(plan.axles))
    ranked = outcome.localisation.nominal.ranked_inputs
    drawn = {}
    for port in ("road_wheel_angle", f"slip_angle_axle_{axle}", ranked[0].disturbance_input.ports[0]):
        drawn[port] = picture(plan, ranked, {"an addition": [port]})
    assert len({picture(plan, ranked, {}), *drawn.values()}) == 1 + len(drawn)


LATER = {
    "harness.diagnosis.result.outcome._errors": "the standard errors",
    "harness.diagnosis.result.outcome._judged": "the tests of the innovations",
    "harness.diagnosis.residuals.localisation.find_random_process": "the search for a random process",
    "harness.diagnosis.residuals.localisation.find_unmodelled": "the search for an unmodelled disturbance",
    "harness.diagnosis.result.outcome.answer": "the answer in sentences",
    "harness.diagnosis.result.record.ranking_record": "“pinpoint” of trace.json",
}


@pytest.mark.fails_in_part
@pytest.mark.parametrize(
    "places",
    [LATER, {"harness.diagnosis.result.outcome.localised": "the search for where something is missing"}],
    ids=["each", "all"],
)
def test_what_fails_after_the_search_leaves_verdict_and_report(trace, tmp_path, monkeypatch, places):
    for place in places:
        monkeypatch.setattr(place, broken)
    text, record = reported(outcome_of(trace, failures=Failures(tmp_path)), tmp_path)
    assert record["verdict"] == "unresolved"
    why = f"could not be made: ZeroDivisionError: no effect is left; the traceback is in {tmp_path / FILE}."
    assert record["not_made"] == [f"{part} {why}" for part in places.values()]
    assert all(sentence in text for sentence in record["not_made"])
    assert (tmp_path / FILE).read_text().count("Traceback") == len(places)


SECTIONS = {
    "harness.diagnosis.report.summary._rounds": "How did the search go?",
    "harness.diagnosis.report.residual_sections.planner": "Where on the vehicle?",
    "harness.diagnosis.report.report.fit_figures.periodograms": "The figure “Cumulative share of power",
    "harness.diagnosis.report.residual_sections.consistency": "What do the innovations depend on?",
    "harness.diagnosis.report.report.fit_figures.over_time": "The figure “Outputs over time",
}


@pytest.mark.fails_in_part
def test_what_fails_in_the_report_leaves_the_rest_of_it(outcome, tmp_path, monkeypatch):
    for place in SECTIONS:
        monkeypatch.setattr(place, broken)
    text, record = reported(dataclasses.replace(outcome, failures=Failures(tmp_path)), tmp_path)
    assert record["verdict"] == "unresolved"
    assert all(said in text for said in SECTIONS.values())
    assert text.count("could not be made: ZeroDivisionError") == len(SECTIONS)
    assert "How was it made?" in text


@pytest.mark.fails_in_part
def test_an_estimator_that_fails_leaves_the_others(outcome, tmp_path, monkeypatch):
    outcome = dataclasses.replace(outcome, failures=Failures(tmp_path))
    monkeypatch.setattr(run, "estimators_on", lambda *a: broken() if a[3] == ("ukf",) else a[3])
    task = SimpleNamespace(test=[])
    assert [run._estimated(task, outcome, kind, print) for kind in ("ekf", "ukf")] == [("ekf",), ()]
    assert outcome.failures.sentences[0].startswith("the estimates of ukf could not be made")


def test_where_the_filter_leaves_the_range_no_curve_is_sought(trace):
    """Its states are NaN from there, which no spline has a value for."""
    ranking = DisturbanceRanking(trace.fitting, trace.final.point)
    lost = dataclasses.replace(trace.after.point, values=np.full_like(trace.after.point.values, np.nan))
    before = dataclasses.replace(trace.after, point=lost)
    assert find_unmodelled(trace.fitting, trace.held_out, trace.final, before, ranking) is None


def test_what_was_dropped_and_left_no_stand_in_is_told():
    kept = Hypothesis("steering_lag", "effect", ("steering_lag",))
    dropped = Hypothesis("roll_steer", "effect", ("front", "rear"))

    def told(*added, of_rounds=(dropped, kept), gone=(dropped,)):
        rounds = [SimpleNamespace(added=SimpleNamespace(hypothesis=h), reason="passes") for h in of_rounds]
        trace = SimpleNamespace(rounds=rounds, dropped=gone, added=added)
        return _rounds(SimpleNamespace(trace=trace, refused=None))[-1]

    assert told(kept) == told() == "Without roll steer the rest is likelier."
    mass = Hypothesis("mass", "parameter", ("mass",))
    assert told(kept, mass) == "In place of roll steer stands what is likelier: mass."
    rear = Hypothesis("roll_steer@rear", "effect", ("rear",))
    assert told(kept, rear) == "In place of roll steer stands what is likelier: roll steer, rear."
    lag = Hypothesis("tyre_lag", "effect", ("lag_front", "lag_rear"))
    places = [Hypothesis(f"tyre_lag@{n}", "effect", (f"lag_{n}",)) for n in ("front", "rear")]
    assert told(lag, of_rounds=(dropped, *places)) == "Without roll steer the rest is likelier."
    both = Hypothesis("values", "parameter", ("mass", "inertia"))
    assert told(kept, both, of_rounds=(kept, mass), gone=()) == "In place of mass stands what is likelier: values."


def test_additions_that_are_worse_than_none_are_refused_and_told(trace, tmp_path):
    """The nominal model stays as the final one, and an amended model of an earlier trace does not."""
    augmented, fit = trace.fitting.augmented, trace.nominal
    lag = next(h for h in hypotheses(augmented, FREE) if h.name == "steering_lag")
    values = fit.point.values.copy()
    values[[augmented.row(n) for n in lag.amplitudes]] = 0.4
    late = dataclasses.replace(
        fit, coordinates=coordinates(augmented, FREE, (lag,), 1), point=dataclasses.replace(fit.point, values=values)
    )
    zero, alone = np.zeros(len(HORIZONS)), Interval(0.0, 0.0, 0.0)
    models = (
        ComparedModel((Alike((lag,), (1.0,)),), late, 0.0, zero, alone, 1.0, 0.99),
        ComparedModel((), fit, 0.0, zero, alone, 0.0, 0.0),
    )
    judged = trace.held_out.judge((lag,), late.point)
    worse = dataclasses.replace(trace, final=late, added=(lag,), after=judged, posterior=Posterior(models, 0.01, zero))
    (tmp_path / "amended.toml").write_text("of an earlier trace")
    outcome = outcome_of(worse, failures=Failures(tmp_path))
    text, record = reported(outcome, tmp_path)
    assert (record["verdict"], record["added"], outcome.trace.final) == ("unresolved", [], fit)
    assert [a["effect"] for a in record["refused"]["added"]] == ["steering_lag"]
    assert record["refused"]["error_ratio"]["lower"] > 1.0
    assert record["posterior"]["none_of_these"] == 1.0
    assert record["error"]["yaw_rate"]["after"] <= record["error"]["yaw_rate"]["before"]
    assert sorted(f.name for f in tmp_path.glob("*.toml")) == ["nominal.toml"]
    grown = record["refused"]["error"]["yaw_rate"]
    assert grown["after"] > grown["before"]
    assert "steering lag" in record["answer"]
    assert record["answer"] in text
    assert record["not_made"] == []


def test_a_trace_whose_only_addition_was_dropped_has_a_report(trace, tmp_path):
    """Something was dropped, and nothing took its place or is left."""
    lag = Hypothesis("steering_lag", "effect", ("steering_lag",))
    score = Score(lag, 60.0, np.ones(1), np.ones(1), 1.0, np.zeros(0), np.zeros((1, 0)), (), True)
    added = Candidate(score, trace.final, 110.0, trace.after)
    first = Round((added,), trace.before, added, "meets all three criteria", lag.name)
    dropped = dataclasses.replace(trace, rounds=(first, *trace.rounds), dropped=(lag,))
    text, record = reported(outcome_of(dropped, failures=Failures(tmp_path)), tmp_path)
    assert record["not_made"] == []
    assert "Without steering lag the rest is likelier." in text


def test_a_value_that_gave_way_to_many_has_a_report(trace, tmp_path):
    """What a round added is a part of what took its place, so nothing was dropped."""
    mass = Hypothesis("mass", "parameter", ("mass",))
    score = Score(mass, 60.0, np.ones(1), np.ones(1), 1.0, np.zeros(0), np.zeros((1, 0)), (), True)
    added = Candidate(score, trace.final, 110.0, trace.after)
    first = Round((added,), trace.before, added, "meets all three criteria", mass.name)
    many = Hypothesis(ALL_PARAMETERS, "parameter", ("mass", "yaw_inertia"))
    wider = dataclasses.replace(trace, rounds=(first, *trace.rounds), added=(many,))
    text, record = reported(outcome_of(wider, failures=Failures(tmp_path)), tmp_path)
    assert record["not_made"] == []
    assert text.count("takes the place of mass;") == 1


def test_a_model_that_leaves_its_range_has_a_report(trace, tmp_path):
    """A car that oversteers beyond its critical speed: the filter follows it for a while, its free run does not."""
    augmented, point = trace.fitting.augmented, trace.final.point
    values = point.values.copy()
    values[augmented.row("stiffness_peak_rear")] *= 0.3
    spun = dataclasses.replace(trace.final, point=dataclasses.replace(point, values=values))
    judged = trace.held_out.judge((), spun.point)
    assert np.isnan(judged.drives[0].simulated).any()
    lost = dataclasses.replace(trace, nominal=spun, final=spun, before=judged, after=judged)
    text, record = reported(outcome_of(lost, failures=Failures(tmp_path)), tmp_path)
    assert record["not_made"] == []
    assert record["verdict"] == "unresolved"
    assert "How was it made?" in text


@pytest.mark.fails_in_part
def test_a_round_that_cannot_be_computed_ends_the_search_and_not_the_report(trace, tmp_path, monkeypatch):
    search = "harness.diagnosis.selection.forward_selection."
    monkeypatch.setattr(search + "selection_round", broken)
    monkeypatch.setattr(CandidateFits, "fit", lambda *_: trace.final)
    failures, augmented = Failures(tmp_path), trace.fitting.augmented
    found = search_for(augmented, trace.fitting.drives, trace.held_out.drives, FREE, failures=failures)
    text, record = reported(outcome_of(found, failures=failures), tmp_path)
    assert record["verdict"] == "unresolved"
    assert record["answer"].startswith("The search broke off")
    assert record["not_made"][0].startswith("round 1 of the search could not be made: ZeroDivisionError")
    assert "Round 1 added nothing: it could not be computed: ZeroDivisionError" in text


def test_an_infinite_gain_is_drawn_to_the_edge():
    hypothesis = Hypothesis("mass", "parameter", ("mass",))
    tried = tuple(SimpleNamespace(hypothesis=hypothesis, fitted=object(), bic=b) for b in (np.inf, 80.0, -np.inf))
    assert probabilities.ranking(SimpleNamespace(candidates=tried), 1).startswith(b"<?xml")
    assert probabilities.ranking(SimpleNamespace(candidates=tried[:1]), 1).startswith(b"<?xml")


def test_an_error_that_is_not_known_does_not_fall():
    judged = [Judgement(0.0, np.zeros(1), np.array([e]), (), None) for e in (np.nan, 2.0, np.inf)]
    for before, after in ((0, 1), (1, 0), (1, 2)):
        assert gap(judged[before], judged[after]) == " The simulation error on the held-out drives does not fall."


def test_a_missing_output_and_a_short_drive_are_no_obstacle():
    nothing = np.full((500, 2), np.nan)
    assert np.isnan(consistency(0.01 * np.arange(500), nothing).inside)
    short = np.random.default_rng(1).normal(size=(120, 2))  # shorter than the largest lag
    found = cross_correlation([short, short], [short, short], 0.01)
    assert np.isfinite(found.values).all()
    before, after = (SimpleNamespace(whiteness=[whiteness(series[:, 0])]) for series in (short, nothing))
    assert colour_left([before], [after]) == 0.0


def test_a_signal_that_overflows_leaves_the_figure_of_correlations_to_the_others():
    short = np.random.default_rng(1).normal(size=(120, 2))
    found = cross_correlation([short], [short * [1.0, np.nan]], 0.01)
    names = [Regressor(name, name, "1", signal=lambda *_: short[:, 0]) for name in ("known", "overflown")]
    assert b"<svg" in correlations(found, ["yaw_rate", "lateral_velocity"], names)


def test_what_is_not_finite_is_null():
    content = {"a": np.float64("nan"), "b": [np.inf, np.int64(3)], "c": (np.bool_(True), None), "d": 0.1}
    assert json.loads(json_text(content)) == {"a": None, "b": [None, 3], "c": [True, None], "d": 0.1}


def test_the_first_page_and_the_record_say_how_likely_each_explanation_is(outcome, tmp_path):
    """A lag of 48 ms with nine tenths, a gain or an arm that act the same with the rest, and something else at 0.2."""
    fitted = outcome.trace.nominal
    values = fitted.point.values.copy()
    values[outcome.trace.fitting.augmented.row("steering_lag")] = 0.048
    fitted = dataclasses.replace(fitted, point=dataclasses.replace(fitted.point, values=values))
    lag = Hypothesis("steering_lag", "effect", ("steering_lag",))
    ratio = Hypothesis("steering_ratio", "parameter", ("steering_ratio",))
    roll = Hypothesis("accelerometer_roll", "effect", ("accelerometer_roll",))

    def model(share, hypotheses, shares):
        density = np.full(len(HORIZONS), -100.0 * share)
        alike = (Alike(hypotheses, shares),) if hypotheses else ()
        return ComparedModel(alike, fitted, -4.0, density, Interval(-3.0, -9.0, 2.0), share, 0.8 * share)

    models = (model(0.86, (lag,), (1.0,)), model(0.12, (ratio, roll), (0.75, 0.25)), model(0.02, (), ()))
    posterior = Posterior(models, 0.2, np.full(len(HORIZONS), 0.94))
    said = dataclasses.replace(outcome, trace=dataclasses.replace(outcome.trace, posterior=posterior))
    text, record = reported(said, tmp_path)
    assert "7 in 10: steering lag (48.0 ms)" in text  # with "none of these" they add up to 1
    assert "1 in 10: the stated steering ratio is wrong (found 1.00)" in text
    assert "or accelerometer roll, which acts the same" in text
    assert "2 in 10: none of these; something else is there" in text
    assert "2 in 100: nothing is missing" in text  # which is what the search says
    assert "what the search added" not in text
    found = record["posterior"]
    assert found["none_of_these"] == 0.2
    assert {h["name"]: round(h["probability"], 6) for h in found["hypotheses"]} == {
        "steering_lag": 0.688,
        "steering_ratio": 0.072,
        "accelerometer_roll": 0.024,
    }
    assert list(found["models"][0]["log_predictive_density"]) == ["0", "0.1", "1", "10", "inf"]
    assert [m["probability"] for m in found["models"]] == pytest.approx([0.688, 0.096, 0.016])
    assert record["confusable"]["mass"] == pytest.approx(0.98)
    assert [len(m["added"][0]) for m in record["confusable"]["models"]] == [1, 2]
    noise, first = record["confusable"]["noise"], record["confusable"]["models"][0]
    assert noise["fitted_seconds"] == sum(d.time[-1] for d in outcome.trace.fitting.drives)
    assert len(noise["levels"]) == len(first["at_levels"]) > 1
    prior = fitted.log_likelihood - fitted.objective
    likelihood = outcome.trace.fitting.log_likelihood(
        fitted.point
    )  # with the noise of the fit, which is the first level
    assert first["at_levels"][0]["log_posterior"] == pytest.approx(likelihood - prior)
    study = load_study(tmp_path / "posterior.toml")  # which draws from both
    assert [(d.name, d.share) for d in study.designs[:-1]] == [("steering_lag", 0.86), ("steering_ratio", 0.12)]


def test_a_disturbance_without_a_name_makes_it_likelier_that_no_name_is_right(outcome, tmp_path):
    final, zero = outcome.trace.final, np.zeros(len(HORIZONS))
    lag = Alike((Hypothesis("steering_lag", "effect", ("steering_lag",)),), (1.0,))
    models = (ComparedModel((lag,), final, 0.0, zero, Interval(0.0, 0.0, 0.0), 1.0, 0.9),)
    trace = dataclasses.replace(outcome.trace, posterior=Posterior(models, 0.1, zero))
    found = UnmodelledDisturbance((), {}, 5.0, outcome.trace.after, ())
    said = dataclasses.replace(
        outcome, trace=trace, localisation=dataclasses.replace(outcome.localisation, unmodelled=found)
    )
    odds = 0.9 * PRIORS.odds["none"] * math.exp(5.0)
    text, record = reported(said, tmp_path)
    assert record["posterior"]["none_of_these"] == pytest.approx((0.1 + odds) / (1.0 + odds))
    assert record["posterior"]["hypotheses"][0]["probability"] == pytest.approx(0.9 / (1.0 + odds))
    assert record["confusable"]["models"][0]["share"] == 1.0  # if one of them is right
    assert likely(said) == [
        "9 in 10: none of the following; something else is there, in place of them or in addition",
        "if one is right, more than 99 in 100: steering lag (0 ms)",
    ]
    assert "9 in 10: none of the following" in text


def weighed(outcome, posterior):
    """Return an outcome with probabilities, and nothing that has no name."""
    localisation = dataclasses.replace(outcome.localisation, unmodelled=None)
    return dataclasses.replace(
        outcome, trace=dataclasses.replace(outcome.trace, posterior=posterior), localisation=localisation
    )


def test_the_first_page_says_where_the_likeliest_model_is_not_what_was_added(outcome):
    fitted, lag = outcome.trace.nominal, Hypothesis("steering_lag", "effect", ("steering_lag",))
    zero = np.zeros(len(HORIZONS))
    models = (
        ComparedModel((Alike((lag,), (1.0,)),), fitted, 0.0, zero, Interval(0.0, 0.0, 0.0), 0.999, 0.999),
        ComparedModel((), fitted, 0.0, zero, Interval(-99.0, -120.0, -80.0), 0.001, 0.001),
    )
    posterior = Posterior(models, 0.0, zero)
    said = likely(weighed(outcome, posterior))
    assert said[0].startswith("more than 99 in 100: steering lag")
    assert said[1] == "less than 1 in 100: what the search added; its criteria differ"


def test_what_is_less_likely_is_told_by_what_it_has_in_place_of_the_likeliest(outcome):
    """Where little differs; what differs in more than it shares is told whole."""
    fitted, zero = outcome.trace.nominal, np.zeros(len(HORIZONS))
    lag, roll, arm, compliance = (
        Alike((Hypothesis(name, "effect", ()),), (1.0,))
        for name in ("steering_lag", "accelerometer_roll", "sensor_lever_arm", "steering_compliance")
    )

    def told(*added):
        alone = Interval(0.0, 0.0, 0.0)
        models = (
            ComparedModel((lag, roll, arm), fitted, 0.0, zero, alone, 0.7, 0.7),
            ComparedModel(added, fitted, 0.0, zero, alone, 0.3, 0.3),
        )
        posterior = Posterior(models, 0.0, zero)
        return likely(weighed(outcome, posterior))[:2]

    assert told(lag, roll) == [
        "7 in 10: steering lag, accelerometer roll and sensor lever arm",
        "3 in 10: the same without sensor lever arm",
    ]
    assert told(lag, roll, arm, compliance)[1] == "3 in 10: the same, and besides: steering compliance"
    assert told(compliance, roll, arm)[1] == "3 in 10: the same, but in place of steering lag: steering compliance"
    assert told(compliance, arm)[1] == "3 in 10: steering compliance and sensor lever arm"


def test_without_probabilities_the_rest_is_written(outcome, tmp_path):
    record = reported(outcome, tmp_path)[1]
    assert record["posterior"] is record["confusable"] is None


@pytest.mark.parametrize(("verdict", "claims"), [("adequate", False), ("amended", True)])
def test_what_would_explain_most_is_claimed_only_where_something_is_missing(outcome, verdict, claims):
    said = repr(residual_sections.where(dataclasses.replace(outcome, verdict=verdict))[0])
    assert ("would explain most" in said) == claims
    assert ("#strong" in said) == claims
