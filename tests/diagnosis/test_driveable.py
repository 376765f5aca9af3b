"""A refitted model must be one that can be driven as the vehicle was; where a fit ends at a bound it is said."""

import dataclasses
import math
from types import SimpleNamespace

import numpy as np
import pytest

from harness.diagnosis.fitting import FittedHypothesis, Fitting
from harness.diagnosis.model.hypotheses import coordinates
from harness.diagnosis.result.outcome import cautions
from harness.diagnosis.selection.candidate_fits import CandidateFits
from harness.diagnosis.selection.forward_selection import Trace, first_variances
from harness.diagnosis.selection.validation import HeldOut, simulation_error
from harness.identification.fisher_scoring import Maximum
from harness.identification.objective import Driveable
from support.driven_car import FREE, driven

FRONT, REAR = 7e4, 1.2e5
"""N/rad; stiffness of the axles of the published car at their static loads (Blanco-Claraco 2021)."""


@pytest.fixture(scope="module")
def drive(augmented):
    return augmented.drive(driven(7, duration=25.0), "drive")


def softer(augmented, share):
    values = augmented.stated()
    values[augmented.row("stiffness_peak_rear")] *= share
    return values


def test_a_car_is_unstable_from_its_critical_speed_on(augmented, drive):
    """The critical speed of an oversteering car follows from its axles in closed form."""
    car, share = augmented.spec.values, 0.35
    front, rear = car["cog_to_front_axle"], car["cog_to_rear_axle"]
    excess = FRONT * front - share * REAR * rear
    critical = math.sqrt(FRONT * share * REAR * (front + rear) ** 2 / (car["mass"] * excess))
    driveable = Driveable(augmented, [drive])
    driveable.speeds = critical * np.array([0.5, 0.97, 1.03, 1.5])
    assert driveable.unstable_from(softer(augmented, share)) == pytest.approx(1.03 * critical)
    assert driveable.unstable_from(augmented.stated()) == math.inf


def test_the_free_run_must_stay_in_its_range(augmented, drive):
    driveable = Driveable(augmented, [drive])
    assert driveable.stays([augmented.stated()])
    assert not driveable.stays([softer(augmented, 0.2)])
    assert driveable.admits([augmented.stated()])
    assert not driveable.admits([softer(augmented, 0.2)])


def test_a_candidate_is_stable_and_stays_in_its_range(augmented, drive):
    """Either alone is not enough: a soft axle leaves the range, and spins only where it is driven fast."""
    slow, fast = Driveable(augmented, [drive]), Driveable(augmented, [drive])
    slow.speeds, fast.speeds = np.array([1.0]), np.array([60.0])
    soft, softish = softer(augmented, 0.2), softer(augmented, 0.5)
    assert math.isinf(slow.unstable_from(soft))
    assert not slow.admits([soft])
    assert fast.stays([softish])
    assert not fast.admits([softish])
    assert slow.admits([softish])


def test_speeds_and_length_are_those_of_what_was_driven(augmented, drive):
    column = augmented.model.inputs.index("speed")
    inputs = np.tile(drive.inputs, (2, 1))
    inputs[:, column] = np.linspace(10.0, 30.0, len(inputs))
    longer = dataclasses.replace(drive, inputs=inputs, time=np.arange(len(inputs)) * drive.time[1])
    driveable = Driveable(augmented, [drive], [longer])
    assert driveable.speeds == pytest.approx(
        [10.2, 16.7333, 23.2667, 29.8], abs=1e-3
    )  # without a hundredth at each end
    assert driveable._samples == len(inputs)


def test_no_fit_leads_from_a_model_that_can_be_driven_to_one_that_cannot(augmented, drive):
    fitting = Fitting(augmented, [drive], first_variances(augmented, [drive]))
    moved = coordinates(augmented, FREE, (), 1)
    looked_at = []

    def search(objective, z, parameters):
        """End with a soft axle, as if that were likelier, where such a model has a likelihood."""
        spun = z.copy()
        spun[1] += math.log(0.2)
        looked_at.append(bool(np.isneginf(objective.values(spun[:, None])[0])))
        return Maximum(z if looked_at[-1] else spun, 0.0, np.eye(2), 0.0), True

    fitted = fitting._driveable(moved, fitting.first(), search)
    assert looked_at == [False, True]
    assert fitting.admits(fitted.point)
    lost = dataclasses.replace(fitting.first(), values=softer(augmented, 0.2)[:, None])
    looked_at.clear()
    fitting._driveable(moved, lost, search)
    assert looked_at == [False]  # one that cannot be driven anyway is not held there
    values = lost.values
    assert fitting.best([lost, fitting.first()]).values is not values


def test_the_nominal_refit_weighs_what_was_stated(augmented, drive):
    fits = CandidateFits(
        Fitting(augmented, [drive], np.ones(3)), HeldOut(augmented, [drive], np.ones(3)), FREE, lambda _: None
    )
    moved = fits.fit((), fits.fitting.first(), 1, 0).coordinates
    assert [c.prior for c in moved] == pytest.approx([0.1, 0.1])  # a tenth of each value, of its logarithm


def test_a_fit_that_ends_at_a_bound_and_a_model_that_spins_are_told_first(augmented, drive):
    fitting = Fitting(augmented, [drive], first_variances(augmented, [drive]))
    moved = coordinates(augmented, FREE, (), 1)
    values = softer(augmented, 1.0)[:, None]
    values[augmented.row("stiffness_peak_front")] = math.exp(moved[0].upper)
    fit = FittedHypothesis(moved, dataclasses.replace(fitting.first(), values=values), 0.0, 0.0)
    trace = Trace(fitting, None, FREE, fit, fit, (), (), (), None, None)
    told = cautions(trace)
    assert told[0].startswith(
        "The fit of the refitted nominal model ends at the upper bound of the stiffness peak front"
    )
    assert any(t.startswith("The refitted nominal model is unstable straight ahead at") for t in told)
    assert len(told) == 2


@pytest.mark.filterwarnings("error")
def test_a_free_run_that_leaves_its_range_at_once_says_so_without_a_warning():
    drive, free = SimpleNamespace(measurements=np.ones((50, 2))), np.full((50, 2), np.nan)
    free[:, 1] = 0.5
    error, excesses = simulation_error([drive], [free], np.full((50, 2), 0.25))
    assert np.isnan(error[0])
    assert error[1] == 0.5
    assert np.isinf(excesses).all()
