"""Random processes in a round: what they promise, alone and several at once, and which of them are fitted."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from harness.config import resolve_single
from harness.diagnosis.criteria import PRIORS
from harness.diagnosis.fitting import FittedHypothesis, Fitting, ParameterPoint
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import (
    ALL_PARAMETERS,
    SENSOR_DRIFTS,
    Hypothesis,
    coordinates,
    hypotheses,
    still_open,
)
from harness.diagnosis.selection import selection_round as rounds
from harness.diagnosis.selection.acceptance import beyond_belief
from harness.diagnosis.selection.posterior import log_size
from harness.diagnosis.selection.selection_round import random_scores
from harness.models.signals import SIGNALS

NAMES = ("drift_front", "drift_rear")
FRONT, REAR = (Hypothesis(n, "effect", (n,), random=True) for n in NAMES)
BOTH = Hypothesis(SENSOR_DRIFTS, "effect", NAMES, random=True, parts=(FRONT, REAR))
LAG = Hypothesis("lag", "effect", ("lag",))


def fits_of(likeliest):
    """Return a stand-in for the fits whose log-likelihood is a parabola about a size of each drift, over a grid."""

    def log_likelihoods(drives, points):
        return np.array([7.0 - sum((p.values[i, 0] - likeliest[i]) ** 2 for i in range(2)) for p in points])

    model = SimpleNamespace(parameters=[SimpleNamespace(grid=(1.0, 2.0, 4.0)) for _ in NAMES])
    return SimpleNamespace(
        augmented=SimpleNamespace(row=NAMES.index, log_likelihoods=log_likelihoods, model=model),
        fitting=SimpleNamespace(drives=[SimpleNamespace(measurements=np.zeros((9, 1)))], candidates=list),
    )


@pytest.mark.parametrize(
    ("likeliest", "sizes"), [((2.1, 3.7), (2.0, 4.0)), ((1.2, 0.1), (1.0, 0.0)), ((0.0, 0.0), (0.0, 0.0))]
)
def test_each_intensity_is_the_likeliest_of_its_grid_also_where_there_are_several(likeliest, sizes):
    point = ParameterPoint(np.zeros((2, 1)), np.zeros(0), np.zeros(0))
    front, rear, both = random_scores(fits_of(likeliest), point, [FRONT, REAR, BOTH])
    gains = [x**2 - (size - x) ** 2 for x, size in zip(likeliest, sizes, strict=True)]
    assert [front.gain, rear.gain, both.gain] == pytest.approx([*gains, sum(gains)])
    assert [*both.amplitudes] == [*front.amplitudes, *rear.amplitudes] == [*sizes]
    assert [front.freedom, both.freedom] == [1.0, 2.0]


def test_no_process_needs_no_likelihood():
    assert random_scores(None, None, []) == []


@pytest.mark.parametrize(
    ("gains", "refused", "fitted"),
    [
        ((100, 300, 400), False, {"lag", SENSOR_DRIFTS}),
        ((100, 300, 400), True, {"lag", SENSOR_DRIFTS, *NAMES}),  # and then each of them by itself
        ((10, 300, 320), False, {"lag", *NAMES[1:]}),  # no lead, so one of them drifts alone
        ((200, 200, 210), False, {"lag", *NAMES}),
    ],
)
def test_several_processes_are_fitted_in_place_of_each_where_they_lead(monkeypatch, gains, refused, fitted):
    asked = []
    tried = [SimpleNamespace(hypothesis=h, gain=g) for h, g in zip((LAG, FRONT, REAR, BOTH), (90, *gains), strict=True)]
    odds = {(h.kind, h.name): 0.0 for h in (LAG, FRONT, REAR)}
    monkeypatch.setattr(rounds, "log_odds", lambda _: odds)
    monkeypatch.setattr(rounds, "objections", lambda c, before: ["worse"] if refused else [])
    fitting = SimpleNamespace(noise_held=False)
    candidate_fits = SimpleNamespace(fitting=fitting, augmented=None, free=(), refuted=set(), always=(), say=print)
    candidate_fits.hypotheses, candidate_fits.scores_at = [LAG, FRONT, REAR, BOTH], lambda *_: tried
    one = rounds.SelectionRound(candidate_fits, (), [SimpleNamespace(point=None)], 1)
    monkeypatch.setattr(one, "fit", lambda scores: asked.extend(s.hypothesis.name for s in scores))
    for name, value in {"predicted_bic_gain": lambda s: s.gain, "judged": lambda s: s, "tried": list}.items():
        monkeypatch.setattr(one, name, value)
    monkeypatch.setattr(rounds.SelectionRound, "before", None)
    monkeypatch.setattr(one, "settled", lambda: True)
    one.rank()
    one.fit_worthy()
    assert sorted(asked) == sorted(fitted)


@pytest.mark.parametrize(
    ("refused", "changed", "fitted"), [(True, True, "abc"), (False, True, "a"), (True, False, "a")]
)
def test_a_lead_that_the_held_out_drives_refuse_hides_no_change(monkeypatch, refused, changed, fitted):
    """A bias of the day promises 150 units; what stays promises 40 and 30, which is less than half of that."""
    named = [Hypothesis(name, "effect", (name,), changed=changed) for name in "abcd"]
    scores = [SimpleNamespace(hypothesis=h, gain=g) for h, g in zip(named, (150, 40, 30, 20), strict=True)]
    monkeypatch.setattr(rounds, "likelier_held_out", lambda c, before: not refused)
    monkeypatch.setattr(rounds, "distinct", list)
    monkeypatch.setattr(rounds.SelectionRound, "before", None)
    one = rounds.SelectionRound(None, (), [None], "round 1")
    one.promised, one.fits = scores, {named[0]: None}
    monkeypatch.setattr(one, "fit", lambda chosen: one.fits.update({s.hypothesis: None for s in chosen}))
    for name, value in {"predicted_bic_gain": lambda s: s.gain, "judged": lambda s: s}.items():
        monkeypatch.setattr(one, name, value)
    one.fit_behind_refused()
    assert "".join(h.name for h in one.fits) == fitted


@pytest.fixture(scope="module")
def truck():
    stated = {"vehicle": "semitrailer", "parameters": "ziaukas_2023", "tyre": "magic_formula"}
    spec = resolve_single({**stated, "sensors": "test_vehicle_inertial", "integrator": "rk4"}, "test")
    return AugmentedModel(spec, set(SIGNALS), jobs=1)


def test_a_parameter_is_sought_where_it_is_possible_beside_the_others(truck):
    """A score that asks for a trailer shorter than where its kingpin is promises what is gained up to there."""
    values = truck.stated()
    lower, upper = truck.possible_range("trailer_length", values)
    assert lower == pytest.approx(values[truck.row("kingpin_from_rear")], abs=1e-6)
    assert upper == truck.model.parameters[truck.row("trailer_length")].upper
    mass = truck.model.parameters[truck.row("trailer_mass")]
    assert truck.possible_range("trailer_mass", values) == (mass.lower, mass.upper)


def test_a_fit_starts_where_values_are_possible_together(truck):
    """From a trailer that ends behind its kingpin a fit goes nowhere, and every score there promises nothing."""
    possible, shorter = (truck.stated()[:, None] for _ in range(2))
    shorter[truck.row("trailer_length")] = 0.99 * shorter[truck.row("kingpin_from_rear")]
    points = [ParameterPoint(values, np.zeros(0), np.zeros(0)) for values in (shorter, possible)]
    fitting = SimpleNamespace(augmented=truck, driveable=SimpleNamespace(unstable_from=lambda _: math.inf))
    assert Fitting.best(fitting, points) is points[1]
    assert Fitting.best(fitting, points[:1]) is points[0]


def test_where_an_axle_is_may_be_off_like_other_lengths_though_it_may_be_at_the_rear_wall(truck):
    """Beside many wrong values one that was added besides, 23 % off, is none that anybody would have measured."""
    named = {h.name: h for h in hypotheses(truck, ())}
    many, axle = named[ALL_PARAMETERS], named["axle_23_from_rear"]
    stated, row = truck.spec.values["axle_23_from_rear"], truck.row("axle_23_from_rear")
    assert truck.stated_std("axle_23_from_rear") == pytest.approx(PRIORS.length * stated)
    assert truck.stated_std("reference_from_cog") == math.inf  # ahead of the CoG or behind it
    assert {"axle_23_from_rear", "tractor_cog_to_kingpin"} < set(many.amplitudes)
    assert "reference_from_cog" not in many.amplitudes
    values = truck.stated()[:, None]
    values[row] *= 0.77
    for added, said in (((axle,), ""), ((many, axle), "axle 23 from rear 0.77"), ((many,), "axle 23 from rear 0.77")):
        fitted = FittedHypothesis(
            coordinates(truck, (), added, 1), ParameterPoint(values, np.zeros(0), np.zeros(0)), 0.0, 0.0
        )
        assert beyond_belief(fitted, added) == said
        assert log_size(fitted, added) == pytest.approx(-0.5 * (0.23 / PRIORS.length) ** 2)


def test_a_truck_with_two_gyroscopes_has_one_hypothesis_that_both_drift(truck):
    tried = hypotheses(truck, ())
    (both,) = (h for h in tried if h.name == SENSOR_DRIFTS)
    assert [h.name for h in both.single] == ["sensor_drift@yaw_rate_tractor", "sensor_drift@yaw_rate_trailer"]
    assert all(h in tried for h in both.parts)
    assert both.random
    assert both.many
    assert still_open(both, set(both.amplitudes[:1])) is None  # the other one is a hypothesis of its own


def test_states_of_random_processes_stand_behind_those_of_the_effects_of_the_model():
    """The bank's state comes with the vehicle, that of a relaxing tyre only with its axle."""
    stated = {"vehicle": "car", "parameters": "govindarajan_2018", "tyre": "linear", "effects": ["tyre_relaxation"]}
    spec = resolve_single({**stated, "sensors": "car_series"}, "test")
    augmented = AugmentedModel(spec, {"steering_wheel_angle", "speed", "yaw_rate", "lateral_acceleration"}, jobs=1)
    own = len(spec.model().states)
    assert (augmented._start_variance()[own:] > 0).all()
    assert augmented.nx > own
