"""What of the additions stays at the end, and what takes its place: the likeliest of the models that were fitted."""

from types import SimpleNamespace

import numpy as np

from harness.diagnosis.criteria import HOPEFUL
from harness.diagnosis.model.hypotheses import Hypothesis, hypotheses
from harness.diagnosis.selection import model_comparison as comparison
from support.driven_car import FREE


def test_two_models_are_weighed_among_themselves_however_much_likelier_a_third_is(augmented):
    """Beside it both probabilities are zero to the last digit, and the first in the list would be taken."""
    tried = hypotheses(augmented, FREE)
    bank, gain = (h for h in tried if h.name in ("road_bank", "steering_ratio_nonlinear"))
    held_out = SimpleNamespace(drives=[SimpleNamespace(time=range(100))])
    fits = SimpleNamespace(
        augmented=augmented, hypotheses=tried, doubt=0.5 * HOPEFUL, held_out=held_out, disturbed=False
    )
    compared, models = comparison.Comparison(fits, []), []
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


def test_what_was_added_stays_where_it_is_likely(monkeypatch):
    """A search from the likeliest model so far: an addition less, or others in their place."""
    gain, mass, inertia, lag = (Hypothesis(n, "effect", (n,)) for n in ("gain", "mass", "inertia", "lag"))
    late = Hypothesis("steering_delay", "effect", ("steering_delay",))
    monkeypatch.setattr(comparison, "_lessened", lambda fits, compared, added, best: (added, best, set()))

    def found(likely, *added, others=()):
        """Return what stays of additions, where models without one of them and others are fitted."""
        best = SimpleNamespace(point=None, objective=0.0)
        models = {frozenset(added): (added, best)}

        class Alternatives:
            def __init__(self, fits, rounds):
                pass

            def fit(self, added, best, needed):
                less = [tuple(k for k in added if k != h) for h in added]
                models.update({frozenset(a): (a, best) for a in (*less, *others)})

        compared = SimpleNamespace(
            likeliest=lambda models: max(models, key=lambda m: likely.get(frozenset(m[0]), 0.0)),
            posterior=lambda: None,
        )
        monkeypatch.setattr(comparison, "Comparison", lambda fits, rounds: compared)
        monkeypatch.setattr(comparison, "Alternatives", Alternatives)
        return set(comparison.likeliest(SimpleNamespace(models=models), [], added, best)[0])

    both, instead, alone = (frozenset(x) for x in ((gain, mass), (mass, inertia), (lag,)))
    assert found({both: 0.9, instead: 0.1}, gain, mass, others=[(mass, inertia)]) == both
    assert found({both: 0.3, instead: 0.6}, gain, mass, others=[(mass, inertia)]) == instead
    likely = {both: 0.3, frozenset([gain]): 0.4, alone: 0.5}
    assert found(likely, gain, mass, others=[(lag,)]) == alone  # two steps away
    assert found({frozenset(): 0.1, frozenset([gain]): 0.2}, gain) == {gain}
    assert found({frozenset(): 0.3, frozenset([gain]): 0.2}, gain) == set()
    refused = (gain, lag)  # by the criteria of a round: no more additions than it left
    assert found({frozenset([gain]): 0.1, frozenset(refused): 0.3}, gain, others=[refused]) == {gain}
    likely = {frozenset([late]): 0.1, alone: 0.5}
    assert found(likely, late, others=[(lag,)]) == {late}  # nothing of the vehicle replaces a late channel
    assert found({frozenset([lag]): 0.1, frozenset(): 0.3}, late) == set()


def test_one_addition_after_the_other_is_tried_without_and_what_is_beyond_doubt_not_again(monkeypatch):
    """The second and the third are tried in the model without the first, in which they are not in question or are."""
    odd, one, other = (Hypothesis(n, "effect", (n,)) for n in ("odd", "speed_delay", "steering_delay"))
    unknown = SimpleNamespace(loss=0.0, points=())
    monkeypatch.setattr(comparison, "Curvature", lambda fits, best: SimpleNamespace(without=lambda *_: unknown))
    most = {(odd, one, other): 0.0, (one,): -1.0, (other,): -1.15, (): -9.0}

    def asked(of_rest):
        """Return what is fitted where the first addition goes, which costs so much, in units of a doubt."""
        doubt, tried = 0.5 * HOPEFUL, []
        objectives = {frozenset(a): doubt * x for a, x in {**most, (one, other): of_rest}.items()}

        def fit_all(choices, *_, **__):
            tried.extend(tuple(a) for a, _ in choices)
            models.update({frozenset(a): (a, fitted(a)) for a, _ in choices})

        def fitted(added):
            return SimpleNamespace(point=None, objective=objectives[frozenset(added)])

        models = {frozenset(a): (a, fitted(a)) for a in [(odd, one, other)]}
        fits = SimpleNamespace(
            models=models, doubt=doubt, fit_all=fit_all, fitting=SimpleNamespace(best=min), say=print
        )
        likelier = SimpleNamespace(likeliest=lambda pair: next((m for m in pair if odd not in m[0]), pair[0]))
        added, _, needed = comparison._lessened(fits, likelier, *models[frozenset((odd, one, other))])
        assert added == (one, other)
        assert needed == ({one} if of_rest > -0.1 else set())
        comparison.Alternatives(fits).fit(added, fitted(added), needed)
        return tried

    assert asked(-0.05) == [(one, other), (other,), (one,)]
    assert asked(-0.2) == [(one, other), (other,), (one,)]
