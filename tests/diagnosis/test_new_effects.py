"""An effect that is there is what a trace names: those of which a drive of the trace's own vehicles is quickly made."""

import dataclasses

import numpy as np
import pytest

from harness.config import resolve_single
from harness.diagnosis.fitting import Fitting
from harness.diagnosis.model.augmented_model import AugmentedModel
from harness.diagnosis.model.hypotheses import ALL_PARAMETERS, coordinates, hypotheses
from harness.diagnosis.selection.forward_selection import first_variances
from harness.diagnosis.selection.score_test import ScoreTest
from harness.models.contracts import DriveContext
from harness.models.roles import VEHICLES
from harness.simulation.drives import build_drive
from harness.simulation.simulate import simulate_drive
from support.driven_car import FREE, driven

TRUCK = {"vehicle": "semitrailer", "parameters": "ziaukas_2023", "tyre": "linear", "sensors": "test_vehicle_inertial"}


def ranked(augmented, drives, free, open_=lambda h: not h.change_times):
    """Return the hypotheses that a score test ranks, best first by BIC, with their amplitudes."""
    fitting = Fitting(augmented, drives, first_variances(augmented, drives))
    fitted = fitting.fit(coordinates(augmented, free, (), len(drives)), fitting.first(), 10)
    tried = [h for h in hypotheses(augmented, free) if open_(h) and h.name != ALL_PARAMETERS]
    scores = ScoreTest(fitting, fitted).of(tried)
    return sorted(scores, key=lambda s: s.freedom * np.log(fitting.samples) - 2.0 * s.gain)


def test_a_wheel_radius_that_is_off_is_named_with_its_size(augmented):
    drives = [augmented.drive(driven(i, ["wheel_radius_error"], wheel_radius_error=0.04), f"{i}") for i in (60, 61)]
    best = ranked(augmented, drives, FREE)[0]
    assert best.hypothesis.name == "wheel_radius_error"
    assert best.amplitudes[0] == pytest.approx(0.04, rel=0.1)


def truck_driven(seed, **values):
    """Return a drive of a semitrailer whose last axle the articulation steers, recorded at 100 Hz."""
    spec = resolve_single({**TRUCK, "effects": ["forced_steering"], "values": values, "step": "1 ms"}, "test")
    spec = dataclasses.replace(spec, process_noise=dict.fromkeys(spec.process_noise, 0.0))
    context = DriveContext(
        VEHICLES.load("semitrailer").wheelbase(spec.values), spec.values["steering_ratio"], spec.step
    )
    options = {"duration": 40.0, "speed": 14.0, "speed_variation": 3.0, "amplitude": 0.04, "seed": seed}
    profile = build_drive("random_sequence", options, context, "test")
    return simulate_drive(spec, profile, [], seed).isel(time=slice(None, None, 10))


@pytest.mark.proof
def test_an_axle_that_the_articulation_steers_is_named_with_its_axle():
    drive = truck_driven(5, forced_steering_23=0.3)
    augmented = AugmentedModel(resolve_single({**TRUCK, "integrator": "rk4"}, "test"), set(map(str, drive)), jobs=2)
    free = tuple(n for n in augmented.nominal.parameter_names if n.startswith("stiffness_peak"))
    scores = ranked(augmented, [augmented.drive(drive, "drive")], free)
    best = scores[0]
    assert best.hypothesis.name.startswith("forced_steering@")
    # The axle before it is 1.35 m from it: what these 40 s tell of the two differs by a tenth of a unit.
    true = next(s for s in scores if s.hypothesis.name == "forced_steering@23")
    assert true.gain > best.gain - 1.0
    assert true.amplitudes[0] == pytest.approx(0.3, rel=0.15)
