"""What a round of a trace fits and adds, and what the verdict makes of it, on hypotheses that are laid down."""

from types import SimpleNamespace

import numpy as np
import pytest

from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis
from harness.diagnosis.report.probabilities import scaled
from harness.diagnosis.report.summary import _certainty
from harness.diagnosis.result.answer import gap
from harness.diagnosis.result.claims import verdict_of
from harness.diagnosis.selection import validation
from harness.diagnosis.selection.acceptance import (
    Candidate,
    decide,
    lookalikes,
    objections,
    passes_except_error,
    preferred,
    with_further,
    with_sensor,
)
from harness.diagnosis.selection.selection_round import SelectionRound
from harness.diagnosis.selection.validation import Judgement, leaves_nothing, predicts_better


class Stub(SimpleNamespace):
    discrepancy = ()  # neither a trace nor a judgement has one


def passing(name, excess, allowed=0.0, random=False, bic=1000.0):
    hypothesis = SimpleNamespace(name=name, random=random)
    held_out = Judgement(0.0, np.zeros(1), np.array([excess]), (), None, -0.5 * (allowed + excess))
    return SimpleNamespace(hypothesis=hypothesis, held_out=held_out, bic=bic)


def test_many_parameters_at_once_are_added_only_if_nothing_alone_strays_less():
    many, length, mass = passing(ALL_PARAMETERS, 0.28), passing("trailer_length", 0.14), passing("mass", 0.5)
    assert preferred([many, mass, length]) is length
    assert preferred([many, mass]) is many
    assert preferred([mass, many, length]) is mass
    assert preferred([]) is None


def test_a_random_process_is_added_only_if_nothing_alone_predicts_the_free_run_better():
    drift = passing("sensor_drift@yaw_rate", 0.5, allowed=0.2, random=True)
    other = passing("sensor_drift@speed", 0.1, random=True)
    bias, bank, many = passing("sensor_bias@yaw_rate", 0.43), passing("road_bank", 0.9), passing(ALL_PARAMETERS, 0.5)
    assert preferred([drift, bias]) is bias
    assert preferred([drift, bank, other]) is drift
    assert preferred([bank, drift, bias]) is bank
    assert preferred([many, other, bank]) is many  # what a process allows for is no prediction


def test_a_random_process_pays_for_the_error_for_which_it_allows():
    bias = passing("sensor_bias@yaw_rate", 3.47)
    assert preferred([passing("sensor_drift@yaw_rate", 3.37, allowed=2.7, random=True), bias]) is bias
    drift = passing("sensor_drift@yaw_rate", 0.02, allowed=2.7, random=True)
    assert preferred([drift, bias]) is drift


def test_what_gains_less_than_most_of_a_random_process_waits_for_it():
    drift = passing("sensor_drift@yaw_rate", 0.02, allowed=0.2, random=True)
    most, less = (passing("sensor_bias@yaw_rate", 0.0, bic=bic) for bic in (600.0, 400.0))
    assert preferred([drift, most]) is most
    assert preferred([drift, less]) is drift


def test_what_acts_like_the_best_is_fitted_too_where_that_leaves_something():
    def score(name, *response):
        return SimpleNamespace(hypothesis=Hypothesis(name, "effect", ()), response=(np.array(response),), excited=True)

    def winner(normalised_excess_mse):
        held_out = Stub(normalised_excess_mse=normalised_excess_mse, log_likelihood=10.0)
        return SimpleNamespace(score=length, hypothesis=length.hypothesis, held_out=held_out, bic=2800.0)

    length, inertia, mass = score("length", 1.0, 0.0), score("inertia", -1.0, 0.02), score("mass", 1.0, 1.0)
    many, calm = score(ALL_PARAMETERS, 1.0, 0.0), score("calm", 1.0, 0.0)
    calm.excited = False
    promised = [length, mass, many, inertia, calm]
    before = SimpleNamespace(normalised_excess_mse=10.0, log_likelihood=0.0)
    assert lookalikes(winner(0.14), before, promised, [length.hypothesis]) == [inertia]
    assert lookalikes(winner(0.14), before, promised, [length.hypothesis, inertia.hypothesis]) == []
    assert lookalikes(winner(0.01), before, promised, [length.hypothesis]) == []  # nothing is left
    assert lookalikes(winner(9.0), before, promised, [length.hypothesis]) == [inertia]  # a further one may help
    assert lookalikes(winner(11.0), before, promised, [length.hypothesis]) == []  # it would not be added


def test_coloured_innovations_are_no_amendment_whatever_was_named():
    plain = SimpleNamespace(coordinates=())
    last = SimpleNamespace(added=None, candidates=())
    named = Stub(
        effects=("crosswind",),
        rounds=(last,),
        after=SimpleNamespace(normalised_excess_mse=0.01),
        final=plain,
        cut_short="",
        added=(),
    )
    nothing = SimpleNamespace(unmodelled=None, random_process=None)
    assert [verdict_of(named, nothing, coloured) for coloured in (False, True)] == ["amended", "unresolved"]
    without = Stub(
        effects=(),
        rounds=(last,),
        after=SimpleNamespace(normalised_excess_mse=0.01),
        final=plain,
        cut_short="",
        added=(),
    )
    assert [verdict_of(without, nothing, coloured) for coloured in (False, True)] == ["adequate", "unresolved"]


def test_an_effect_that_leaves_the_error_to_another_one_is_hopeful():
    def candidate(name, bic, normalised_excess_mse, likelihood=5000.0):
        held_out = Stub(normalised_excess_mse=normalised_excess_mse, log_likelihood=likelihood)
        score = SimpleNamespace(response=(np.ones(1),), excited=True)
        return SimpleNamespace(
            hypothesis=Hypothesis(name, "effect", ()),
            fitted=SimpleNamespace(coordinates=()),
            bic=bic,
            held_out=held_out,
            score=score,
        )

    before = SimpleNamespace(normalised_excess_mse=27.6, log_likelihood=1000.0)
    many, delay = candidate(ALL_PARAMETERS, 17800.0, 23.5), candidate("steering_delay", 15400.0, 25.6)
    found = decide((many, delay), before, room=2)
    assert (found.added, found.hopeful) == (None, delay)
    passing = candidate("payload_shift", 9700.0, 0.06, 6000.0)
    with_it = with_further(found, decide((passing,), delay.held_out, room=1))
    assert with_it.added is delay
    assert with_it.reason == "meets all three criteria together with payload shift"
    assert decide((many, delay), before, room=1).hopeful is None  # no room for a further one
    assert decide((passing,), delay.held_out, room=0).added is None
    for other in (("lag", 400.0, 25.6), ("lag", 15400.0, 27.7), ("lag", 15400.0, 25.6, 900.0), ("lag", 15400.0, 0.04)):
        assert not passes_except_error(candidate(*other), before)


@pytest.mark.parametrize(
    ("before", "most"),
    [
        (10.0, 8.01),
        (1.05, 0.85),  # a fifth of what exceeds the floor by more than that is uncertain
        (0.06, 0.05799),
        (0.05, 0.05),
        (0.02, 0.05),  # as good as perfect before and after
        (0.0, 0.05),
        (np.inf, 1e300),
    ],
)
def test_of_an_error_within_its_floor_no_fall_is_asked(before, most):
    def candidate(left, bic=60.0, likelihood=2.0):
        score = SimpleNamespace(hypothesis=Hypothesis("compliance", "effect", ("compliance",)))
        return Candidate(score, SimpleNamespace(coordinates=()), bic, judged(left, likelihood))

    def judged(left, likelihood=1.0):
        return Judgement(likelihood, np.zeros(1), np.array([left]), (), None)

    assert predicts_better(judged(most), judged(before))
    assert objections(candidate(most), judged(before)) == []
    assert "the gain in BIC is 49, less than 50" in objections(candidate(most, bic=49.0), judged(before))
    assert objections(candidate(most, likelihood=0.9), judged(before)) != []
    more = 1.01 * most
    assert predicts_better(judged(more), judged(before)) == (before == np.inf)
    assert not predicts_better(judged(np.inf), judged(min(before, 1e6)))


@pytest.mark.parametrize(("rise", "refused"), [(1.0, False), (-15.0, False), (-15.2, True)])
def test_all_drives_together_speak_for_a_change_since_a_baseline(rise, refused):
    """What the baseline leaves open of its parameters takes the change up as well, and then predicts no worse."""
    before = Judgement(100.0, np.zeros(1), np.array([0.0]), (), None)
    held_out = Judgement(100.0 + rise, np.zeros(1), np.array([0.0]), (), None)

    def refuses(changed):
        score = SimpleNamespace(hypothesis=Hypothesis("mass", "parameter", ("mass",), changed=changed))
        return "likelihood of the held-out" in " ".join(objections(Candidate(score, None, 80.2, held_out), before))

    assert refuses(changed=True) == refused
    assert refuses(changed=False) == (rise < 0)


def test_a_fault_of_one_sensor_is_judged_by_its_own_signal_where_nothing_else_passes():
    """Here 0.2 of the error of all is that of the second signal, and the rest has no name."""
    before = Judgement(1000.0, np.zeros(2), np.array([17.0, 0.2]), (), None)

    def candidate(name, output, bic, *normalised_excess_mses, likelihood=2000.0, response=(0.0, 1.0)):
        score = SimpleNamespace(
            hypothesis=Hypothesis(name, "effect", (name,), output=output), response=(np.array(response),), excited=True
        )
        return Candidate(score, SimpleNamespace(coordinates=()), bic, judged(likelihood, *normalised_excess_mses))

    def judged(likelihood, *normalised_excess_mses):
        return Judgement(likelihood, np.zeros(2), np.array(normalised_excess_mses), (), None)

    def added(*candidates):
        found = decide(candidates, before, room=1)
        assert found.added is None
        return with_sensor(found)

    other = candidate("yaw_moment_control", None, 7000.0, 14.0, 0.2, response=(1.0, 0.0))
    roll, gain = candidate("accelerometer_roll", 1, 2900.0, 16.9, 0.09), candidate("gain", 1, 2400.0, 17.0, 0.1)
    found = added(other, roll, gain)
    assert found.added is roll
    assert found.best == "accelerometer_roll"
    assert added(other).added is None
    for nothing in (
        candidate("roll", 1, 2900.0, 16.9, 0.11),  # less than half of it
        candidate("roll", 1, 40.0, 16.9, 0.09),
        candidate("roll", 1, 2900.0, 16.9, 0.09, likelihood=900.0),
        candidate("roll", 1, 2900.0, 17.2, 0.0),  # at the cost of the other signal
        candidate("offset", None, 2900.0, 16.9, 0.09),  # acts on more than one
    ):
        assert added(other, nothing).added is None


def round_of(normalised_excess_mses, shortlist, fitted, before):
    """Return a round in which some hypotheses are worth a fit and some were fitted, with what they leave."""

    def judged(normalised_excess_mse):
        return Judgement(-normalised_excess_mse, np.zeros(1), np.array([normalised_excess_mse]), (), None)

    candidate_fits = SimpleNamespace(judge=lambda added, point: judged(before))
    selection_round = SelectionRound(candidate_fits, (), [SimpleNamespace(point=None)], 1)
    selection_round.promised = selection_round.shortlist = list(shortlist)
    selection_round.fits = {s.hypothesis: f"fit of {s.hypothesis.name}" for s in fitted}
    selection_round.fit = lambda scores: selection_round.fits.update(
        {s.hypothesis: f"fit of {s.hypothesis.name}" for s in scores}
    )
    selection_round.judged = lambda s: SimpleNamespace(
        hypothesis=s.hypothesis, bic=1e4, held_out=judged(normalised_excess_mses[s.hypothesis.name])
    )
    return selection_round


def test_everything_on_the_shortlist_is_fitted_and_many_parameters_where_they_may_reach_more():
    shortlist = [
        SimpleNamespace(hypothesis=Hypothesis(n, "effect", (n,)), gain=gain)
        for n, gain in ((ALL_PARAMETERS, 20.0), ("lag", 10.0), ("gain", 9.0), ("bias", 8.0), ("roll_steer", 7.0))
    ]

    def fitted(predicted):
        selection_round = round_of(dict.fromkeys((s.hypothesis.name for s in shortlist), 40.0), shortlist, (), 50.0)
        selection_round.predicted_bic_gain = lambda s: predicted if s is shortlist[0] else 1e4
        selection_round.fit_worthy()
        return {h.name for h in selection_round.fits}

    assert fitted(predicted=2e4) == {s.hypothesis.name for s in shortlist}
    assert fitted(predicted=9e3) == {"lag", "gain", "bias", "roll_steer"}


def test_many_parameters_are_not_fitted_where_something_alone_leaves_nothing():
    normalised_excess_mses = {"roll_steer": 30.0, "steering_lag": 1.9, "gain": 2.1}
    steer, lag, gain = shortlist = [
        SimpleNamespace(hypothesis=Hypothesis(n, "effect", (n,))) for n in normalised_excess_mses
    ]

    def settled(*fitted):
        return round_of(normalised_excess_mses, shortlist, fitted, before=200.0).settled()

    assert settled(steer, lag)  # a hundredth of the error
    assert not settled(steer, gain)  # a little more than that
    assert not settled()


@pytest.mark.parametrize(
    ("reached", "likelier", "third", "left_out"),
    [
        (100.3, "ratio", 2.0, ["ratio_error"]),
        (76.0, "ratio", 2.0, ["ratio_error"]),
        (70.0, "ratio_error", 2.0, []),
        (130.0, "ratio", 2.0, []),
        (76.0, "ratio_error", 2.0, ["ratio"]),
        (76.0, "ratio_error", 0.5, ["ratio_error"]),  # backlash would come before it
    ],
)
def test_of_two_that_say_the_same_the_likelier_stands_for_both_unless_their_fits_differ(
    reached, likelier, third, left_out
):
    """A wrong ratio is a parameter and an effect, and where their fits end was what named one of them."""

    def score(name, kind, *response):
        return SimpleNamespace(hypothesis=Hypothesis(name, kind, (name,)), response=(np.array(response),), excited=True)

    ratio, error = score("ratio", "parameter", 1.0, 0.0), score("ratio_error", "effect", -2.0, 0.001)
    backlash = score("backlash", "effect", 1.0, 0.5)
    shortlist = [ratio, error, backlash]
    left = {"ratio": 0.1, "ratio_error": 0.1, "backlash": 0.2}
    selection_round = round_of(left, shortlist, (), 50.0)
    objectives = {"ratio": 100.0, "ratio_error": reached, "backlash": 100.1}

    def fit(scores, near=None):
        selection_round.fits |= {s.hypothesis: SimpleNamespace(objective=objectives[s.hypothesis.name]) for s in scores}

    def judged(s):
        held_out = Judgement(60.0, np.zeros(1), np.array([left[s.hypothesis.name]]), (), None)
        return SimpleNamespace(
            score=s, hypothesis=s.hypothesis, bic=1e4 - (0.0, 1.0, third)[shortlist.index(s)], held_out=held_out,
            fitted=selection_round.fits.get(s.hypothesis),
        )  # fmt: skip

    forgotten = []
    selection_round.candidate_fits.joined = lambda added, h: (*added, h)
    selection_round.candidate_fits.forget = lambda added: forgotten.extend(h.name for h in added)
    selection_round.fit, selection_round.judged = fit, judged
    selection_round.taken_back = lambda hypothesis, fitted: None
    selection_round.belief = lambda s: (float(s.hypothesis.name == likelier), 0.0)
    selection_round.fit([ratio])
    selection_round.fit_like_the_best()
    assert forgotten == left_out
    assert {h.name for h in selection_round.fits} == {*left} - {*left_out}
    assert backlash.hypothesis in selection_round.fits  # acts alike, and these drives tell it apart


def test_a_name_is_likelier_whose_places_do_not_share_its_odds_and_then_one_of_fewer_values():
    everywhere, front, steering = (
        SimpleNamespace(hypothesis=Hypothesis(name, "effect", amplitudes), freedom=len(amplitudes))
        for name, amplitudes in (
            ("tyre_force_offset", ("offset_front", "offset_rear")),
            ("tyre_force_offset@front", ("offset_front",)),
            ("steering_offset", ("offset",)),
        )
    )
    scores = [everywhere, front, steering]
    tried = [s.hypothesis for s in scores]
    belief = SelectionRound(SimpleNamespace(augmented=None, free=(), hypotheses=tried), (), [], 1).belief
    assert sorted(scores, key=belief) == scores


def test_what_says_the_same_and_is_likelier_beforehand_is_fitted_though_nothing_is_left(monkeypatch):
    """A load that shifts before the first manoeuvre is a CoG that is stated wrongly; a mass has another response."""
    responses = {"shift": ("effect", (1.0, 0.0)), "cog": ("parameter", (2.0, 0.0)), "mass": ("parameter", (1.0, 1.0))}
    scores = [
        SimpleNamespace(hypothesis=Hypothesis(n, kind, (n,)), response=(np.array(r),), excited=True, freedom=1.0)
        for n, (kind, r) in responses.items()
    ]
    shift, cog, _ = scores
    effects = [Hypothesis(n, "effect", (n,)) for n in ("wind", "lag", "bank")]  # three more to share the odds
    tried = [*(s.hypothesis for s in scores), *effects]
    before = Judgement(0.0, np.zeros(1), np.array([10.0]), (), None)
    monkeypatch.setattr(SelectionRound, "before", before)
    fits = SimpleNamespace(augmented=None, free=(), hypotheses=tried)
    selection_round = SelectionRound(fits, (), [], 1)
    selection_round.promised, selection_round.fits = scores, {shift.hypothesis: None}

    def names(winner, error, bic=900.0):
        held_out = Judgement(9.0, np.zeros(1), np.array([error]), (), None)
        return selection_round.likelier_names(Candidate(winner, object(), bic, held_out))

    assert names(shift, 0.0) == [cog]
    assert names(shift, 9.9) == []  # it would not be added
    selection_round.fits = {cog.hypothesis: None}
    assert names(cog, 0.0) == []


def test_the_best_fault_of_each_sensor_is_fitted_whose_signal_strays():
    """Of three signals the last one is as it should be; promises are in units of BIC, 50 of which are needed."""
    gains = {"roll": (1, 900.0), "gain": (1, 800.0), "bias": (2, 700.0), "lag": (None, 600.0), "delay": (0, 40.0)}
    scores = [
        SimpleNamespace(hypothesis=Hypothesis(n, "effect", (n,), output=output), gain=gain, freedom=1.0)
        for n, (output, gain) in gains.items()
    ]
    before = Judgement(0.0, np.zeros(3), np.array([17.0, 0.2, 0.01]), (), None)
    candidate_fits = SimpleNamespace(judge=lambda added, point: before, bic=lambda gain, freedom: gain)

    def fitted(room):
        selection_round = SelectionRound(candidate_fits, (), [SimpleNamespace(point=None)], 1)
        selection_round.promised, tried = scores, []
        selection_round.fit = lambda chosen: tried.extend(s.hypothesis.name for s in chosen)
        assert selection_round.decided_by_sensor(room).added is None  # nothing was fitted indeed
        return tried

    assert fitted(room=1) == ["roll"]
    assert fitted(room=0) == []


def test_what_took_the_place_of_an_effect_says_how_sure_that_is():
    gain, inertia = Hypothesis("sensor_gain", "effect", ("gain",)), Hypothesis("inertia", "parameter", ("inertia",))
    held_out = SimpleNamespace(log_likelihood=30.0)
    added = SimpleNamespace(hypothesis=gain, held_out=held_out, bic=900.0)
    round_ = SimpleNamespace(added=added, before=SimpleNamespace(log_likelihood=10.0))

    def certainty(*kept):
        dropped = tuple(h for h in (gain,) if h not in kept)
        trace = SimpleNamespace(rounds=(round_,), added=kept, dropped=dropped)
        localisation = SimpleNamespace(random_process=None)
        return _certainty(SimpleNamespace(trace=trace, localisation=localisation, bic_needed=4.0))

    assert [line.split(":")[0] for line in certainty(gain)] == ["sensor gain"]
    (line,) = certainty(inertia)
    assert line.startswith("inertia: takes the place of sensor gain; likelier by")


def test_the_answer_tells_what_becomes_of_the_error():
    def said(before, after):
        normalised_excess_mses = (np.array([before]), np.array([after]))
        return gap(*(Judgement(0.0, np.zeros(1), e, (), None) for e in normalised_excess_mses))

    assert (
        said(4.0, 1.0)
        == " The simulation error on the held-out drives, beyond the noise of sensors and inputs, falls by 50 %."
    )
    assert said(4.0, 4.0) == said(0.0, 0.0) == " The simulation error on the held-out drives does not fall."
    assert said(np.inf, 4.0).endswith("leaves the model's range; that of the final model stays within it.")
    assert said(np.inf, np.inf).endswith("; that of the final model does so too.")


def test_a_model_that_left_its_range_makes_nothing_little():
    def judged(normalised_excess_mse):
        return Judgement(0.0, np.zeros(1), np.array([normalised_excess_mse]), (), None)

    assert leaves_nothing(judged(0.9), judged(100.0))
    assert not leaves_nothing(judged(0.9), judged(np.inf))
    assert leaves_nothing(judged(0.04), judged(np.inf))


def test_a_drift_that_reaches_twice_its_deviation_leaves_nothing_and_hides_no_other_signal():
    """A tenth of the first signal's floor is that of a drift, so that four times as much is an excess of 0.3."""

    def judged(*excess):
        return Judgement(0.0, np.zeros(2), np.array(excess), (), None, wander=np.array([0.1, 0.0]))

    before = judged(2.0, 2.0)
    assert leaves_nothing(judged(0.3, 0.04), before)
    assert judged(0.4, 0.04).unexplained == pytest.approx(0.14)
    assert not leaves_nothing(judged(0.4, 0.0), before)
    assert not leaves_nothing(judged(0.0, 0.1), before)


def test_frequencies_are_shown_in_hertz_and_rates_in_degrees():
    assert scaled("roll_frequency", 2 * np.pi, "rad/s") == (1.0, "Hz")
    assert scaled("steering_lag", 0.048, "s") == (48.0, "ms")
    assert scaled("crosswind_onset", 12.0, "s") == (12.0, "s")
    assert scaled("sensor_bias_yaw_rate", np.pi, "rad/s") == (180.0, "°/s")


def test_the_error_of_a_perfect_model_is_that_of_the_sensors_over_all_samples(monkeypatch):
    """Of each output its noise, and what its samples spread: 0.09 + 0.16 throughout, 1 + 4 in 3 of 8 samples."""
    monkeypatch.setattr(validation, "Fitting", lambda *_: None)
    drives = [SimpleNamespace(spread=np.tile([0.16, s], (n, 1))) for s, n in ((0.0, 5), (4.0, 3))]
    held_out = validation.HeldOut(None, drives, np.array([0.09, 1.0]))
    np.testing.assert_allclose(held_out.floor, np.sqrt([0.25, 1.0 + 4.0 * 3 / 8]))
