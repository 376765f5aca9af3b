"""What of the additions stays at the end, and what takes its place: the likeliest of the models that were fitted."""

from types import SimpleNamespace

import numpy as np

from harness.diagnosis.criteria import HOPEFUL
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, SENSOR_DRIFTS, Hypothesis, hypotheses
from harness.diagnosis.selection import acceptance
from harness.diagnosis.selection import model_comparison as comparison
from support.driven_car import FREE


def test_two_models_are_weighed_among_themselves_however_much_likelier_a_third_is(augmented):
    """Beside it both probabilities are zero to the last digit, and the first in the list would be taken."""
    bank, gain = (h for h in hypotheses(augmented, FREE) if h.name in ("road_bank", "steering_ratio_nonlinear"))
    fits = SimpleNamespace(augmented=augmented, free=FREE, doubt=0.5 * HOPEFUL)
    compared, models = comparison._Comparison(fits, []), []
    for added, density in (((), -3000.0), ((bank,), -2000.0), ((bank, gain), 0.0)):
        fitted = SimpleNamespace(coordinates=(), added=added, objective=0.0)
        models.append((added, fitted))
        predicted = comparison._Predicted(added, fitted, (), 0.0, np.full((24, 5), density / 24))
        compared._known[id(fitted)] = predicted
    assert compared.likeliest(models[:2]) is models[1]
    assert compared.likeliest(models) is models[2]
    models[2][1].objective = -0.5 * HOPEFUL - 1.0  # out of the question by its fit, which was given up
    assert compared.likeliest(models) is models[1]
    models[2][1].objective = -0.5 * HOPEFUL + 1.0
    assert compared.likeliest(models) is models[2]


def same_point(point, *_):
    """Stand in for a point with less in it."""
    return point


def test_what_was_added_stays_where_it_is_likely(monkeypatch):
    """A search from the likeliest model so far: an addition less, or others in their place."""
    gain, mass, inertia, cog, lag = (
        Hypothesis(n, k, (n,))
        for n, k in (("gain", "effect"), *((p, "parameter") for p in ("mass", "inertia", "cog")), ("lag", "effect"))
    )
    lost = {}
    monkeypatch.setattr(comparison, "losses", lambda fits, added, best: {h: lost.get(h, 0.0) for h in added})
    for module in (comparison, acceptance):
        monkeypatch.setattr(module, "cosine", lambda one, other: 0.95)
    monkeypatch.setattr(comparison, "replace", lambda point: point)

    def tried(*names):
        candidates = [
            SimpleNamespace(hypothesis=h, fitted=h if i == 0 else None, bic=-i, score=SimpleNamespace(excited=True))
            for i, h in enumerate(names)
        ]
        return SimpleNamespace(candidates=candidates, added=candidates[0])

    rounds = [tried(gain, lag), tried(mass, inertia, cog)]

    def found(likely, *added, refused=(), refuted=None):
        best = SimpleNamespace(point=None, objective=0.0)
        models = {frozenset(a): (a, best) for a in (added, *refused)}

        def fit_all(choices, objective, afresh, needed):
            models.update({frozenset(a): (a, best) for a, start in choices if start() is best.point})

        fits = SimpleNamespace(
            models=models,
            doubt=0.5 * HOPEFUL,
            refuted={refuted},
            fit_all=fit_all,
            start=lambda base, score: base,
            without=same_point,
            say=print,
        )
        compared = SimpleNamespace(
            likeliest=lambda models: max(models, key=lambda m: likely.get(frozenset(m[0]), 0.0)),
            posterior=lambda: None,
        )
        monkeypatch.setattr(comparison, "_Comparison", lambda fits, rounds: compared)
        return set(comparison.likeliest(fits, rounds, added, best)[0])

    both, instead, alone = (frozenset(x) for x in ((gain, mass), (mass, inertia), (lag,)))
    assert found({both: 0.9, instead: 0.1}, gain, mass) == both
    assert found({both: 0.3, instead: 0.6}, gain, mass) == instead
    assert found({both: 0.3, frozenset([gain]): 0.4, alone: 0.5}, gain, mass) == alone  # two steps away
    assert found({frozenset(): 0.1, frozenset([gain]): 0.2}, gain) == {gain}
    assert found({frozenset(): 0.3, frozenset([gain]): 0.2}, gain) == set()
    refused = (gain, lag)  # by the criteria of a round: no more additions than it left
    assert found({frozenset([gain]): 0.1, frozenset(refused): 0.3}, gain, refused=[refused]) == {gain}
    late = Hypothesis("steering_delay", "effect", ("steering_delay",))
    rounds[:] = [tried(late, lag)]
    assert found({frozenset([late]): 0.1, alone: 0.5}, late) == {late}  # nothing of the vehicle replaces a late channel
    assert found({frozenset([lag]): 0.1, frozenset(): 0.3}, late) == set()
    rounds[:] = [tried(gain, lag)]
    lost[gain] = 2 * HOPEFUL  # beyond doubt: not fitted without it, but what takes over nine tenths of it is tried
    assert found({frozenset([gain]): 0.1, frozenset(): 0.3}, gain) == {gain}
    assert found({frozenset([gain]): 0.1, alone: 0.3}, gain) == {lag}
    assert found({frozenset([gain]): 0.1, alone: 0.3}, gain, refuted=lag) == {gain}
    lost[gain] = 20 * HOPEFUL
    assert found({frozenset([gain]): 0.1, alone: 0.3}, gain) == {gain}
    rounds[0].candidates[1].fitted = lag  # a near tie of two fits says more than their linear responses
    assert found({frozenset([gain]): 0.1, alone: 0.3}, gain) == {lag}
    many = Hypothesis(ALL_PARAMETERS, "parameter", ("mass", "inertia"))
    rounds[:] = [tried(lag, many)]
    assert found({alone: 0.1, frozenset([many]): 0.3}, lag) == {lag}  # was not fitted: it resembles whatever is missing
    rounds[0].candidates[1].fitted = many
    assert found({alone: 0.1, frozenset([many]): 0.3}, lag) == {many}
    rounds[:] = [tried(mass, many), tried(gain)]  # one explained nearly all: the round fitted no others with it
    assert found({frozenset([gain, mass]): 0.1, frozenset([many]): 0.3}, mass, gain) == {many}
    rounds[:] = [tried(mass, many), tried(late)]
    assert found({frozenset([late, mass]): 0.1, frozenset([many]): 0.3}, mass, late) == {late, mass}


def test_what_is_beyond_doubt_beside_more_is_not_tried_without_it_again(monkeypatch):
    """A model with less in it is less likely still; unless what it is compared with has become so much less likely."""
    odd, drift, bank = (Hypothesis(n, "effect", (n,)) for n in ("odd", "drift", "bank"))
    monkeypatch.setattr(comparison, "losses", lambda fits, added, best: dict.fromkeys(added, 0.0))
    most = {(odd, drift, bank): 0.0, (odd, bank): -1.1, (odd, drift): -0.9, (drift,): -1.0, (bank,): -1.15, (): -9.0}

    def asked(of_rest):
        """Return what is fitted where the first addition goes, which costs so much, in units of a doubt."""
        doubt, tried = 0.5 * HOPEFUL, []
        objectives = {frozenset(a): doubt * x for a, x in {**most, (drift, bank): of_rest}.items()}

        def fit_all(choices, *_, **__):
            tried.extend(tuple(a) for a, _ in choices)
            models.update({frozenset(a): (a, fitted(a)) for a, _ in choices})

        def fitted(added):
            return SimpleNamespace(point=None, objective=objectives[frozenset(added)])

        models = {frozenset(a): (a, fitted(a)) for a in [(odd, drift, bank)]}
        fits = SimpleNamespace(models=models, doubt=doubt, fit_all=fit_all, without=same_point, say=print)
        likelier = SimpleNamespace(likeliest=lambda pair: next((m for m in pair if odd not in m[0]), pair[0]))
        added, _, needed = comparison._lessened(fits, likelier, *models[frozenset((odd, drift, bank))])
        assert added == (drift, bank)
        assert needed == ({drift} if of_rest > -0.1 else set())
        comparison._fit_alternatives(fits, [], added, fitted(added), needed)
        return tried

    first = [(drift, bank), (odd, bank), (odd, drift)]
    assert asked(-0.05) == [*first, (drift,)]
    assert asked(-0.2) == [*first, (bank,), (drift,)]


def test_what_was_fitted_beside_all_parameters_at_once_may_stand_in_their_place(monkeypatch):
    """They take up what later additions explain as well, so what they gained more says nothing."""
    monkeypatch.setattr(comparison, "cosine", lambda one, other: 0.3)
    monkeypatch.setattr(acceptance, "cosine", lambda one, other: 0.3)

    def candidate(name, bic, fitted=True, kind="effect"):
        score = SimpleNamespace(excited=True)
        return SimpleNamespace(hypothesis=Hypothesis(name, kind, (name,)), bic=bic, fitted=fitted, score=score)

    many, lift = candidate(ALL_PARAMETERS, 6562.0, kind="parameter"), candidate("lifted_axle@21", 4196.0)
    further, unfitted = (
        candidate("axle_21_from_rear", 4138.0, kind="parameter"),
        candidate("trailer_mass", 900.0, False),
    )
    tried = SimpleNamespace(candidates=[many, lift, further, unfitted])
    assert comparison._like(tried, many, (), 1e4) == [lift, further]
    assert comparison._like(tried, lift, (), 1e4) == [many, further]  # 58 units behind
    assert comparison._like(tried, further, (lift.hypothesis,), 1e4) == [many]


def test_parameters_stand_in_the_place_of_what_may_resemble_them(monkeypatch):
    """Not of a late channel, which nothing replaces, and not of a random process; beside one its rivals count."""
    for module in (comparison, acceptance):
        monkeypatch.setattr(module, "cosine", lambda one, other: 0.95)
    drift, late, lag, bias, mass, length = (
        Hypothesis(n, kind, (n,), random=n.startswith("sensor_drift"))
        for n, kind in (
            ("sensor_drift@yaw_rate", "effect"),
            ("steering_delay", "effect"),
            ("lag", "effect"),
            ("bias", "effect"),
            *((p, "parameter") for p in ("mass", "length")),
        )
    )
    both = Hypothesis(SENSOR_DRIFTS, "effect", drift.amplitudes, random=True, parts=(drift,))

    def tried(*fitted, beside=()):
        each = [(h, h) for h in fitted] + [(h, None) for h in beside]
        score = SimpleNamespace(excited=True)
        return SimpleNamespace(
            candidates=[SimpleNamespace(hypothesis=h, fitted=f, bic=0.0, score=score) for h, f in each]
        )

    rounds = [tried(mass, length), tried(late), tried(lag), tried(both, bias, beside=[drift])]
    instead = {
        h.name: {c.hypothesis.name for likes in comparison._stand_ins(rounds, h, (mass,), 0.0) for c in likes}
        for h in (lag, late, drift)
    }
    assert instead == {"lag": {"length"}, "steering_delay": set(), "sensor_drift@yaw_rate": {"bias"}}
