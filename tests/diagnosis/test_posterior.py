"""Probabilities of models: known answers of linear Gaussian models, equivalents, intervals, and what is predicted."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import stats
from scipy.signal import lfilter
from scipy.stats import chi2, multivariate_normal

from harness.diagnosis.criteria import PRIORS
from harness.diagnosis.fitting import FittedHypothesis, Fitting, ParameterPoint, block_sums
from harness.diagnosis.innovations.prediction import Ahead, Prediction
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, Hypothesis, coordinates, hypotheses
from harness.diagnosis.selection import posterior as p
from harness.diagnosis.selection.acceptance import beyond_belief
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.posterior import kind_of, log_odds, log_size, log_some_of, log_stand_in
from harness.identification.coordinates import Coordinate
from support.driven_car import FREE, driven


def walk(samples, q, r, seed):
    """Return measurements of a random walk, with their joint covariance."""
    rng = np.random.default_rng(seed)
    y = np.cumsum(rng.normal(0.0, math.sqrt(q), samples)) + rng.normal(0.0, math.sqrt(r), samples)
    k = np.arange(1, samples + 1)
    return y, q * np.minimum(k[:, None], k) + r * np.eye(samples)


def one_step(y, q, r):
    """Return the one-step log densities of a random walk's Kalman filter (Simon 2006, 5.1)."""
    x, P, found = 0.0, 0.0, []
    for value in y:
        P += q
        S = P + r
        found.append(-0.5 * ((value - x) ** 2 / S + math.log(2 * math.pi * S)))
        x, P = x + P / S * (value - x), P * r / S
    return np.array(found)


def test_bayes_factors_of_linear_gaussian_models_are_the_analytic_ones(monkeypatch):
    """The one-step densities add up to the joint density, and blocks that agree leave nothing to chance."""
    y, covariance = walk(200, 0.1, 1.0, 3)
    choices = [(0.1, 1.0), (0.12, 1.0), (0.1, 1.05)]
    joint = [multivariate_normal(np.zeros(200), walk(200, q, r, 3)[1]).logpdf(y) for q, r in choices]
    steps = np.array([one_step(y, q, r).sum() for q, r in choices])
    assert steps == pytest.approx(np.array(joint), abs=1e-8)
    priors = np.log([0.5, 0.3, 0.2])
    exact = np.exp(joint - np.max(joint)) * np.exp(priors)
    found = p.probabilities(priors, np.repeat(steps[:, None] / 20, 20, axis=1))
    assert found == pytest.approx(exact / exact.sum(), rel=1e-9)
    assert np.linalg.det(covariance) > 0


def test_models_that_predict_alike_share_the_mass_by_their_priors():
    block = np.random.default_rng(0).normal(0.0, 50.0, 24)
    found = p.probabilities(np.log([0.3, 0.1]), np.array([block, block]))
    assert found == pytest.approx([0.75, 0.25])


def test_blocks_that_disagree_leave_it_open_and_a_model_that_cannot_be_driven_is_out():
    rng = np.random.default_rng(1)
    same, noisy = np.zeros(24), rng.normal(0.0, 100.0, 24)
    noisy += (120.0 - noisy.sum()) / 24  # ahead by a quarter of its standard error of some 490
    never = np.full(24, -np.inf)
    found = p.probabilities(np.zeros(3), np.array([same, noisy, never]))
    assert found[2] == 0.0
    assert 0.5 < found[1] < 0.75
    sure = p.probabilities(np.zeros(2), np.array([same, same + 5.0]))
    assert sure[1] > 0.999999


def test_the_interval_of_a_difference_covers():
    """Of the sums of 24 blocks drawn again and again, a 90 % interval holds the expected one in 90 % of the cases."""
    rng = np.random.default_rng(2)
    inside = []
    for _ in range(400):
        found = p.interval(rng.normal(2.0, 10.0, 24))
        inside.append(found.lower <= 48.0 <= found.upper)
        assert found.lower <= found.value <= found.upper
    assert 0.84 <= np.mean(inside) <= 0.94
    assert p.interval(np.array([1.0, -np.inf])).upper == -math.inf


def test_blocks_hold_every_sample_once():
    time = 0.01 * np.arange(1, 12_400)
    found = block_sums(np.ones((len(time), 2)), time)
    assert found.shape == (25, 2)
    assert found.sum(axis=0) == pytest.approx(len(time))
    assert found[:-1] == pytest.approx(500, abs=1)
    assert len(block_sums(np.ones((3, 1)), time[:3])) == 1


def test_how_soon_a_model_forgets_the_first_state_is_no_evidence():
    drives = [SimpleNamespace(time=0.01 * np.arange(n)) for n in (2001, 401)]
    densities = [np.ones((2000, 1)), np.ones((400, 1))]
    densities[0][:300] = 1e3
    found = p.by_block(densities, drives, penalty=4.0)
    assert found[:, 0] == pytest.approx([499.0, 499.0, 499.0, 399.0], abs=2)  # of a short drive all there is
    free = p.by_block(densities, drives)
    assert free.sum() - found.sum() == pytest.approx(4.0)  # what was fitted costs the same however it is cut
    np.testing.assert_allclose(free - found, 1.0)


def ahead(square, samples=4000, seed=0):
    """Return predictions of one signal at two horizons whose squared errors are off by a factor each."""
    squares = np.random.default_rng(seed).chisquare(1, (samples, len(square))) * square
    return Ahead(-0.5 * (squares + math.log(2 * math.pi)), squares, np.ones(samples, dtype=int))


def innovations(drift, seed, samples=12_000):
    """Return white innovations of two signals at 100 Hz, a Gauss-Markov process of 1 s beside them in the first."""
    rng = np.random.default_rng(seed)
    found = rng.standard_normal((samples, 2))
    slow = lfilter([math.sqrt(1 - 0.99**2)], [1.0, -0.99], rng.standard_normal(samples))
    return found + np.column_stack([drift * slow, np.zeros(samples)])


@pytest.mark.parametrize(("drift", "wins"), [(0.0, False), (0.02, False), (0.15, True), (0.5, True)])
def test_none_of_these_wins_where_the_innovations_are_coloured_and_loses_where_they_are_white(drift, wins):
    fitted, held_out = ([innovations(drift, seed)] for seed in (1, 2))
    gain = p.coloured(fitted, held_out)
    found = p.probabilities(np.log([1.0, PRIORS.odds["none"]]), np.array([[0.0], [gain]]))
    assert (found[1] > 0.9) == wins
    assert wins or found[1] < 0.05


@pytest.mark.parametrize("frequency", [0.5, 2.0, 10.0, 30.0])
def test_a_vibration_of_one_output_shows_beside_others_that_are_white(frequency):
    """As of a wheel out of balance, at any frequency; sums over a tenth of a second do not see it at 10 Hz."""
    time = 0.01 * np.arange(12_000)
    here, there = (2 * np.pi * frequency * time * (1 + swept * time) for swept in (1e-3, -1e-3))
    wave = [np.column_stack([np.sin(phase), np.zeros(len(time))]) for phase in (here, there)]
    gain = p.coloured([innovations(0.0, 5) + wave[0]], [innovations(0.0, 6) + wave[1]])
    assert gain > 20


def test_noise_that_was_fitted_to_a_vibration_is_too_large_at_other_frequencies():
    """The vibration moves with the speed, from 10 Hz to 15 Hz; how little is left below shows it in both drives."""
    time = 0.01 * np.arange(12_000)
    here, there = (
        0.4 * lfilter([1.0, -0.9], [1.0], innovations(0.0, seed)[:, [0]], axis=0)
        + np.sin(2 * np.pi * frequency * time)[:, None]
        for seed, frequency in ((7, 10.0), (8, 15.0))
    )
    assert p.octaves([here[:, 0]], 3)[0][2] > PRIORS.misfit > p.octaves([there[:, 0]], 3)[0][2]
    assert p.coloured([here], [there]) > 100
    assert p.coloured([here], [innovations(0.0, 8)[:, :1]]) < 0  # where the held-out drives have all of it


def test_what_is_coloured_in_the_fitted_drives_alone_is_no_evidence():
    assert p.coloured([innovations(0.5, 1)], [innovations(0.0, 2)]) < 0


def test_what_was_found_beside_a_model_has_its_odds_there():
    """Against hand-made odds: the second model is e^-2 as likely as the first one, what is unlisted beside it e^3."""
    fits = [
        FittedHypothesis((), ParameterPoint(np.zeros((0, 1)), np.zeros(0), np.zeros(0)), 0.0, 0.0) for _ in range(3)
    ]
    priors, differences = (-1.0, -2.0), (0.0, -1.0)
    density, each = np.zeros(5), np.exp(np.add(priors, differences))
    share = each / each.sum()
    models = tuple(
        p.ComparedModel((), fit, prior, density, p.Interval(d, d, d), s, 0.9 * s)
        for fit, prior, d, s in zip(fits, priors, differences, share, strict=False)
    )
    found = p.Posterior(models, 0.1, density)
    said = found.with_unlisted(fits[1], 3.0)
    odds = 0.9 * share[1] * PRIORS.odds["none"] * math.exp(3.0)
    assert said.none == pytest.approx((0.1 + odds) / (1.0 + odds))
    assert [m.probability for m in said.models] == pytest.approx([0.9 * s / (1.0 + odds) for s in share])
    assert [m.share for m in said.models] == [m.share for m in models]
    assert found.with_unlisted(fits[1], 1e5).none == 1.0
    assert found.with_unlisted(fits[2], 3.0) == found  # none of these
    none = dataclasses.replace(found, models=tuple(dataclasses.replace(m, probability=0.0) for m in models), none=1.0)
    assert none.with_unlisted(fits[1], 3.0) == none


def test_ordinates_of_white_noise_are_exponential_across_gaps_and_have_its_power():
    gaps = innovations(0.0, 3)[:, 0]
    gaps[::3] = np.nan
    gaps[:60] = np.nan
    assert stats.kstest(p.ordinates(gaps), "expon").pvalue > 0.01
    odd = innovations(0.0, 4, 501)[:, 0]
    odd -= odd.mean()
    assert 2 * p.ordinates(odd).sum() == pytest.approx(odd @ odd)  # Parseval


@pytest.mark.parametrize("samples", [0, 1, 2, 3])
def test_an_output_that_was_hardly_measured_says_nothing(samples):
    fitted, held_out = innovations(0.0, 1), innovations(0.0, 2)
    both = p.coloured([fitted[:, :1]], [held_out[:, :1]])
    held_out[samples:, 1] = np.nan
    assert p.coloured([fitted], [held_out]) == pytest.approx(both, abs=1.0)


def test_octaves_count_down_from_the_nyquist_frequency():
    wave = np.sin(2 * np.pi * 0.2 * np.arange(1000))  # at 0.4 of that frequency
    mean, count = p.octaves([wave, wave[:500]], 2)
    assert list(count) == [249 + 124, 125 + 63, 125 + 62]
    assert list(mean > 1.0) == [False, True, False]


def test_the_evidence_is_that_of_exponential_ordinates():
    loud, quiet = (
        scale * np.random.default_rng(seed).standard_normal((120, 1)) for scale, seed in ((2.0, 1), (1.5, 2))
    )
    factor, seen = p.ordinates(loud[:, 0]).mean(), p.ordinates(quiet[:, 0])
    exact = stats.expon(scale=factor).logpdf(seen) - stats.expon().logpdf(seen)
    assert p.coloured([loud], [quiet]) == pytest.approx(exact.sum())


def test_what_is_missing_far_ahead_is_likelier_by_the_density_of_wider_predictions():
    def by_block(scale, seed):
        errors = scale * np.random.default_rng(seed).standard_normal((6, 50, 2))  # blocks, samples, outputs
        return errors, (errors**2).sum(axis=(1, 2))

    (_, narrow), (_, wide), (errors, there) = by_block(1.0, 1), by_block(2.0, 2), by_block(1.8, 3)
    seen = np.full(6, 100.0)
    fitted, held_out = (np.column_stack([narrow, narrow, far, seen]) for far in (wide, there))
    factor = np.sqrt(wide.sum() / seen.sum())
    exact = (stats.norm(scale=factor).logpdf(errors) - stats.norm.logpdf(errors)).sum(axis=(1, 2))
    assert p.farther(fitted, held_out) == pytest.approx(exact / 3)  # of three horizons the last one shows it
    assert (exact > 0).all()
    assert (p.farther(held_out, np.column_stack([narrow, narrow, narrow, seen])) < 0).all()
    right = np.column_stack([narrow, narrow, narrow, seen])
    assert p.farther(right, held_out) == pytest.approx(np.zeros(6))  # the fitted drives do not show it
    first = np.column_stack([wide, narrow, narrow, seen])
    assert p.farther(first, first) == pytest.approx(np.zeros(6))  # the spectrum of the innovations judges that
    lost = held_out.copy()
    lost[2, 2] = np.inf  # a prediction that left its range
    assert p.farther(fitted, lost) == pytest.approx(np.zeros(6))


def test_coverage_is_that_of_the_chi_square_region():
    found = p.coverage([ahead((1.0, 4.0), 20_000)])
    assert found == pytest.approx([0.95, chi2.cdf(chi2.ppf(0.95, 1) / 4.0, 1)], abs=0.01)


def model(name, share, alike=()):
    names = (name, *alike)
    same = p.Alike(tuple(Hypothesis(n, "effect", (n,)) for n in names), (0.75, 0.25)[: len(names)] if alike else (1.0,))
    return p.ComparedModel((same,), None, 0.0, np.zeros(5), None, share, 0.8 * share)


def test_the_confusable_set_is_the_smallest_with_its_mass():
    found = p.Posterior((model("lag", 0.7), model("delay", 0.25, ("ratio",)), model("gain", 0.05)), 0.2, np.zeros(5))
    assert [m.added[0].hypotheses[0].name for m in found.confusable()] == ["lag", "delay"]
    assert len(found.confusable(0.5)) == 1
    assert len(found.confusable(0.96)) == 3
    inclusion = {h.name: round(v, 6) for h, v in found.inclusion().items()}
    assert inclusion == {"lag": 0.56, "delay": 0.15, "ratio": 0.05, "gain": 0.04}


def test_the_odds_of_a_kind_are_shared_and_places_share_those_of_their_effect(augmented):
    tried = [h for h in hypotheses(augmented, FREE) if not h.parts]  # which never stands in a model itself
    odds = log_odds(tried)
    for kind, together in PRIORS.odds.items():
        of_kind = [h for h in tried if kind_of(h) == kind]
        assert not of_kind or sum(math.exp(odds[h.kind, h.name]) for h in of_kind) == pytest.approx(together)
    places = [h for h in tried if h.name.split("@")[0] == "tyre_force_offset"]
    assert len(places) > 1
    assert sum(math.exp(odds[h.kind, h.name]) for h in places) == pytest.approx(
        math.exp(odds["effect", "steering_lag"])
    )


def test_a_stated_value_off_by_a_factor_costs_by_its_prior():
    mass = Hypothesis("mass", "parameter", ("mass",))
    c = Coordinate(
        "mass", "parameter", (0,), math.log(1000.0), math.log(10.0), math.log(1e5), True, "kg", stated_std=0.2
    )
    fitted = SimpleNamespace(coordinates=(c,), point=SimpleNamespace(value=lambda _: 1800.0))
    assert log_size(fitted, (mass,)) == pytest.approx(-0.5 * (math.log(1.8) / 0.2) ** 2)
    assert log_size(fitted, (Hypothesis("lag", "effect", ("mass",)),)) == 0.0


def test_an_intensity_that_grows_as_on_no_other_day_counts_against_a_model():
    """A gyroscope that wanders thrice as far as earlier drives showed costs what the fit paid for that."""
    c = Coordinate("drift", "intensity", (0,), math.log(1e-3), math.log(1e-6), 0.0, True, "rad/s")
    for prior, expected in ((PRIORS.intensity, -0.5 * (math.log(3.0) / PRIORS.intensity) ** 2), (math.inf, 0.0)):
        known = dataclasses.replace(c, prior=prior)
        fitted = SimpleNamespace(coordinates=(known,), point=SimpleNamespace(value=lambda _: 3e-3))
        assert log_size(fitted, ()) == pytest.approx(expected)


def test_what_the_parameter_set_states_is_how_far_a_value_may_be_off(augmented, monkeypatch):
    """A wheelbase that is known to a percent is not off by five, alone or with many others."""
    tried = {h.name: h for h in hypotheses(augmented, FREE)}
    one, many = tried["cog_to_rear_axle"], tried[ALL_PARAMETERS]
    stated, row = augmented.spec.values["cog_to_rear_axle"], augmented.row("cog_to_rear_axle")
    usual = {c.name: c for c in coordinates(augmented, FREE, (many,), 1)}
    assert usual["cog_to_rear_axle"].prior == pytest.approx(PRIORS.length)
    assert usual["yaw_inertia"].prior == pytest.approx(PRIORS.stated)
    monkeypatch.setattr(augmented, "_stated_std", {"cog_to_rear_axle": 0.01 * stated})
    values = augmented.stated()[:, None]
    values[row] *= math.exp(0.05)
    for added, prior in ((one, math.inf), (many, 0.01)):
        moved = coordinates(augmented, FREE, (added,), 1)
        fitted = FittedHypothesis(moved, ParameterPoint(values, np.zeros(0), np.zeros(0)), 0.0, 0.0)
        assert {c.name: c.prior for c in moved}["cog_to_rear_axle"] == pytest.approx(prior)
        assert log_size(fitted, (added,)) == pytest.approx(-0.5 * 5.0**2)
        assert bool(beyond_belief(fitted, (added,))) == (added is many)


def test_some_of_many_implausible_values_stand_for_something_unlisted():
    """The odds are a ratio of integrals over the values, here by quadrature; what is open says nothing."""
    many = Hypothesis(ALL_PARAMETERS, "parameter", ("mass", "length"))
    grip = Coordinate("grip", "parameter", (0,), 0.0, -9.0, 9.0, True, "")
    mass = Coordinate("mass", "parameter", (1,), 0.0, -9.0, 9.0, True, "kg", prior=0.2, stated_std=0.2)
    length = Coordinate("length", "parameter", (2,), 0.0, -9.0, 9.0, True, "m", prior=0.01, stated_std=0.01)
    data = np.array([[400.0, 90.0, 0.0], [90.0, 150.0, 0.0], [0.0, 0.0, 0.0]])
    of_mass = 150.0 - 90.0**2 / 400.0

    def odds(likeliest, besides=()):
        """Return those of a likelihood whose maximum over the mass is there, the grip at zero."""
        held = dataclasses.replace(mass, prior=math.inf) if besides else mass  # added alone it has none
        weight = held.prior**-2
        z = {"grip": 0.0, "mass": of_mass * likeliest / (of_mass + weight), "length": 0.0}
        fitted = SimpleNamespace(
            coordinates=(grip, held, length), point=SimpleNamespace(value=lambda c: math.exp(z[c.name]))
        )
        found = log_stand_in(fitted, (many, *besides), data + np.diag([0.0, weight, 0.01**-2]))
        at = np.linspace(-9.0, 9.0, 200_001)
        likelihood = np.exp(-0.5 * of_mass * (at - likeliest) ** 2)
        wide, narrow = (likelihood @ stats.norm.pdf(at, scale=0.2 * k) for k in (PRIORS.implausible, 1.0))
        either = (wide / narrow + 1.0 + wide / narrow) / 3.0  # the mass, the length or both
        assert found == pytest.approx(math.log(either), abs=1e-6)
        return found

    assert odds(0.1) < odds(0.3) < 0.0 < odds(0.8) < odds(2.0)
    assert odds(0.8, (Hypothesis("mass", "parameter", ("mass",)),)) == pytest.approx(odds(0.8))


def test_one_implausible_value_among_many_plausible_ones_is_enough():
    gains = np.array([-1.0] * 17)
    alone, beside = log_some_of(gains), log_some_of(np.append(gains, 12.0))
    assert alone < -5.0
    assert beside > 4.0
    assert log_some_of(np.array([3.0])) == pytest.approx(3.0)
    assert log_some_of(np.full(4, 800.0)) == pytest.approx(3200.0 - math.log(15.0))
    assert log_some_of(np.full(4, -800.0)) == pytest.approx(-800.0 + math.log(4.0 / 15.0))


@pytest.fixture(scope="module")
def predicted(augmented):
    drive = augmented.drive(driven(77, duration=30.0), "drive")
    fitting = Fitting(augmented, [drive], first_variances(augmented, [drive]))
    (held,) = fitting.candidates([fitting.first()])
    return drive, held, Prediction(augmented).of(drive, held, [1, 10, 100, math.inf])


def test_the_first_horizon_is_the_filter(augmented, predicted):
    """But for where its covariance is linearised: of a model without additions the whole is the nominal one."""
    drive, held, found = predicted
    run = augmented.run(drive, held)
    assert found.densities[:, 0].sum() == pytest.approx(run.log_likelihood, abs=1.0)
    assert found.squares[:, 0].sum() == pytest.approx(np.nansum(run.whitened[1:] ** 2), rel=5e-3)


def test_the_last_horizon_is_the_free_run(augmented, predicted):
    """Where its covariance is that of the measurements, its squared errors are those of the free run."""
    drive, held, _ = predicted
    quiet = dataclasses.replace(held, process=1e-30 * held.process)
    exact = dataclasses.replace(drive, first_variance=1e-30 * drive.first_variance)
    found = Prediction(augmented).of(exact, quiet, [1, math.inf])
    free = augmented.free_run(exact, held.values[:, 0]).outputs
    squares = ((drive.measurements - free)[1:] ** 2 / held.measurement[:, 0]).sum(axis=1)
    assert found.squares[:, 1] == pytest.approx(squares, rel=1e-6)


def test_a_horizon_begins_again_where_the_filter_is(augmented, predicted):
    """Behind a restart the first prediction is that of the filter; after that it is less certain or as certain."""
    drive, _, found = predicted
    for column, horizon in ((1, 10), (2, 100)):
        first = np.arange(horizon, len(found.densities), horizon)
        assert found.densities[first, column] == pytest.approx(found.densities[first, 0], rel=1e-12)
        assert not np.allclose(found.densities[first + 5, column], found.densities[first + 5, 0], rtol=1e-6)
    assert np.isfinite(drive.measurements).all()


def test_a_long_prediction_has_the_covariance_of_the_whole_model(augmented):
    """Without the roll steer that keeps it stable this car spins at 20 m/s, and its covariance would grow for ever."""
    values = {"stiffness_peak_rear": 80e3, "roll_steer_front": -0.012, "roll_steer_frequency_front": 4.5}
    drive = augmented.drive(driven(78, ("roll_steer@front",), duration=30.0, **values), "drive")
    fitting = Fitting(augmented, [drive], first_variances(augmented, [drive]))
    first = fitting.first()
    for name, value in values.items():
        first.values[augmented.row(name)] = value
    assert fitting.admits(first)
    (held,) = fitting.candidates([first])
    alone = first.values[:, 0].copy()
    alone[augmented.row("roll_steer_front")] = 0.0
    assert math.isfinite(fitting.driveable.unstable_from(alone))
    found = Prediction(augmented).of(drive, held, [1, 1000, math.inf])
    each = found.densities.mean(axis=0)
    assert each[1] > each[0] - 2.0
    assert each[2] > each[0] - 2.0
    assert (found.squares.mean(axis=0) < 2 * found.seen.mean()).all()


def test_what_none_of_the_models_can_be_driven_at_says_nothing():
    blocks = np.zeros((3, 4, 3))
    blocks[0, :, 0], blocks[1, :, 0], blocks[2, :, 0] = 1.0, 2.0, 3.0
    blocks[:, 2, 2] = -np.inf
    blocks[2, 1, 1] = -np.inf
    found = p.shared_horizons(blocks, np.ones(blocks.shape[2]))
    assert found[:2] == pytest.approx(np.array([[0.5] * 4, [1.0] * 4]))
    assert not np.isfinite(found[2]).all()
    assert p.shared_horizons(blocks[2:], np.ones(blocks.shape[2])) == pytest.approx(np.full((1, 4), 3.0))
