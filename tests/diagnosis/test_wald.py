"""What is lost without an addition, predicted by the curvature of the likelihood, against the fit without it."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from harness.diagnosis.fitting.fit import Fitting
from harness.diagnosis.model.hypotheses import Hypothesis, hypotheses
from harness.diagnosis.selection.candidate_fits import CandidateFits
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.validation import HeldOut
from harness.diagnosis.selection.wald import losses
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
    )
    fitted = SimpleNamespace(coordinates=(one, other), point=SimpleNamespace(value=lambda c: at[c.name]))
    assert losses(fits, (h,), fitted)[h] == pytest.approx(2.0 * loss)
