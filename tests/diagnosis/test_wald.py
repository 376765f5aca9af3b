"""Without an addition: what is lost, by the curvature of the likelihood, and what would do the same in its place."""

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

from harness.common.statistics import Interval
from harness.diagnosis.fitting import Fitting, ParameterPoint
from harness.diagnosis.model.hypotheses import Hypothesis, hypotheses
from harness.diagnosis.result.posterior_record import _alike
from harness.diagnosis.selection.acceptance import ratio
from harness.diagnosis.selection.candidate_fits import CandidateFits
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.posterior import Alike, ComparedModel
from harness.diagnosis.selection.score_test import ScoreTest
from harness.diagnosis.selection.validation import HeldOut
from harness.diagnosis.selection.wald import Curvature
from harness.identification.coordinates import Coordinate
from support.driven_car import FREE, driven


@pytest.fixture(scope="module")
def fits(augmented):
    """Two drives with a steering offset of five standard errors or so, whose gyroscope reads what is there."""
    drives = [
        augmented.drive(driven(i, ["steering_offset"], 40.0, steering_offset=3e-4), f"drive {i}") for i in (70, 71)
    ]
    variances = first_variances(augmented, drives)
    fitting = Fitting(augmented, drives[:1], variances, noise_held=True, driven=drives)
    return CandidateFits(fitting, HeldOut(augmented, drives[1:], variances), FREE, lambda _: None)


def losses(fits, added, fitted):
    """Return what is predicted to be lost without each addition."""
    curvature = Curvature(fits, fitted)
    return {h: curvature.without((h,), tuple(k for k in added if k != h)).loss for h in added}


def test_the_predicted_loss_is_that_of_a_fit_without_it(augmented, fits):
    known = {h.name: h for h in hypotheses(augmented, FREE)}
    offset, bias, drift = (known[n] for n in ("steering_offset", "sensor_bias@yaw_rate", "sensor_drift@yaw_rate"))
    first = fits.fitting.first()
    both = fits.fit((offset, bias), first)
    predicted = losses(fits, (offset, bias), both)
    for h, other in ((offset, bias), (bias, offset)):
        without = fits.fit((other,), first)
        lost = fits.bic(both.objective - without.objective, 1)
        assert predicted[h] == pytest.approx(lost, rel=0.1, abs=1.5)
    assert predicted[offset] > 10
    assert predicted[bias] < 2
    free = CandidateFits(
        Fitting(augmented, fits.fitting.drives, fits.held_out.variances), fits.held_out, FREE, lambda _: None
    )
    both, without = (free.fit(added, first) for added in ((offset, bias), (bias,)))
    most = losses(free, (offset, bias), both)[offset]
    assert 0.5 * most < free.bic(both.objective - without.objective, 1) < most  # noise takes up a part
    process = fits.fit((offset, drift), first)
    assert losses(fits, (offset, drift), process)[drift] == fits.bic(0.0, 1)  # nothing is known of it
    assert losses(fits, (), fits.fit((), first)) == {}


def test_a_fit_without_it_begins_where_everything_else_is_predicted_to_go(augmented, fits):
    """What was given to the bias of the gyroscope goes to the offset of the steering, and nothing is left to fit."""
    known = {h.name: h for h in hypotheses(augmented, FREE)}
    offset, bias = (known[n] for n in ("steering_offset", "sensor_bias@yaw_rate"))
    both, less = (fits.fit(added, fits.fitting.first()) for added in ((offset, bias), (offset,)))
    plain, there = Curvature(fits, both).without((bias,), (offset,)).points
    rows = [augmented.row(n) for n in bias.shared]
    for point in (plain, there):
        np.testing.assert_array_equal(point.values[rows, 0], augmented.stated()[rows])
    np.testing.assert_array_equal(np.delete(plain.values, rows, axis=0), np.delete(both.point.values, rows, axis=0))
    assert there.value(both.coordinates[-2]) == pytest.approx(less.point.value(less.coordinates[-1]), rel=1e-3)
    lost = [less.log_likelihood - fits.fitting.log_likelihood(point) for point in (plain, there)]
    assert abs(lost[1]) < 0.1 * lost[0]


def test_what_the_columns_promise_without_an_addition_is_what_those_of_a_fit_without_it_do(augmented, fits):
    """Also of itself, which gains what it would lose, and of what begins some time: nothing is to be computed again."""
    known = {h.name: h for h in hypotheses(augmented, FREE)}
    offset, bias = (known[n] for n in ("steering_offset", "sensor_bias@yaw_rate"))
    tried = [offset, *(known[n] for n in ("tyre_force_offset@front", "steering_lag", "yaw_inertia", "crosswind"))]
    both, less = (fits.fit(added, fits.fitting.first()) for added in ((offset, bias), (bias,)))
    test, alone = ScoreTest(fits.fitting, both), ScoreTest(fits.fitting, less)
    test.of([h for h in tried if h != offset])
    found = test.without(offset, offset.shared, fits.without(both.point, (offset,), (bias,))).of(tried)
    for score, wanted in zip(found, alone.of(tried), strict=True):
        assert score.gain == pytest.approx(wanted.gain, rel=0.05, abs=0.5), score.hypothesis.name
        np.testing.assert_allclose(score.amplitudes, wanted.amplitudes, rtol=0.1, atol=2.0 * wanted.error.max())
    assert found[0].gain > 10
    assert fits.bic(found[0].gain, 1) == pytest.approx(losses(fits, (offset, bias), both)[offset], rel=0.02)


@pytest.mark.parametrize(
    ("common", "loss"),
    [
        (3.0, 0.5 * (4.0 - 3.0**2 / 4.0)),  # the other one goes up by 0.75, as it may
        (-3.0, 0.5 * (4.0 + 4.0 * 0.1**2 - 2.0 * 3.0 * 0.1)),  # and down by 0.1 to its bound, where 0.75 were likelier
        (math.inf, 0.0),  # nothing is known of it
    ],
)
def test_what_is_left_goes_no_further_than_its_bounds(common, loss):
    one, other = (
        Coordinate(n, "parameter", (i,), 0.0, i - 1.0, 9.0, False, "s") for i, n in enumerate(("one", "other"))
    )
    h = Hypothesis("late", "effect", ("one",))
    at = {"one": 1.0, "other": 0.1}
    fits = SimpleNamespace(
        fitting=SimpleNamespace(information=lambda _: np.array([[4.0, common], [common, 4.0]]), drives=[None]),
        augmented=SimpleNamespace(stated=lambda: np.zeros(2)),
        bic=lambda gain, freedom: 2.0 * gain,
        without=lambda point, gone, rest: ParameterPoint(np.zeros((2, 1)), np.zeros(0), np.zeros(0)),
    )
    fitted = SimpleNamespace(coordinates=(one, other), point=SimpleNamespace(value=lambda c: at[c.name]))
    assert losses(fits, (h,), fitted)[h] == pytest.approx(2.0 * loss)


def test_the_ratio_of_two_hypotheses_is_that_of_what_they_change(augmented, fits):
    known = {h.name: h for h in hypotheses(augmented, FREE)}
    tried = [known["steering_offset"], known["yaw_inertia"]]
    offset, inertia = ScoreTest(fits.fitting, fits.fit((), fits.fitting.first())).of(tried)
    change = inertia.amplitudes[0] - augmented.stated()[augmented.row("yaw_inertia")]
    assert offset.amplitudes[0] != 0.0
    assert ratio(inertia, offset) == pytest.approx(change / offset.amplitudes[0])


def test_what_does_the_same_as_a_stated_value_that_is_off_acts_from_its_own_nominal_value(augmented, fits):
    fitted = fits.fit((), fits.fitting.first())
    name, values = fitted.coordinates[0].name, fitted.point.values.copy()
    stated = augmented.stated()[augmented.row(name)]
    values[augmented.row(name)] = 1.1 * stated
    fitted = replace(fitted, point=replace(fitted.point, values=values))
    off = Hypothesis(name, "parameter", (name,))
    lag = Hypothesis("steering_lag", "effect", ("steering_lag",))
    ratio = Hypothesis("steering_ratio", "parameter", ("steering_ratio",))
    seconds = {"steering_lag": 0.002, "steering_ratio": -0.3}  # with a change of the first by a tenth
    ratios = (1.0, *(s / (0.1 * stated) for s in seconds.values()))
    model = ComparedModel(
        (Alike((off, lag, ratio), (0.5, 0.3, 0.2), ratios),), fitted, 0.0, np.zeros(0), Interval(0, 0, 0), 1.0, 1.0
    )
    alike = {a["name"]: a["value"] for a in _alike(model, augmented)}
    nominal = augmented.spec.values["steering_ratio"]
    assert alike == {"steering_lag": pytest.approx(0.002), "steering_ratio": pytest.approx(nominal - 0.3)}
