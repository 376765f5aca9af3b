"""What is no answer: a model worse than the nominal one, an amplitude at a bound; and what is large by nature."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from harness.common.statistics import Interval
from harness.diagnosis.fitting import ParameterPoint
from harness.diagnosis.model.hypotheses import Hypothesis
from harness.diagnosis.result.claims import verdict_of
from harness.diagnosis.selection import selection_round, validation
from harness.diagnosis.selection.acceptance import ends_at_bound, implausible
from harness.diagnosis.selection.posterior import Alike, ComparedModel, Posterior
from harness.diagnosis.selection.selection_round import SelectionRound
from harness.diagnosis.selection.validation import Judgement
from harness.identification.coordinates import parameter_coordinate
from harness.models.contracts import Parameter

LIFT = Parameter("axle_lift", "l", "dimensionless", -0.5, 0.995, "", neutral=0.0, natural=(0.5, 0.99))
LIFTED = Hypothesis("lifted_axle", "effect", ("axle_lift",))
MASS = Hypothesis("mass", "parameter", ("mass",))


def judged_by(errors, wander=0.0):
    """Return a held-out drive of 60 s with unit noise, and a model whose free run is off by errors ``(samples,)``."""
    time = np.arange(0.0, 60.0, 0.05)
    noise = np.random.default_rng(3).normal(size=(len(time), 1))
    drive = SimpleNamespace(time=time, measurements=noise, spread=np.zeros((len(time), 1)))
    held_out = SimpleNamespace(drives=(drive,), variances=np.ones(1))
    simulated = np.broadcast_to(np.asarray(errors, float), time.shape)[:, None]
    excess = np.array([np.mean(np.broadcast_to(errors, time.shape) ** 2)])
    each = (SimpleNamespace(drive=drive, simulated=simulated),)
    return held_out, Judgement(0.0, np.zeros(1), excess, each, None, wander=wander)


def test_a_model_that_simulates_the_held_out_drives_worse_is_refused_beyond_the_noise_of_the_error():
    held_out, nominal = judged_by(1.0)
    growth = validation.error_growth(held_out, nominal, judged_by(3.0)[1])
    assert growth.beyond_noise
    assert growth.ratio.lower < growth.ratio.value < growth.ratio.upper
    assert growth.ratio.value == pytest.approx(math.sqrt(10.0 / 2.0), rel=0.05)
    assert not validation.error_growth(held_out, nominal, judged_by(1.0)[1]).beyond_noise
    assert not validation.error_growth(held_out, nominal, judged_by(0.3)[1]).beyond_noise
    late = np.where(np.arange(1200) >= 1150, 3.0, 1.0)  # in one block of twelve: as well the noise of another drive
    assert not validation.error_growth(held_out, nominal, judged_by(late)[1]).beyond_noise


def test_beside_a_random_process_a_fifth_more_excess_is_no_growth_and_its_allowance_is_no_excuse():
    held_out, nominal = judged_by(1.0)
    slightly = judged_by(1.07)[1]  # 15 % more excess
    assert validation.error_growth(held_out, nominal, slightly).beyond_noise
    assert not validation.error_growth(held_out, nominal, judged_by(1.07, wander=0.3)[1]).beyond_noise
    assert validation.error_growth(held_out, nominal, judged_by(3.0, wander=50.0)[1]).beyond_noise


def test_a_free_run_that_leaves_the_range_is_worse_than_one_that_stays():
    held_out, nominal = judged_by(1.0)
    lost = Judgement(0.0, np.zeros(1), np.array([np.inf]), (), None)
    growth = validation.error_growth(held_out, nominal, lost)
    assert growth.beyond_noise
    assert math.isinf(growth.ratio.value)
    assert not validation.error_growth(held_out, lost, nominal).beyond_noise


@pytest.mark.parametrize(
    ("value", "ended"), [(-0.4995, True), (0.2, False), (0.0, False), (0.9945, False)], ids=["bound", "in", "no", "up"]
)
def test_an_amplitude_at_a_bound_is_no_answer_unless_it_is_what_it_is_by_nature(value, ended):
    c = parameter_coordinate(LIFT, 0, 0.0, math.inf, 1.0)
    fit = SimpleNamespace(coordinates=(c,), point=SimpleNamespace(value=lambda _: value))
    assert ends_at_bound([LIFT], fit, [LIFTED]) == (("axle_lift",) if ended else ())
    assert implausible([LIFT], fit, LIFTED) == (ended or value > 0.5)


def test_the_probability_of_refused_models_is_that_of_none_of_these():
    zero, alone = np.zeros(1), Interval(0.0, 0.0, 0.0)

    def model(share, *names):
        added = tuple(Alike((Hypothesis(n, "effect", (n,)),), (1.0,)) for n in names)
        return ComparedModel(added, None, 0.0, zero, alone, share, 0.8 * share)

    models = (model(0.9, "gust"), model(0.08, "lag"), model(0.02))
    some = Posterior(models, 0.2, zero).refusing(lambda m: m is models[0])
    assert some.none == pytest.approx(0.2 + 0.8 * 0.9)
    assert [m.share for m in some.models] == pytest.approx([0.8, 0.2, 0.0])
    assert [m.probability for m in some.models] == pytest.approx([0.064, 0.016, 0.0])
    everything = Posterior((*models[:1], model(0.0)), 0.2, zero).refusing(lambda m: True)
    assert everything.none == pytest.approx(0.2 + 0.8 * 0.9)
    assert (everything.models[0].added, everything.models[0].share) == ((), 1.0)


@pytest.mark.parametrize(("factor", "fitted"), [(0.042, True), (1.5, False)])
def test_what_is_large_by_nature_is_fitted_from_there_before_an_implausible_value_is_added(monkeypatch, factor, fitted):
    """The likelihood is larger where the stiffness is as stated: without the lift it stands for it."""
    mass = Parameter("mass", "m", "kg", 1.0, 1e6, "")
    stiffness = Parameter("stiffness", "C", "N/rad", 1.0, 1e6, "")
    parameters = [mass, stiffness, LIFT]
    names, stated = [p.name for p in parameters], np.array([1000.0, 5000.0, 0.0])
    c = parameter_coordinate(mass, 0, 1000.0, 0.2, 1.0)
    c = c.__class__(**{**c.__dict__, "stated_std": 0.2})
    best = SimpleNamespace(point=ParameterPoint(np.array([[1000.0], [2000.0], [0.0]]), np.zeros(0), np.zeros(0)))
    best.objective = 0.0
    heavy = SimpleNamespace(coordinates=(c,), objective=50.0, point=SimpleNamespace(value=lambda _: factor * 1000.0))
    augmented = SimpleNamespace(
        model=SimpleNamespace(parameters=parameters), row=names.index, stated=lambda: stated.copy()
    )
    begun = []

    def fit_all(models, *_):
        begun.extend((added, start().values[:, 0].tolist()) for added, start in models)
        return [SimpleNamespace(objective=90.0) for _ in models]

    fits = SimpleNamespace(
        augmented=augmented, free=("stiffness",), joined=lambda a, h: (*a, h), fit_all=fit_all, say=lambda _: None
    )
    monkeypatch.setattr(
        selection_round,
        "_log_likelihoods",
        lambda _, points: np.array([p.values[1:, 0] @ [1.0, 100.0] for p in points]),
    )
    tried = SelectionRound(fits, (), [best], "round 1")
    tried.promised = [
        SimpleNamespace(hypothesis=h, shapes=np.zeros(0), change_times=np.zeros((1, 0))) for h in (MASS, LIFTED)
    ]
    tried.fits = {MASS: heavy}
    tried.fit_large()
    assert begun == ([((LIFTED,), [1000.0, 5000.0, 0.99])] if fitted else [])
    assert (LIFTED in tried.fits) == fitted


def test_a_hundredth_of_the_first_error_is_nothing_that_is_missing():
    failed = SimpleNamespace(added=None, candidates=(SimpleNamespace(fitted=object(), bic=78.0),))
    plain = SimpleNamespace(coordinates=())
    found = SimpleNamespace(unmodelled=None, random_process=None)

    def named(before, after):
        judged = [Judgement(0.0, np.zeros(1), np.array([excess]), (), None) for excess in (before, after)]
        return SimpleNamespace(
            discrepancy=(),
            effects=("lifted_axle",),
            rounds=(failed,),
            before=judged[0],
            after=judged[1],
            final=plain,
            cut_short="",
            added=(),
        )

    assert verdict_of(named(177.0, 0.06), found, False) == "amended"
    assert verdict_of(named(4.0, 0.06), found, False) == "unresolved"
    assert verdict_of(named(4.0, 0.05), found, False) == "amended"  # within the noise of the sensors
