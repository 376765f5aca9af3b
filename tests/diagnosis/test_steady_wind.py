"""A wind that blows steadily over ground is what a trace names, where a recording holds the heading."""

import dataclasses

import numpy as np
import pytest

from harness.common.errors import UserError
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
from support.driven_car import CAR, FREE, driven


def blown(seed, **wind):
    """Return a drive of a car in a wind, with the heading of one that turns around twice, recorded at 100 Hz."""
    spec = resolve_single({**CAR, "effects": ["steady_wind"], "values": wind, "step": "1 ms"}, "test")
    spec = dataclasses.replace(spec, process_noise=dict.fromkeys(spec.process_noise, 0.0))
    context = DriveContext(VEHICLES.load("car").wheelbase(spec.values), spec.values["steering_ratio"], spec.step)
    options = {"duration": 60.0, "speed": 20.0, "speed_variation": 4.0, "amplitude": 0.015, "seed": seed}
    options["lateral_acceleration_limit"] = 9.0
    profile = build_drive("random_sequence", options, context, "test")
    heading = 1.0 + 4.0 * np.pi * profile.time / profile.time[-1]
    profile = dataclasses.replace(profile, further={**profile.further, "heading": heading})
    recorded = simulate_drive(spec, profile, [], seed).assign(heading=("time", heading))
    return recorded.isel(time=slice(None, None, 10))


@pytest.mark.proof
def test_it_is_named_with_its_direction_and_where_it_acts():
    wind = {"wind_force_x": 9.0, "wind_force_y": -6.0, "wind_ahead": 0.9}
    drives = [blown(seed, **wind) for seed in (3, 4)]
    augmented = AugmentedModel(resolve_single({**CAR, "integrator": "rk4"}, "test"), set(map(str, drives[0])), jobs=2)
    prepared = [augmented.drive(d, str(i)) for i, d in enumerate(drives)]
    fitting = Fitting(augmented, prepared, first_variances(augmented, prepared))
    nominal = fitting.fit(coordinates(augmented, FREE, (), 2), fitting.first(), 10)
    tried = [h for h in hypotheses(augmented, FREE) if not h.change_times and h.name != ALL_PARAMETERS]
    best = min(ScoreTest(fitting, nominal).of(tried), key=lambda s: s.freedom * np.log(fitting.samples) - 2.0 * s.gain)
    assert best.hypothesis.name == "steady_wind"
    start = nominal.point.values.copy()
    start[[augmented.row(n) for n in best.hypothesis.amplitudes]] = best.amplitudes[:, None]
    start[[augmented.row(n) for n in best.hypothesis.shapes]] = best.shapes[:, None]
    start = dataclasses.replace(nominal.point, values=start)
    found = fitting.fit(coordinates(augmented, FREE, (best.hypothesis,), 2), start, 30).point
    for name, true in wind.items():
        assert found.values[augmented.row(name), 0] == pytest.approx(true, rel=0.1)


def test_a_recording_without_a_heading_is_not_searched_for_it():
    drive = driven(1, duration=20.0)
    augmented = AugmentedModel(resolve_single({**CAR, "integrator": "rk4"}, "test"), set(map(str, drive)))
    assert not any(h.name.startswith("steady_wind") for h in hypotheses(augmented, FREE))


def test_a_simulated_drive_has_no_heading_and_says_so():
    with pytest.raises(UserError, match="a simulated drive has no input 'heading', a recording may"):
        driven(1, ["steady_wind"], duration=20.0, wind_force_x=5.0, wind_ahead=1.0)
