"""What may stand in the place of an addition is asked of the drives in the model without it, with all else in it."""

from dataclasses import replace
from types import SimpleNamespace

import pytest

from harness.diagnosis.criteria import TRIED
from harness.diagnosis.fitting import Fitting
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis, hypotheses, still_open
from harness.diagnosis.selection import earlier_models, model_comparison
from harness.diagnosis.selection.candidate_fits import CandidateFits
from harness.diagnosis.selection.earlier_models import EarlierModel, fit_earlier
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.model_comparison import Alternatives, Comparison, likeliest
from harness.diagnosis.selection.validation import HeldOut
from support.driven_car import FREE, driven


@pytest.fixture(scope="module")
def fits(augmented):
    """Return fits to drives of a car with another yaw inertia whose steering wheel is off its middle."""
    recordings = [driven(seed, ["steering_offset"], steering_offset=0.01, yaw_inertia=3300.0) for seed in (41, 42, 43)]
    drives = [augmented.drive(r, f"drive {i}") for i, r in enumerate(recordings)]
    variances = first_variances(augmented, drives)
    fitting = Fitting(augmented, drives[:2], variances, driven=drives)
    return CandidateFits(fitting, HeldOut(augmented, drives[2:], variances), FREE, lambda _: None)


def with_(fits, *names):
    known = {h.name: h for h in hypotheses(fits.augmented, fits.free)}
    added = tuple(known[n] for n in names)
    point = fits.fit((), fits.fitting.first()).point
    values = point.values.copy()
    for h in added:  # one step from where they have no slope
        for name, value in zip(h.shared, [1e-3] * len(h.amplitudes) + [9.0] * len(h.shapes), strict=True):
            values[fits.augmented.row(name)] = value
    return added, fits.fit(added, replace(point, values=values))


def test_what_no_round_has_seen_takes_the_place_of_what_is_wrong(fits):
    """Roll steer was taken for the inertia before the offset was known; no round tried the inertia beside that."""
    found, _, posterior = likeliest(fits, [], *with_(fits, "roll_steer", "steering_offset"))
    assert {h.name for h in found} == {"yaw_inertia", "steering_offset"}
    assert posterior.models[0].share > 0.9


@pytest.mark.parametrize("name", ["steering_delay", "sensor_drift@yaw_rate"])
def test_nothing_takes_the_place_of_what_recordings_have_anyway(fits, name):
    added, best = with_(fits, name)
    before = set(fits.models)
    Alternatives(fits).fit(added, best, set())
    assert set(fits.models) - before <= {frozenset()}


def test_models_of_an_earlier_trace_are_fitted_and_stay_among_what_is_compared(fits):
    """What was alike then is fitted too; what is out of the question by its fit is compared all the same."""
    roll, offset, inertia = ("effect", "roll_steer"), ("effect", "steering_offset"), ("parameter", "yaw_inertia")
    nominal = fits.fit((), fits.fitting.first())
    models = [
        EarlierModel(((roll, inertia), (offset,)), {"steering_offset": 0.01, "roll_steer": 0.02}),
        EarlierModel(((roll,),), {"roll_steer": 0.02}),
        EarlierModel((), {}),  # the nominal one, which is fitted anyway
        EarlierModel(((("effect", "of_a_library_of_then"),),), {}),
    ]
    found = fit_earlier(fits, models, nominal)
    names = [{h.name for h in added} for added, _ in found]
    assert names == [{"roll_steer", "steering_offset"}, {"yaw_inertia", "steering_offset"}, {"roll_steer"}]
    assert Comparison(fits, []).likeliest(found) is found[1]
    best, out = found[1][1], found[2][1]
    assert out.objective < best.objective - fits.doubt
    compared = [{h.name for h in frozenset().union(*(a.hypotheses for a in m.added))} for m in posterior_of(fits)]
    assert all(n in compared for n in names)
    fits.stay = ()
    compared = [m.fitted for m in posterior_of(fits)]
    assert out not in compared  # which stayed for being of the earlier trace


def posterior_of(fits):
    return Comparison(fits, []).posterior().models


def test_a_fit_of_an_earlier_model_begins_at_its_estimates(fits):
    inertia = next(h for h in fits.hypotheses if h.name == "yaw_inertia")
    point = fits.fitting.first()
    model = EarlierModel(((("parameter", "yaw_inertia"),),), {"yaw_inertia": 3321.0, "mass": 1.0})
    start = earlier_models._start(fits, (inertia,), model, point)
    changed = {fits.augmented.names[i] for i in range(len(point.values)) if (start.values != point.values)[i].any()}
    assert changed == {"yaw_inertia"}  # and not what this one does not move
    assert set(start.values[fits.augmented.row("yaw_inertia")]) == {3321.0}


def test_many_parameters_must_promise_more_and_what_says_the_same_is_not_tried(monkeypatch):
    own, twin, many, *others = (
        Hypothesis(n, "effect", (n,)) for n in ("own", "twin", ALL_PARAMETERS, *(f"other {i}" for i in range(5)))
    )
    calls = []

    def found(gain_of_many):
        def score(h, gain):
            return SimpleNamespace(hypothesis=h, gain=gain)

        scores = [score(many, gain_of_many), score(own, 90.0), score(twin, 90.0), *(score(h, 80.0) for h in others)]

        class Ranked:
            def __init__(self, *given):
                calls.append(given)
                self.promised, self.shortlist = scores, scores[:-1]

            def rank(self):
                pass

        monkeypatch.setattr(model_comparison, "SelectionRound", Ranked)
        monkeypatch.setattr(
            model_comparison, "same", lambda one, other: {one.hypothesis, other.hypothesis} == {own, twin}
        )
        asked = Alternatives(SimpleNamespace(models={frozenset(): ((), None)}))
        monkeypatch.setattr(asked, "_test", lambda *_: None)
        first = [s.hypothesis for s in asked._stand_ins(own, (), None)]
        assert [s.hypothesis for s in asked._stand_ins(own, (), None)] == first
        return first

    assert found(100.0) == [many, *others[: TRIED - 1]]
    assert found(85.0) == others[:TRIED]
    assert len(calls) == 2  # the same model is ranked once


def test_what_came_nearest_in_its_round_is_tried_in_the_place_of_an_addition_though_it_promises_little(monkeypatch):
    own, first, second, *others = (
        Hypothesis(n, "effect", (n,)) for n in ("own", "first", "second", "a", "b", "c", "d")
    )
    drifts = Hypothesis("drifts", "effect", ("drift",), output=0, random=True)
    scores = [
        SimpleNamespace(hypothesis=h, gain=g)
        for h, g in zip([*others, own, second, drifts], range(9, 0, -1), strict=False)
    ]

    def tried(h, bic):
        return SimpleNamespace(hypothesis=h, bic=bic, fitted=object())

    unfitted = SimpleNamespace(hypothesis=first, bic=80.0, fitted=None)
    candidates = [tried(own, 90.0), unfitted, tried(drifts, 75.0), tried(second, 70.0), tried(others[0], 60.0)]
    round_ = SimpleNamespace(added=candidates[0], candidates=candidates)
    ranked = SimpleNamespace(promised=scores, shortlist=scores[:5], rank=lambda: None)
    monkeypatch.setattr(model_comparison, "SelectionRound", lambda *_: ranked)
    monkeypatch.setattr(model_comparison, "same", lambda *_: False)
    for rounds, extra in (([], []), ([round_], [second])):
        asked = Alternatives(SimpleNamespace(models={frozenset(): ((), None)}), rounds)
        monkeypatch.setattr(asked, "_test", lambda *_: None)
        assert [s.hypothesis for s in asked._stand_ins(own, (), None)] == [*others[:TRIED], *extra]


def test_many_parameters_are_fitted_unless_something_simpler_explains_everything(monkeypatch):
    """A CoG with a roll steer beside it, which is not there, explained what several wrong values explain."""
    given = ("cog", "parameter"), ("roll_steer", "effect"), ("speed_delay", "effect")
    cog, steer, late = (Hypothesis(n, k, (n,)) for n, k in given)
    mass = Hypothesis("mass", "parameter", ("mass",))
    many = Hypothesis(ALL_PARAMETERS, "parameter", ("cog", "mass"))
    nothing = SimpleNamespace(loss=0.0, points=())
    monkeypatch.setattr(model_comparison, "Curvature", lambda fits, best: SimpleNamespace(without=lambda *_: nothing))
    stand_ins = [SimpleNamespace(hypothesis=h) for h in (many, mass)]
    monkeypatch.setattr(model_comparison.Alternatives, "_stand_ins", lambda *_: stand_ins)
    monkeypatch.setattr(model_comparison.Alternatives, "_judged", lambda *_: None)

    def fitted(*added, explained=True, with_mass=-1.0):
        """Return the models with many parameters that are fitted; those with a mass are as likely as it says."""
        monkeypatch.setattr(model_comparison, "leaves_nothing", lambda after, before: explained)
        best, found, models = SimpleNamespace(objective=0.0, point=None), [], {}

        def fit_all(chosen, *_, **__):
            found.extend(m[0] for m in chosen)
            models.update({frozenset(a): (a, SimpleNamespace(objective=with_mass)) for a, _ in chosen})

        fits = SimpleNamespace(
            models=models, fitting=SimpleNamespace(best=max), doubt=1.0, joined=lambda rest, h: (*rest, h),
            say=lambda _: None, fit_all=fit_all,
        )  # fmt: skip
        models[frozenset(added)] = added, best
        Alternatives(fits).fit(added, best, set())
        return [a for a in found if many in a]

    assert fitted(steer) == fitted(late, steer) == []
    assert fitted(steer, explained=False) == [(many,)]
    assert fitted(cog, steer) == [(cog, many)]  # in the place of the roll steer; the CoG is one of them
    assert fitted(cog, steer, with_mass=1.0) == []  # with one of them wrong in the place of the one or the other


def test_a_fit_in_the_place_of_an_addition_starts_from_what_was_fitted_of_it_elsewhere(fits):
    """Where what a score predicts is less likely: of a large effect slopes predict little."""
    known = {h.name: h for h in hypotheses(fits.augmented, fits.free)}
    offset, inertia = known["steering_offset"], known["yaw_inertia"]
    added, best = with_(fits, "roll_steer", "steering_offset")
    rest, row = (offset,), fits.augmented.row("yaw_inertia")
    fits.fit(rest, fits.without(best.point, added[:1], rest))
    nothing = SimpleNamespace(hypothesis=inertia, amplitudes=[fits.augmented.stated()[row]], shapes=[])

    def started():
        point = Alternatives(fits)._start(added[0], rest, best.point, nothing)
        return point.values[row, 0], fits.fitting.log_likelihood(point)

    fits.models = {key: model for key, model in fits.models.items() if inertia not in key}
    stated, before = started()
    assert stated == fits.augmented.stated()[row]
    elsewhere = fits.fit((offset, inertia, known["sensor_gain@yaw_rate"]), fits.fitting.first())
    found, after = started()
    assert found == elsewhere.point.values[row, 0]
    assert after > before + 100


def test_an_effect_at_some_places_and_at_all_others_is_one_everywhere(fits):
    known = {h.name: h for h in hypotheses(fits.augmented, fits.free)}
    everywhere, front, rear, lag = (
        known[n] for n in ("roll_steer", "roll_steer@front", "roll_steer@rear", "steering_lag")
    )
    others = still_open(everywhere, front.amplitudes)
    assert others.amplitudes == rear.amplitudes
    assert fits.joined((front, lag), others) == (lag, everywhere)
    assert fits.joined((lag,), front) == (lag, front)
    assert fits.joined((lag,), everywhere) == (lag, everywhere)
    effect, parameter = (Hypothesis("steering_ratio", kind, (kind,)) for kind in ("effect", "parameter"))
    assert fits.joined((effect,), parameter) == (effect, parameter)
    late = known["channel_delays"]
    assert fits.joined((lag,), late) == (lag, *late.parts)


def test_a_fit_starts_without_what_was_predicted_for_another_model(fits):
    """No amplitude of it is likelier than far too much; but what has no slope there starts at a value of its grid."""
    known = {h.name: h for h in hypotheses(fits.augmented, fits.free)}
    point = fits.fit((), fits.fitting.first()).point

    def started(name, amplitude):
        h = known[name]
        shapes = [fits.augmented.model.parameters[fits.augmented.row(n)].grid[0] for n in h.shapes]
        score = SimpleNamespace(hypothesis=h, amplitudes=[amplitude] * len(h.amplitudes), shapes=shapes)
        found = fits.start(point, score)
        return [found.values[fits.augmented.row(n), 0] for n in h.amplitudes]

    assert started("steering_offset", 0.2) == [0.0]
    assert started("steering_offset", 0.02) == [0.01]  # half of twice what is there
    assert started("steering_backlash", 0.3)[0] > 0.0
