"""What is lost without an addition, predicted by the curvature of the likelihood, against the fit without it."""

import pytest

from harness.diagnosis.fitting.fit import Fitting
from harness.diagnosis.model.hypotheses import hypotheses
from harness.diagnosis.selection.candidate_fits import CandidateFits
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.validation import HeldOut
from harness.diagnosis.selection.wald import losses
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
